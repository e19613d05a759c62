"""Test whether the noise stayed the same: the power of each octave is compared between parts of the record.

The record is divided into a few cells (intervals of time). For each octave of the spectrum, the mean and the
variance of the logarithm of its blocks' power are known in each cell. If the noise is stationary, the means
of the cells do not differ more than the variance of the blocks within a cell explains (analysis of variance).
The logarithm makes the test robust against heavy tails, and the variance comes from the data themselves. The
cells of a long record are long. Changes up and down within a cell are found by another test, at the time
scale of these changes (`swings`). So any change that can be found in a short record can also be found in a
long record.
"""

import math
from collections.abc import Iterable, Sequence
from statistics import NormalDist
from typing import NamedTuple, TypeVar

import msgspec
import numpy as np

from fltea.noise.distributions import f_deviate
from fltea.records.arrays import Array
from fltea.spectrum.octaves import BandCells
from fltea.spectrum.swings import OVERLAP, Swing, find_swings

LEAST_IN_CELL = 4
"""A cell has at least this many blocks. Smaller cells are joined with their neighbours."""
LEAST_SIZE = 1.25
"""Smallest change that is reported, as a ratio of powers. A smaller change is of no practical importance."""
MOSTLY_ONE_STEP = 0.6
"""A change is called a step if one step explains at least this proportion of the variance of the power
between the cells (intervals of time).
"""


