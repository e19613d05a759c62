"""Whether the noise stayed the same: power of its octaves, compared between parts of the record (pure).

Each octave keeps the mean and the variance of the logarithm of its blocks' power in a few cells of time. If
the noise is stationary the cells' means differ no more than blocks do within a cell (analysis of variance).
The logarithm makes the test robust against heavy tails, and the variance is that of the data themselves.
"""

import math
from collections.abc import Iterable
from statistics import NormalDist

import msgspec
import numpy as np

from fltea.noise.distributions import f_deviate
from fltea.records.arrays import Array
from fltea.spectrum.octaves import BandCells

OVERLAP = 1 / 36
"""Correlation of the power of blocks that overlap by half, under Hann's window."""
LEAST_IN_CELL = 4
"""Blocks; cells with fewer are joined with their neighbours."""
LEAST_SIZE = 1.25
"""Ratio of powers, up or down: a smaller change is of no practical importance."""


class Change(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How the power of one octave changed."""

    low_hz: float
    high_hz: float
    p: float
    """The p-value of the analysis of variance, times the number of octaves that were looked at."""
    size: float
    """Two standard deviations of the cells' true levels, as a ratio of powers: of one step in mid-record
    this is the step."""
    ratio: float
    """Mean power after `at_s` over that before."""
    at_s: float
    """Where a division in two parts explains most."""
    share: float
    """How much of the differences that division explains; the rest is up and down."""


def find_change(
    cells: Iterable[BandCells],
    h: float,
    level: float,
    from_hz: float = 0.0,
    notch: tuple[tuple[float, float], ...] = (),
) -> Change | None:
    """Return the most significant change of any octave, if it is significant and large enough to matter.

    level: probability to find one in stationary noise. Octaves that reach below from_hz or into a band of
    `notch` (low, high), all in Hz, are not looked at.
    """
    looked = []
    for band in cells:
        if band.low_hz < from_hz or any(band.low_hz < high and low < band.high_hz for low, high in notch):
            continue
        if (joined := _joined(band)) is not None:
            looked.append((band, *joined))
    best: tuple[float, Change] | None = None
    normal = NormalDist()
    least = -normal.inv_cdf(level / len(looked)) if looked else math.inf
    for band, counts, means, first, within, degrees in looked:
        total = counts.sum()
        around = means - counts @ means / total
        between = float(counts @ around**2)
        free = len(counts) - 1
        # What the cells differ by beyond chance.
        spread = max(between - free * within, 0.0) / total
        size = math.exp(2 * math.sqrt(spread))
        if size < LEAST_SIZE:
            continue
        deviate = float(f_deviate(between / free / within, max(free, 2), degrees))
        if deviate <= least or (best is not None and deviate <= best[0]):
            continue
        before, sums = counts.cumsum()[:-1], (counts * around).cumsum()[:-1]
        explained = sums**2 / before + sums**2 / (total - before)
        at = int(explained.argmax())
        difference = -sums[at] / (total - before[at]) - sums[at] / before[at]
        best = (
            deviate,
            Change(
                band.low_hz,
                band.high_hz,
                min(normal.cdf(-deviate) * len(looked), 1.0),
                size,
                math.exp(difference),
                float(first[at + 1]) * h,
                float(explained[at]) / between,
            ),
        )
    return None if best is None else best[1]


def _joined(band: BandCells) -> tuple[Array, Array, Array, float, float] | None:
    """Return counts, means and first samples of cells with enough blocks.

    The variance within, and its degrees.
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
    # Squares about the joined mean.
    total = np.add.reduceat(squares + counts * means**2, starts) - n * mean**2
    degrees = float(n.sum()) - len(n)
    within = float(total.sum()) / degrees
    if not within > 0:
        return None
    # Neighbours in time are correlated a little: a cell's mean varies more than its blocks say.
    return n, mean, first[starts], within * (1 + 2 * OVERLAP), degrees
