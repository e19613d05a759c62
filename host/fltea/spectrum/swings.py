"""Test whether the power of an octave of the spectrum goes up and down, at any time scale.

The power of an octave is known for successive blocks of samples. A run of scale s is 2^s successive blocks,
and each run has a mean log power. At each scale, the means of neighbouring runs are compared. If the blocks
are independent, the variance of the difference of two such means is proportional to 1 / 2^s. Multiplied by
2^s, it is the same at every scale (`octaves.BandCells`). If the power goes up and down, this product is
larger at scales near the duration of the swings, and hardly larger at other scales. So an F test compares
each scale with the shorter scales, and another F test with the longer scales. A longer record has more pairs
of runs at each scale. So a swing that can be found in a short record can also be found in a long record.
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
"""Correlation of the powers of neighbouring blocks in white noise. The blocks overlap by half, and each block
is multiplied by Hann's window.
"""
MOST_ALIKE = 0.1
"""A correlation of neighbouring blocks up to this value does not count as a change. An outlier may lie in two
overlapping blocks, and a resonance continues from one block to the next.
"""
FEWEST_PAIRS = 3
"""At scale s, pairs of neighbouring runs of 2^s blocks are compared. A scale is used only if it has at least
this many pairs.
"""
EVERYDAY = 3.0
"""A time scale is reported only if its variance exceeds the expected one by more than this many standard
deviations. A smaller excess is not significant at any significance level that FLTEA uses.
"""


class Swing(NamedTuple):
    """How an octave's power goes up and down, at the time scale where this is most significant."""

    deviate: float
    """Significance of the swings, as a number of standard deviations: a normal random number exceeds it as
    rarely as the power varies so much by chance at this time scale.
    """
    variance: float
    """Variance of the log power over time, summed over all scales. The variance by chance is subtracted."""
    half_s: float
    """Time from a high power to the following low power, known to a factor of two. It is the length of a run
    at the scale that contributes most to `variance`.
    """


class _Compared(NamedTuple):
    """Comparisons of the variance at one time scale with a usual variance; all arrays (k,).

    The usual variance is a mean over other time scales. `ratio`: the variance, divided by the usual one.
    `pairs`, `its_pairs`: number of pairs of runs from which the variance and the usual one were computed.
    """

    ratio: Array
    pairs: Array
    usual: Array
    its_pairs: Array


def find_swings(bands: Sequence[BandCells], h: float) -> tuple[list[tuple[BandCells, Swing]], int]:
    """Return the bands whose power varies unusually at a time scale, with the most significant scale of each.

    Also return how often one scale was compared with others, in all bands together. `h`: sampling period [s].
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
    """The time scales of a band that are used, the shortest first; all arrays (k,).

    At a time scale, neighbouring runs of blocks are compared. A scale is used if it has at least FEWEST_PAIRS
    pairs of such runs. `runs`: number of blocks in a run, at each scale.
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
        """Find slow swings: compare the power's variance at each time scale with that at shorter scales."""
        return _against(self.variance / _expected(self.runs, MOST_ALIKE), self.pairs)

    def fast(self) -> _Compared:
        """Find fast swings: compare the power's variance at each time scale with that at longer scales."""
        return _against((self.variance / _expected(self.runs, OVERLAP))[::-1], self.pairs[::-1])

    def swing(self, deviate: float, usual: float, alike: float, hop_s: float) -> Swing:
        """Return a `Swing`. From the variances at all time scales it takes only what exceeds the usual one.

        `usual`: variance of the log power of single blocks if the noise stays the same. `alike`: correlation
        of the powers of neighbouring blocks. `hop_s`: time [s] from one block to the next.
        """
        excess = np.maximum(self.variance - usual * _expected(self.runs, alike), 0.0) / (2 * self.runs)
        return Swing(deviate, float(excess.sum()), float(self.runs[excess.argmax()]) * hop_s)


def _against(variance: Array, pairs: Array) -> _Compared:
    """Compare each of the variances (k,) with those that come before it in the array.

    Variance number i has i - 1 comparisons: with the first, with the mean of the first two, and so on, up to
    the mean of all that come before it.
    """
    total = pairs.cumsum()
    usual = (variance * pairs).cumsum() / total
    one, before = _below(len(pairs))
    return _Compared(variance[one] / usual[before], pairs[one], usual[before], total[before])


@functools.cache
def _below(scales: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    return np.tril_indices(scales, -1)


def _expected(runs: Array, alike: float) -> Array:
    """Return for each scale the variance in noise that stays the same, divided by that of single blocks.

    `runs`: number of blocks in a run of each scale. `alike`: correlation of neighbouring blocks' powers.
    """
    return 1 + 2 * alike - 3 * alike / runs
