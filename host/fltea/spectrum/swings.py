"""Whether the power of an octave goes up and down, at any scale of time (pure).

The means of the logarithm of power in neighbouring runs of 2^s blocks differ, if blocks do not depend on each
other, by a variance that is the same for every scale s but for the factor 2^s (`octaves.BandCells`). Power
that goes up and down adds to the scales near its own time and to few others, so that each scale is compared
with those that are shorter and with those that are longer, by F. A scale has the more pairs the longer the
record is: what was seen in a short record is seen in a longer one.
"""

from typing import NamedTuple

import numpy as np

from fltea.noise.distributions import f_deviate
from fltea.records.arrays import Array
from fltea.spectrum.octaves import BandCells

OVERLAP = 1 / 36
"""Correlation of the power of blocks that overlap by half, under Hann's window."""
MOST_ALIKE = 0.1
"""The largest correlation of neighbouring blocks that is no change: an outlier is in both, and a resonance
goes on from one to the next."""
FEWEST_PAIRS = 3
"""Pairs of a scale that is compared."""


class Swing(NamedTuple):
    """The scale of time at which the power of an octave differs most from what chance allows."""

    deviate: float
    """Of a normal variable, as unlikely as the ratio of variances that was found."""
    variance: float
    """Of the logarithm of power, beyond chance, at all scales together."""
    half_s: float
    """Time between ups and downs, to a factor of two: the scale that has most of that variance."""


def comparisons(band: BandCells) -> int:
    """Return how many pairs of scales `find_swing` compares in this band."""
    scales = int(np.count_nonzero(band.pairs >= FEWEST_PAIRS))
    return scales * (scales - 1)


def find_swing(band: BandCells, h: float) -> Swing | None:
    """Return the most significant scale of a band; None if there are too few blocks. h: the period in s."""
    enough = band.pairs >= FEWEST_PAIRS
    pairs, variance = band.pairs[enough], band.scale_variance[enough]
    if len(pairs) < 2 or not (variance > 0).all():
        return None
    runs: Array = np.exp2(np.flatnonzero(enough).astype(np.float64))
    slow = _against(variance / _expected(runs, MOST_ALIKE), pairs)
    fast = _against((variance / _expected(runs, OVERLAP))[::-1], pairs[::-1])
    best, alike = (slow, MOST_ALIKE) if slow.deviate > fast.deviate else (fast, OVERLAP)
    excess = np.maximum(variance - best.usual * _expected(runs, alike), 0.0) / (2 * runs)
    half = float(runs[excess.argmax()]) * band.hop * h
    return Swing(best.deviate, float(excess.sum()), half)


class _Found(NamedTuple):
    deviate: float
    usual: float


def _against(variance: Array, pairs: Array) -> _Found:
    """Compare each variance (k,) with the mean of the first ones, of every number of them before it.

    Return the most significant ratio, and the mean that is in it.
    """
    total = pairs.cumsum()
    usual = (variance * pairs).cumsum() / total
    one, before = np.tril_indices(len(pairs), -1)
    deviates = f_deviate(variance[one] / usual[before], pairs[one], total[before])
    at = int(deviates.argmax())
    return _Found(float(deviates[at]), float(usual[before[at]]))


def _expected(runs: Array, alike: float) -> Array:
    """Return the variance of scales over that of blocks, neighbours among which are correlated."""
    return 1 + 2 * alike - 3 * alike / runs
