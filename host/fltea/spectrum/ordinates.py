"""Frequencies and powers among which peaks are searched, from a file or from the running spectrum.

In the periodogram of a file, each value is one ordinate. In the running spectrum of live samples, a value may
average several ordinates. At high frequencies it averages over blocks under Hann's window.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fltea import _native
from fltea.records.arrays import Array
from fltea.spectrum.ordinate_peak import strongest_ordinates
from fltea.spectrum.periodogram import Periodogram

LOBE = 2
"""Among averages over blocks, a sharp spectral line spreads to this many neighbours on each side."""


class Found(NamedTuple):
    """The strongest peak: its values, with the indices `start` to before `stop`, and the level around it."""

    start: int
    stop: int
    level: float


class Ordinates(NamedTuple):
    """The values among which peaks are searched, in the order of rising frequency."""

    lam: Array
    """Frequencies (m,) [rad a sample]."""
    power: Array
    h: float
    """Sampling period [s]."""
    n: int
    """Number of samples of the record."""
    weight: Array | None = None
    """Number of ordinates that each value averages (m,); None if each value is one ordinate."""
    averaged: NDArray[np.bool_] | None = None
    """Whether each value is an average over blocks (m,); None if each value is one ordinate."""
    spread: Array | None = None
    """Width of the band for which each value stands, (m,) [rad a sample]; None if all widths are equal."""

    @staticmethod
    def of(p: Periodogram) -> "Ordinates":
        """Return the ordinates of a periodogram of one series."""
        if p.weight is None:
            return Ordinates(p.lam, p.power, p.h, p.n)
        return Ordinates(p.lam, p.power, p.h, p.n, p.weight, averaged_of(p.weight), np.gradient(p.lam))

    def part(self, begin: int, end: int) -> "Ordinates":
        """Return the ordinates from index `begin` to before `end`."""
        return self._chosen(lambda column: column[begin:end])

    def without(self, left: int, right: int) -> "Ordinates":
        """Return the values before index `left`, and those from `right` on."""
        return self._chosen(lambda column: np.concatenate([column[:left], column[right:]]))

    def strongest(self, false_alarm: float) -> Found | None:
        """Return the most significant peak; None if no peak is significant."""
        if self.weight is None:
            found = strongest_ordinates(self.power, false_alarm)
        else:
            found = _native.strongest_octave_peak(self.power, self.weight, false_alarm)
        return None if found is None else Found(*found)

    def is_averaged(self, i: int) -> bool:
        """Return whether value `i` is an average over blocks."""
        return self.averaged is not None and bool(self.averaged[i])

    def has_averages(self) -> bool:
        """Return whether any value is an average over blocks."""
        return self.averaged is not None and bool(self.averaged.any())

    def first_average_before(self, end: int) -> int:
        """Return the smallest index from which all values before `end` are averages over blocks."""
        single = np.flatnonzero(~self.averaged[:end]) if self.averaged is not None else np.arange(end)
        return int(single[-1]) + 1 if single.size else 0

    def median_weight(self) -> float:
        """Return the median of the numbers of ordinates that the values average."""
        return 1.0 if self.weight is None else float(np.median(self.weight))

    def ordinates_in(self, begin: int, end: int) -> float:
        """Return the number of ordinates that the values from `begin` to before `end` average in total."""
        return float(end - begin) if self.weight is None else float(self.weight[begin:end].sum())

    def mean(self, begin: int, end: int) -> float:
        """Return the mean power of the ordinates from `begin` to before `end`."""
        power = self.power[begin:end]
        if self.weight is None:
            return float(power.mean())
        return float(self.weight[begin:end] @ power) / self.ordinates_in(begin, end)

    def power_over(self, begin: int, end: int, level: float) -> float:
        """Return the power above `level` of the values from `begin` to before `end`, in `total`'s unit."""
        above = self.power[begin:end] - level
        return float(above.sum() if self.spread is None else above @ self.spread[begin:end])

    def total(self) -> float:
        """Return the power of all values, summed over the frequencies."""
        return float(self.power.sum() if self.spread is None else self.power @ self.spread)

    def width_hz(self, at: NDArray[np.intp]) -> float:
        """Return the total width [Hz] of the frequency bands that the values with the indices `at` cover."""
        if self.spread is None:
            return len(at) / (self.n * self.h)
        return float(self.spread[at].sum() / (2 * math.pi * self.h))

    def margin(self, i: int) -> float:
        """Return by how much a band that ends at value `i` reaches beyond this value [rad a sample].

        In a file, the band needs no margin, since `Periodogram.without` computes the exact frequencies of the
        ordinates. In the running spectrum, the band needs a margin, since otherwise a rounding error might
        leave a value at the band's end outside of the band.
        """
        return 0.0 if self.spread is None else float(self.spread[i]) / 4

    def _chosen(self, choose: Callable[[Any], Any]) -> "Ordinates":
        weight, averaged, spread = (
            None if column is None else choose(column) for column in (self.weight, self.averaged, self.spread)
        )
        lam, power = choose(self.lam), choose(self.power)
        return Ordinates(lam, power, self.h, self.n, weight, averaged, spread)


def averaged_of(weight: Array) -> NDArray[np.bool_]:
    """Return which values are averages over blocks; all others average one or a few ordinates."""
    return np.asarray(weight != np.rint(weight))


def around(p: Periodogram, bands: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
    """Return `bands` (low, high) [Hz], widened so that each holds all the power of a sharp line in it."""
    if p.weight is None:
        return bands
    hz = p.lam / (2 * np.pi * p.h)
    reach = np.where(averaged_of(p.weight), (LOBE - 0.5) * np.gradient(hz), 0.0)
    wider = []
    for low, high in bands:
        first, last = np.searchsorted(hz, [low, high]).clip(max=len(hz) - 1)
        wider.append((low - float(reach[first]), high + float(reach[last])))
    return tuple(wider)
