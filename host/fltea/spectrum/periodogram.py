"""Periodogram of one axis: the ordinates (powers at single frequencies) in use, and their averages over bins.

λ is in rad a sample. I(λ) = |sum_t (y_t - mean) e^{-iλt}|² / n, so that white noise of variance σ² has the
mean I = σ². Some ordinates are not used. Those below number LOWEST contain remains of offset and drift, and
the one at π has another distribution. Whittle's likelihood needs only the averages over bins, as long as the
spectrum hardly changes within a bin.
"""

import functools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fltea.records.arrays import Array

LOWEST = 4
"""The lowest frequency that is used has this many periods in the record."""
FEWEST = 64
"""A fit needs at least this many ordinates."""
LONG, PARTS, AT_ONCE = 1 << 20, 16, 1 << 15
"""A record of more than LONG samples is transformed in PARTS parts, which saves memory. Its last few samples
are left out, so that the number of samples is a multiple of PARTS. The transforms of the parts are combined
for AT_ONCE ordinates at a time.
"""
GROWTH = 0.03
"""The width of a bin is this proportion of the bin's frequency λ. So even a spectrum as steep as λ^-4 changes
by only 12 % within a bin.
"""
WIDEST = math.pi / 120
"""Largest width of a bin [rad a sample]. The width is limited so that peaks of this width can still be seen.
"""
COARSER = 2.0
"""Bins are wider by this factor if the values have weights, as those of a running spectrum. The wider bins
change the p-values of the null test by 2 % at most.
"""


class Periodogram(NamedTuple):
    """The ordinates of a periodogram that are used, in the order of rising frequency."""

    lam: Array
    """Frequencies (m,) in rad a sample."""
    power: Array
    """Power at each frequency, (m,), or (series, m) for several series."""
    h: float
    """Sampling period in s."""
    n: int
    """Number of samples."""
    weight: Array | None = None
    """Effective number of ordinates that each value of `power` averages, (m,); None if each value is one
    ordinate.
    """

    @property
    def ordinates(self) -> float:
        """The effective number of ordinates."""
        return float(len(self.lam)) if self.weight is None else float(self.weight.sum())

    def without(self, from_hz: float, notch: Sequence[tuple[float, float]]) -> "Periodogram":
        """Return the periodogram without ordinates below `from_hz` or in the bands (low, high) `notch` [Hz].

        Raises:
            ValueError: fewer than `FEWEST` ordinates are left.
        """
        blocks = []
        for begin in range(0, len(self.lam), AT_ONCE):
            lam = self.lam[begin : begin + AT_ONCE]
            if self.weight is None:
                hz = np.rint(lam * (self.n / (2 * np.pi))) / (self.n * self.h)
            # averages over several ordinates lie at frequencies that are no multiples of 1/(n h)
            else:
                hz = lam / (2 * np.pi * self.h)
            blocks.append(_kept(hz, from_hz, notch))
        keep = np.flatnonzero(np.concatenate(blocks))
        check_enough(len(keep), self.n)
        rows: slice | NDArray[np.intp] = keep
        if keep[-1] - keep[0] + 1 == len(keep):
            # unlike an array of indices, a slice needs no copy
            rows = slice(int(keep[0]), int(keep[-1]) + 1)
        weight = None if self.weight is None else self.weight[rows]
        return self._replace(lam=self.lam[rows], power=self.power[..., rows], weight=weight)


class Binned(NamedTuple):
    """Averages of neighbouring ordinates over bins."""

    lam: Array
    """The mean frequency of each bin (bins,) [rad a sample]."""
    counts: Array
    """The number of ordinates in each bin, (bins,). If values with weights were averaged, it need not be a
    whole number.
    """
    power: Array
    """The mean power of each bin, (series, bins)."""

    @property
    def ordinates(self) -> int:
        """The number of ordinates in all bins: the sample size for BIC, and for the test of white noise."""
        return round(float(self.counts.sum()))


def periodogram(
    y: ArrayLike, h: float, *, from_hz: float = 0.0, notch: Sequence[tuple[float, float]] = ()
) -> Periodogram:
    """Return the ordinates of `y`, (n,) or (series, n); `h`: sampling period [s].

    `from_hz`: ordinates below this frequency are left out. `notch`: bands (low, high) [Hz] to leave out.

    Raises:
        ValueError: y is not finite or constant, h is not positive, or fewer than `FEWEST` ordinates are left.
    """
    samples = np.asarray(y, dtype=np.float64)
    if samples.ndim not in (1, 2) or not np.isfinite(samples).all():
        raise ValueError("y must be finite numbers, of shape (n,) or (series, n)")
    if (np.ptp(samples, axis=-1) == 0).any():
        raise ValueError("y is constant: there is no noise in it")
    if not (math.isfinite(h) and h > 0):
        raise ValueError(f"h is a sampling period in s and must be > 0, got {h}")
    n = samples.shape[-1]
    if n > LONG and samples.ndim == 1:
        samples = samples[: n - n % PARTS]
        n = len(samples)
    check_enough(len(used_ordinates(n, h, from_hz=from_hz, notch=notch)), n)
    power = _power_in_parts(samples) if n > LONG and samples.ndim == 1 else None
    use = used_ordinates(n, h, from_hz=from_hz, notch=notch)
    if power is not None:
        power = power[LOWEST:] if len(use) == len(power) - LOWEST else power[use]
        lam: Array = np.multiply(2 * np.pi, use, dtype=np.float64)
        lam /= n  # the division is done in place, since the array for a record of a day takes 35 MB
        return Periodogram(lam, power, h, n)
    spectrum = np.fft.rfft(samples - samples.mean(axis=-1, keepdims=True))[..., use]
    return Periodogram(2 * np.pi * use / n, (spectrum.real**2 + spectrum.imag**2) / n, h, n)


