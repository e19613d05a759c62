"""Test whether the power of an octave of the spectrum goes up and down, at any time scale.

Consider the means of the logarithm of power in neighbouring runs of 2^s blocks. If blocks are independent,
the variance of the difference of these means falls as 1 / 2^s. So the variance multiplied by 2^s is the same
at every scale s (`octaves.BandCells`). If the power goes up and down, this variance is larger at scales near
the duration of the swings, and hardly larger at other scales. So each scale is compared by an F test with the
shorter scales, and with the longer scales. A longer record has more pairs of runs at each scale. So a swing
that can be found in a short record can also be found in a long record.
"""

import functools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fltea.noise.distributions import f_deviate
from fltea.records.arrays import Array
from fltea.spectrum.octaves import BandCells

OVERLAP = 1 / 36
"""Correlation of the power of blocks that overlap by half, under Hann's window."""
MOST_ALIKE = 0.1
"""A correlation of neighbouring blocks up to this value does not count as a change. An outlier may lie in two
overlapping blocks, and a resonance continues from one block to the next.
"""
FEWEST_PAIRS = 3
"""At scale s, pairs of neighbouring runs of 2^s blocks are compared. A scale is used only if it has at least
this many pairs.
"""
EVERYDAY = 3.0
"""A difference of at most this many standard deviations is not significant at any level in use."""


class Swing(NamedTuple):
    """The time scale at which chance is least likely to explain how an octave's power changes."""

    deviate: float
    """How unlikely the found ratio of variances is in stationary noise, as a number of standard deviations.
    """
    variance: float
    """Variance of the logarithm of power, minus the variance that chance explains, summed over all scales."""
    half_s: float
    """Time from a high power to the following low power, known to a factor of two. It is computed from the
    scale that has the largest part of `variance`.
    """


class _Compared(NamedTuple):
    """Comparisons of the variance at a time scale with that expected from other scales; all arrays (k,)."""

    ratio: Array
    pairs: Array
    usual: Array
    its_pairs: Array


def find_swings(bands: Sequence[BandCells], h: float) -> tuple[list[tuple[BandCells, Swing]], int]:
    """Return the bands whose power varies unusually at a time scale, with the most significant scale of each.

    Also return the number of comparisons of scales that were made in all bands. `h`: sampling period [s].
    """
    those = [_Scales.of(band) for band in bands]
    enough = [(band, its) for band, its in zip(bands, those, strict=True) if len(its.runs) >= 2]
    if not enough:
        return [], 0
    compared = [one for _, its in enough for one in (its.slow(), its.fast())]
    ratio, pairs, _, its_pairs = map(np.concatenate, zip(*compared, strict=True))
    deviates = f_deviate(ratio, pairs, its_pairs)
    each = np.split(deviates, np.cumsum([len(one.ratio) for one in compared])[:-1])
    found = []
    for place, (band, its) in enumerate(enough):
        best, alike = max(
            (2 * place, MOST_ALIKE), (2 * place + 1, OVERLAP), key=lambda one: each[one[0]].max()
        )
        at = each[best].argmax()
        if (deviate := float(each[best][at])) > EVERYDAY:
            usual = float(compared[best].usual[at])
            found.append((band, its.swing(deviate, usual, alike, band.hop * h)))
    return found, len(ratio)


class _Scales(NamedTuple):
    """The time scales (k,) of a band that have enough pairs of runs.

    `runs`: number of blocks in a run, at each scale.
    """

    runs: Array
    pairs: Array
    variance: Array

    @classmethod
    def of(cls, band: BandCells) -> "_Scales":
        known = (band.pairs >= FEWEST_PAIRS) & (band.scale_variance > 0)
        runs = np.exp2(np.flatnonzero(known).astype(np.float64))
        return cls(runs, band.pairs[known], band.scale_variance[known])

    def slow(self) -> _Compared:
        """Compare the variance of the power at each time scale with the mean variance at shorter scales."""
        return _against(self.variance / _expected(self.runs, MOST_ALIKE), self.pairs)

    def fast(self) -> _Compared:
        """Compare the variance of the power at each time scale with the mean variance at longer scales."""
        return _against((self.variance / _expected(self.runs, OVERLAP))[::-1], self.pairs[::-1])

    def swing(self, deviate: float, usual: float, alike: float, hop_s: float) -> Swing:
        """Return a `Swing`. Its variance is by how much the power varies more than usual, at all time scales.

        `usual`: the usual variance of single blocks. `alike`: correlation of neighbouring blocks. `hop_s`:
        time [s] from one block to the next.
        """
        excess = np.maximum(self.variance - usual * _expected(self.runs, alike), 0.0) / (2 * self.runs)
        return Swing(deviate, float(excess.sum()), float(self.runs[excess.argmax()]) * hop_s)


def _against(variance: Array, pairs: Array) -> _Compared:
    """Compare each variance (k,) with means of those before it: of the first, of the first two, and so on."""
    total = pairs.cumsum()
    usual = (variance * pairs).cumsum() / total
    one, before = _below(len(pairs))
    return _Compared(variance[one] / usual[before], pairs[one], usual[before], total[before])


@functools.cache
def _below(scales: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    return np.tril_indices(scales, -1)


def _expected(runs: Array, alike: float) -> Array:
    """Return the expected ratio of each scale's variance to that of single blocks.

    `alike`: correlation of neighbouring blocks.
    """
    return 1 + 2 * alike - 3 * alike / runs