class Change(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How the power of one octave of the spectrum changed during the record."""

    low_hz: float
    high_hz: float
    p: float
    """The p-value of the test that found the change, multiplied by the number of all tests."""
    size: float
    """Size of the change as a ratio of two powers, exp(2σ). σ is the standard deviation of the log power over
    time; what chance explains is subtracted from σ². For a single step in the middle of the record, the ratio
    is the size of the step.
    """
    ratio: float = 1.0
    """The mean power after `at_s`, divided by that before `at_s`; 1 if the power went up and down."""
    at_s: float = 0.0
    """The time of a step: if the record is divided here, the powers before and after it differ most."""
    share: float = 0.0
    """The power has some variance over time. This proportion of the variance comes from the step at `at_s`,
    and the rest from changes up and down.
    """
    half_s: float | None = None
    """Time from a high power to the following low power, known to a factor of two. None if the change is not
    one that `swings` has found.
    """
    period_s: float | None = None
    """Period of the changes, if the samples show that the power goes up and down regularly."""

    @property
    def is_step(self) -> bool:
        """Whether the change is a single step rather than up and down."""
        return self.share >= MOSTLY_ONE_STEP


class _Parted(NamedTuple):
    """How the power in the cells (intervals of time) of an octave differs.

    `variance`: variance of the logarithm of power between the cells, minus the variance that chance explains.
    """

    deviate: float
    variance: float
    ratio: float
    at_s: float
    explained: float
    """Variance of the log power that a single step at `at_s` would explain."""
    share: float
    """`explained`, divided by the whole variance of the log power between the cells (intervals of time)."""


Found = TypeVar("Found", _Parted, Swing)


def find_change(
    cells: Iterable[BandCells],
    h: float,
    level: float,
    from_hz: float = 0.0,
    notch: tuple[tuple[float, float], ...] = (),
) -> Change | None:
    """Return the most significant change of any octave, if it is significant and large enough to matter.

    `level`: probability of finding a change in stationary noise. An octave is not tested if it reaches below
    `from_hz` or into a band (low, high) of `notch`. All these frequencies are in Hz.
    """
    looked = [
        band
        for band in cells
        if band.low_hz >= from_hz
        and not any(band.low_hz < high and low < band.high_hz for low, high in notch)
    ]
    cells_of = [(band, joined) for band in looked if (joined := _joined(band)) is not None]
    parted = [(band, one) for band, its in cells_of if (one := _compared(*its, h)) is not None]
    swinging, compared = find_swings(looked, h)
    # Each of the two tests (of cells, which are intervals of time, and of time scales) gets half of the
    # significance level.
    tests, comparing = 2 * len(cells_of), 2 * compared
    step, worst = _worst(parted, tests, level), _worst(swinging, comparing, level)
    if step is not None:
        band, found = step
        share = found.share if worst is None else min(found.share, found.explained / worst[1].variance)
        if worst is None or share >= MOSTLY_ONE_STEP:
            p, size = _p(found.deviate, tests), _size(found.variance)
            return Change(band.low_hz, band.high_hz, p, size, found.ratio, found.at_s, share)
    if worst is None:
        return None
    band, its = worst
    return Change(
        band.low_hz, band.high_hz, _p(its.deviate, comparing), _size(its.variance), half_s=its.half_s
    )


def _worst(
    found: Sequence[tuple[BandCells, Found]], tests: int, level: float
) -> tuple[BandCells, Found] | None:
    """Return the octave with the most significant change that is also large enough, and this change."""
    least = -NormalDist().inv_cdf(level / tests) if tests else math.inf
    those = [one for one in found if one[1].deviate > least and _size(one[1].variance) >= LEAST_SIZE]
    return max(those, key=lambda one: one[1].deviate, default=None)


def _p(deviate: float, tests: int) -> float:
    return min(NormalDist().cdf(-deviate) * tests, 1.0)


def _size(variance: float) -> float:
    """Return the ratio of two powers whose logarithms differ by two standard deviations.

    `variance`: variance of the logarithm of power.
    """
    return math.exp(2 * math.sqrt(variance))


def _compared(
    counts: Array, means: Array, first: Array, within: float, degrees: float, h: float
) -> _Parted | None:
    """Compare the power in the cells (intervals of time) of an octave.

    Return None if the powers of the cells differ too little to matter. The first five arguments are what
    `_joined` returns; `h`: sampling period [s].
    """
    total = float(counts.sum())
    around = means - counts @ means / total
    between = float(counts @ around**2)
    free = len(counts) - 1
    # variance of the log power between the cells, minus the variance that chance explains
    variance = max(between - free * within, 0.0) / total
    if _size(variance) < LEAST_SIZE:
        return None
    deviate = float(f_deviate(between / free / within, max(free, 2), degrees))
    before, sums = counts.cumsum()[:-1], (counts * around).cumsum()[:-1]
    explained = sums**2 / before + sums**2 / (total - before)
    at = int(explained.argmax())
    difference = -sums[at] / (total - before[at]) - sums[at] / before[at]
    return _Parted(
        deviate,
        variance,
        math.exp(difference),
        float(first[at + 1]) * h,
        float(explained[at]) / total,
        float(explained[at]) / between,
    )


def _joined(band: BandCells) -> tuple[Array, Array, Array, float, float] | None:
    """Return the cells (intervals of time) of an octave, joined until each has enough blocks.

    Returns three arrays with a value for each cell: the number of its blocks, the mean of their log powers,
    and the index of its first sample. Also returns the variance of the log power within cells, and the
    degrees of freedom of this variance. Returns None if there are fewer than two cells.
    """
    counts = np.asarray(band.counts, dtype=np.float64)
    some = counts > 0
    counts, first = counts[some], np.asarray(band.first, dtype=np.float64)[some]
    means = band.mean_log[some]
    squares = np.where(counts > 1, band.variance_log[some] * (counts - 1), 0.0)
    starts, have = [0], 0.0
    for i, count in enumerate(counts[:-1].tolist()):
        have += count
        if have >= LEAST_IN_CELL:
            starts.append(i + 1)
            have = 0.0
    if len(starts) > 1 and counts[starts[-1] :].sum() < LEAST_IN_CELL:
        starts.pop()
    if len(starts) < 2:
        return None
    n = np.add.reduceat(counts, starts)
    mean = np.add.reduceat(counts * means, starts) / n
    # The blocks of a joined cell (interval of time) have log powers that differ from their mean. `total`: for
    # each joined cell, the sum of the squares of these differences.
    total = np.add.reduceat(squares + counts * means**2, starts) - n * mean**2
    degrees = float(n.sum()) - len(n)
    within = float(total.sum()) / degrees
    if not within > 0:
        return None
    # Neighbouring blocks are slightly correlated, so the mean over a cell (interval of time) varies more than
    # that of independent blocks would.
    return n, mean, first[starts], within * (1 + 2 * OVERLAP), degrees
