"""Frequencies and powers in which peaks are searched, of a file's periodogram or of the running spectrum.

In a file's periodogram each value is one ordinate. A value of the running spectrum averages several
ordinates, at high frequencies over blocks under Hann's window.
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
"""Number of averaged ordinates on each side to which a sharp line spreads."""


class Found(NamedTuple):
    """The strongest peak: the first ordinate, the one after the last, and the level around them."""

    start: int
    stop: int
    level: float


class Ordinates(NamedTuple):
    """Ordinates with rising frequency; where others were left out, there is a gap."""

    lam: Array
    """Frequencies (m,) [rad a sample]."""
    power: Array
    h: float
    """Sampling period [s]."""
    n: int
    """Number of samples."""
    weight: Array | None = None
    """Number of ordinates that each value averages (m,); None if each value is one ordinate."""
    averaged: NDArray[np.bool_] | None = None
    """Whether each value is an average over blocks (m,); None if each value is one ordinate."""
    spread: Array | None = None
    """Width of the band that each value stands for (m,) [rad a sample]; None if all have the same."""

    @staticmethod
    def of(p: Periodogram) -> "Ordinates":
        """Return the ordinates of a periodogram of one series."""
        if p.weight is None:
            return Ordinates(p.lam, p.power, p.h, p.n)
        return Ordinates(p.lam, p.power, p.h, p.n, p.weight, averaged_of(p.weight), np.gradient(p.lam))

    def part(self, begin: int, end: int) -> "Ordinates":
        """Return the ordinates from `begin` to before `end`."""
        return self._chosen(lambda column: column[begin:end])

    def without(self, left: int, right: int) -> "Ordinates":
        """Return the ordinates before `left`, and those from `right` on."""
        return self._chosen(lambda column: np.concatenate([column[:left], column[right:]]))

    def strongest(self, false_alarm: float) -> Found | None:
        """Return the most striking significant peak; None if there is none."""
        if self.weight is None:
            found = strongest_ordinates(self.power, false_alarm)
        else:
            found = _native.strongest_octave_peak(self.power, self.weight, false_alarm)
        return None if found is None else Found(*found)

    def is_averaged(self, i: int) -> bool:
        """Return whether a value is an average over blocks."""
        return self.averaged is not None and bool(self.averaged[i])

    def has_averages(self) -> bool:
        """Return whether any value is an average over blocks."""
        return self.averaged is not None and bool(self.averaged.any())

    def first_average_before(self, end: int) -> int:
        """Return where the averages begin that reach up to `end` without a single ordinate between."""
        single = np.flatnonzero(~self.averaged[:end]) if self.averaged is not None else np.arange(end)
        return int(single[-1]) + 1 if single.size else 0

    def median_weight(self) -> float:
        """Return the median number of ordinates in a value."""
        return 1.0 if self.weight is None else float(np.median(self.weight))

    def ordinates_in(self, begin: int, end: int) -> float:
        """Return the number of ordinates in the values from `begin` to before `end`."""
        return float(end - begin) if self.weight is None else float(self.weight[begin:end].sum())

    def mean(self, begin: int, end: int) -> float:
        """Return the mean power of the ordinates from `begin` to before `end`."""
        power = self.power[begin:end]
        if self.weight is None:
            return float(power.mean())
        return float(self.weight[begin:end] @ power) / self.ordinates_in(begin, end)

    def power_over(self, begin: int, end: int, level: float) -> float:
        """Return the power above `level` from `begin` to before `end`, in the unit of `total`."""
        above = self.power[begin:end] - level
        return float(above.sum() if self.spread is None else above @ self.spread[begin:end])

    def total(self) -> float:
        """Return the power of all ordinates."""
        return float(self.power.sum() if self.spread is None else self.power @ self.spread)

    def width_hz(self, at: NDArray[np.intp]) -> float:
        """Return the width of the values `at` together [Hz]."""
        if self.spread is None:
            return len(at) / (self.n * self.h)
        return float(self.spread[at].sum() / (2 * math.pi * self.h))

    def margin(self, i: int) -> float:
        """Return by how much a band reaches beyond its last value [rad a sample].

        `Periodogram.without` rounds the ordinates of a file to their places. In the running spectrum rounding
        must not keep the values at the ends of the band.
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
    """Return `bands` (low, high) [Hz], widened so that no sharp line inside leaks out of them in `p`."""
    if p.weight is None:
        return bands
    hz = p.lam / (2 * np.pi * p.h)
    reach = np.where(averaged_of(p.weight), (LOBE - 0.5) * np.gradient(hz), 0.0)
    wider = []
    for low, high in bands:
        first, last = np.searchsorted(hz, [low, high]).clip(max=len(hz) - 1)
        wider.append((low - float(reach[first]), high + float(reach[last])))
    return tuple(wider)