def _power_in_parts(y: Array) -> Array:
    """Return the power at each frequency 2πj/n below π, from j = 0 on. `y`: samples, (n,).

    n is a multiple of PARTS. A part of the record is every PARTS-th sample. Each part is transformed
    separately, and the transforms are combined for a few frequencies at a time. A single transform of the
    whole record would need four times the memory of y, in addition to that of its result.
    """
    n, mean = len(y), y.mean()
    size = n // PARTS
    parts = [np.fft.rfft(y[r::PARTS] - mean) for r in range(PARTS)]
    power = np.empty((n - 1) // 2 + 1)
    for begin in range(0, len(power), AT_ONCE):
        j = np.arange(begin, min(begin + AT_ONCE, len(power)))
        place = j % size
        mirrored = place > size // 2
        place[mirrored] = size - place[mirrored]
        step = np.exp(-2j * np.pi / n * j)
        turn = np.ones_like(step)
        total = np.zeros_like(step)
        for part in parts:
            found = part[place]
            np.conjugate(found, out=found, where=mirrored)
            total += turn * found
            turn *= step
        power[j] = (total.real**2 + total.imag**2) / n
    return power


def check_enough(ordinates: int, n: int) -> None:
    """Raise ValueError if `ordinates` of `n` samples are too few for a fit."""
    if ordinates < FEWEST:
        raise ValueError(
            f"{n} samples leave {ordinates} frequencies to fit, and at least {FEWEST} are needed: record "
            "longer, or leave out less of the spectrum (--from-hz, --notch)"
        )


def used_ordinates(
    n: int, h: float, *, from_hz: float = 0.0, notch: Sequence[tuple[float, float]] = ()
) -> NDArray[np.intp]:
    """Return the numbers j of the ordinates that are used. For n samples, they have the frequencies 2πj/n."""
    j = np.arange(LOWEST, (n - 1) // 2 + 1)
    return j[_kept(j / (n * h), from_hz, notch)]


def _kept(frequency_hz: Array, from_hz: float, notch: Sequence[tuple[float, float]]) -> NDArray[np.bool_]:
    keep = frequency_hz >= from_hz
    for low_hz, high_hz in notch:
        keep &= (frequency_hz < low_hz) | (frequency_hz > high_hz)
    return np.asarray(keep)


def binned(p: Periodogram) -> Binned:
    """Average ordinates over bins that become wider with the frequency.

    At the lowest frequencies, each ordinate has a bin of its own.

    If the ordinates have weights, the bins are wider by the factor `COARSER`, which saves time.
    """
    starts = bin_starts(p.lam, p.n, 1.0 if p.weight is None else COARSER)
    lam, power = p.lam, np.atleast_2d(p.power)
    if p.weight is None:
        count = np.diff(np.append(starts, len(lam))).astype(np.float64)
    else:
        count = np.add.reduceat(p.weight, starts)
        lam, power = lam * p.weight, power * p.weight
    return Binned(np.add.reduceat(lam, starts) / count, count, np.add.reduceat(power, starts, axis=1) / count)


def bin_starts(lam: Array, n: int, wider: float = 1.0) -> NDArray[np.intp]:
    """Return the index in `lam` at which each bin begins.

    The edges of the bins do not depend on which ordinates are left out. `n`: number of samples. `wider`:
    factor by which bins are wider than usual.
    """
    starts = np.minimum(np.searchsorted(lam, _edges(n, wider)), len(lam) - 1)
    others = np.ones(len(starts), dtype=np.bool_)
    np.greater(starts[1:], starts[:-1], out=others[1:])
    return np.asarray(starts[others])


@functools.lru_cache(maxsize=16)
def _edges(n: int, wider: float) -> Array:
    step = 2 * math.pi / n
    edge, edges = (LOWEST - 0.5) * step, []
    while edge < math.pi:
        edges.append(edge)
        edge += max(step, wider * min(GROWTH * edge, WIDEST))
    return np.array(edges)
