"""Detect telegraph noise: samples step to and fro between a few levels, with little other noise.

Telegraph noise is popcorn noise whose steps are much larger than the other noise. The tracker would mistake
the steps for motion, and in the spectrum they would hide everything else. So the levels are subtracted, and
the rest is analysed like any other noise. Bias and heading then include the levels as a relaxation (a
first-order Gauss-Markov process), which has the same spectrum as telegraph noise (Machlup, J. Appl. Phys. 25,
1954).
"""

import math
import weakref
from collections import deque
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fltea.identification.load import GYRO_UNIT, Series
from fltea.identification.resolution import LONG, step
from fltea.identification.values import SHORTEST_STAY
from fltea.noise.parts import Relaxation
from fltea.records.arrays import Array
from fltea.settings.live import LiveConfig
from fltea.spectrum.wording import NUMBERS, listed

LEAST_RATIO = 2.0
"""In telegraph noise, this ratio is larger than LEAST_RATIO: the variance of the samples, divided by half of
the mean square of the steps between successive samples.

White noise has a ratio of 1. If the ratio is low, samples do not stay at any level.
"""
OUTLIERS = 5e-4
"""Proportion of the samples that is ignored as outliers, at each end of the range of values."""
CALM, OF_GAUSSIAN = 0.95, 0.871
"""The noise about the levels is estimated from the smallest steps between successive samples, since larger
steps may be changes of level. CALM is the proportion of the steps that are used.

OF_GAUSSIAN corrects the estimate. In Gaussian noise, it is the root mean square of the smallest steps,
divided by that of all steps.
"""
BINS_A_DEVIATION, MOST_BINS = 2.0, 4096
VALLEY = 0.02
"""Between two levels, the count in a histogram bin is at most this proportion of the count in the fullest
bin.

In Gaussian noise, a bin at 2.8 standard deviations from a level has this proportion.
"""
APART = 5.5
"""Least distance between two levels, in standard deviations of the noise."""
WIDEST, LOOSE = 9.0, 0.5
"""The values around a level span at most WIDEST standard deviations of the noise. Slow noise makes this span
wider, so LOOSE times the least distance between levels is allowed in any case.
"""
SOON, JUMPS = 4, 0.7
"""At each change of level, the sample SOON samples before it is compared with the one SOON samples after it.
Their difference is divided by the distance between the two levels. The median of this ratio over all changes
has to be at least JUMPS.

If the median is lower, the samples drift from level to level and do not jump.
"""
LONG_PASSAGE, OFF = 8, 6.0
"""Up to LONG_PASSAGE samples before and after a change of level may be in transition, as after a filter of
the sensor.

Such a sample is in transition if it is more than OFF standard deviations of the noise away from its level.
"""
LEAST_SHARE, AT_LEVELS = 0.01, 0.93
"""Each level holds at least the proportion LEAST_SHARE of the samples, and all levels together hold at least
the proportion AT_LEVELS.
"""
MOST_LEVELS = 6
FEWEST_CHANGES = 6
"""Telegraph noise has at least this number of changes between levels. Fewer changes are single steps of the
bias.
"""
PASSING = 2
"""A stay on another level of at most this many samples counts as a noise peak, and not as a change of level.
"""
IRREGULAR = 0.3
"""The standard deviation of the durations of the stays is at least this proportion of their mean.

Stays that end at random have a ratio of 1. Regular changes have a smaller one: they are a spectral line.
"""
JUMP = 4.0
"""A step from one sample to the next is a jump if it is larger than the 95 % quantile of such steps by more
than this factor.
"""
COARSE = 1.5
"""Two levels that are at most this many counts of the sensor apart are only neighbouring counts of slow
noise.
"""


class Telegraph(NamedTuple):
    """Levels between which samples step.

    All values are in the unit of the axis unless a field says otherwise.
    """

    levels: tuple[float, ...]
    shares: tuple[float, ...]
    """Proportion of the samples that is on each level."""
    changes: int
    every_s: float
    """Mean time between changes [s]."""
    sigma: float
    """Standard deviation of the level from its mean over time."""
    tau_s: float
    """Correlation time of the level [s]."""
    ends_at: float
    """Difference of the level at the end of the samples from the mean level."""
    passages: tuple[tuple[int, int], ...]
    """Spans of samples in transition between levels, each as (index of the first sample, index after the last
    one).
    """

    @property
    def part(self) -> Relaxation:
        """The first-order Gauss-Markov process that has the same autocovariance as the changing level."""
        return Relaxation(self.sigma, self.tau_s)

    def ahead(self, t_s: float) -> float:
        """Return what the level at the end of the samples will add to the mean of the next `t_s` seconds.

        The result is an expected value, since the level changes at random.
        """
        return self.ends_at * self.tau_s / t_s * -math.expm1(-t_s / self.tau_s)


def without_levels(series: Series, h: float) -> tuple[Series, Telegraph | None]:
    """Return the samples without telegraph noise, and the levels that were removed. `h`: sampling period [s].

    The level of each sample is subtracted, and the mean level is added.

    Samples without telegraph noise are returned unchanged, with None in place of the levels.
    """
    y = np.asarray(series.y, dtype=np.float64)
    if len(y) < 2 * SHORTEST_STAY * FEWEST_CHANGES or _NONE.knows(series.y):
        return series, None
    live = LiveConfig()
    largest = live.largest_step_dps if series.unit == GYRO_UNIT else live.largest_step_ms2
    seen = _edges(y[:LONG], series.lsb, largest)
    if seen is None:
        _NONE.add(series.y)
        return series, None
    edges, noise = seen
    at = np.searchsorted(edges, y)
    found = _telegraph(y, at, h, noise)
    if found is None:
        return series, None
    level = np.array(found.levels)
    mean = float(level @ found.shares)
    return series._replace(y=y - (level[at] - mean)), found


class _Recent:
    """The last few arrays that were found to have a property. These arrays must not be changed afterwards."""

    def __init__(self) -> None:
        self._arrays: deque[weakref.ref[Array]] = deque(maxlen=12)

    def add(self, y: Array) -> None:
        """Remember an array for as long as it exists."""
        self._arrays.append(weakref.ref(y))

    def knows(self, y: Array) -> bool:
        """Whether this array object is remembered."""
        return any(one() is y for one in list(self._arrays))


_NONE = _Recent()
"""The last arrays in which no separate levels were found. Later steps of the analysis get the same arrays,
and need not search them again.
"""


def _edges(y: Array, lsb: float | None, largest: float) -> tuple[Array, float] | None:
    """Return the bounds between neighbouring levels, (levels - 1,), and the standard deviation of the noise.

    Return None if the samples have no separate levels.

    `lsb`: one count of the sensor in the unit of y, if known. `largest`: largest distance between levels that
    a sensor at rest can have.
    """
    few = int(OUTLIERS * len(y))
    low, high = (float(np.partition(y, at)[at]) for at in (few, len(y) - 1 - few))
    inside = y.clip(low, high)
    steps = np.diff(inside)
    if float(inside.var()) <= LEAST_RATIO / 2 * float(np.square(steps).mean()):
        return None
    sizes = np.abs(steps)
    calm = np.partition(sizes, int(CALM * len(sizes)))[: int(CALM * len(sizes))]
    resolution = lsb or step(y) or 0.0
    noise = math.sqrt(float(np.square(calm).mean()) / 2) / OF_GAUSSIAN
    noise = max(noise, resolution / math.sqrt(12))
    if not noise > 0 or not 0 < high - low <= largest + 20 * noise:
        return None
    width = max(noise / BINS_A_DEVIATION, (high - low) / MOST_BINS)
    # each bin is a whole number of counts wide; otherwise some bins would hold one count more than others
    if resolution > 0:
        width = max(math.ceil(width / resolution), 1) * resolution
    first = low - resolution / 2
    bins = math.ceil((high + resolution / 2 - first) / width)
    edges = _between_groups(y, first + width * np.arange(bins + 1.0), noise, resolution)
    return None if edges is None else (edges, noise)


def _between_groups(y: Array, bounds: Array, noise: float, resolution: float) -> Array | None:
    """Return the values midway between neighbouring levels, (levels - 1,).

    Return None if the histogram of y shows no separate levels.

    `bounds`: bounds of the histogram's bins, which are of equal width.
    """
    counts, _ = np.histogram(y, bounds)
    full = np.concatenate([[False], counts > VALLEY * counts.max(), [False]])
    begins, ends = np.flatnonzero(full[1:] & ~full[:-1]), np.flatnonzero(full[:-1] & ~full[1:])
    shares = np.add.reduceat(counts, np.column_stack([begins, ends]).ravel()[: 2 * len(begins) - 1])[::2]
    shares = shares / len(y)
    kept = shares >= LEAST_SHARE
    begins, ends, shares = begins[kept], ends[kept], shares[kept]
    width = float(bounds[1] - bounds[0])
    if not 2 <= len(begins) <= MOST_LEVELS or shares.sum() < AT_LEVELS:
        return None
    apart = float(np.diff((bounds[begins] + bounds[ends]) / 2).min())
    widest = float((ends - begins).max()) * width
    if apart <= max(APART * noise, COARSE * resolution):
        return None
    if widest > max(WIDEST * noise, LOOSE * apart) + 2 * width:
        return None
    return np.asarray((bounds[ends[:-1]] + bounds[begins[1:]]) / 2)


def _telegraph(y: Array, at: NDArray[np.int64], h: float, noise: float) -> Telegraph | None:
    """Return the telegraph noise in samples y (n,); None if the samples have none.

    `at`: index of the level of each sample, (n,). `noise`: standard deviation of the samples from their
    levels.
    """
    counts = np.bincount(at)
    begins = np.concatenate([[0], np.flatnonzero(np.diff(at)) + 1])
    begins = begins[np.diff(begins, append=len(at)) > PASSING]
    begins = begins[np.diff(at[begins], prepend=-1) != 0]
    on, changes = at[begins], len(begins) - 1
    if changes < FEWEST_CHANGES or (counts < SHORTEST_STAY * np.bincount(on, minlength=len(counts))).any():
        return None
    stays = np.diff(begins)
    if float(stays.std()) < IRREGULAR * float(stays.mean()):
        return None
    levels = np.bincount(at, y) / counts
    at_change = begins[1:]
    before, after = np.maximum(at_change - 1 - SOON, 0), np.minimum(at_change + SOON, len(y) - 1)
    if float(np.median(np.abs((y[after] - y[before]) / np.diff(levels[on])))) < JUMPS:
        return None
    shares = counts / len(y)
    mean = float(levels @ shares)
    variance = float(shares @ (levels - mean) ** 2)
    # The autocovariance of a process falls from lag 0 to lag 1 by half of the mean square of its steps from
    # sample to sample. Here the process is the level; its step is 0 unless the level changes. The correlation
    # time is the level's variance divided by the fall per second.
    steps = np.diff(levels[on])
    tau_s = variance / (float(steps @ steps) / 2) * len(y) * h
    return Telegraph(
        tuple(levels.tolist()),
        tuple(shares.tolist()),
        changes,
        len(y) * h / changes,
        math.sqrt(variance),
        tau_s,
        float(levels[on[-1]]) - mean,
        _passages(y - levels[at], np.flatnonzero(np.diff(at)) + 1, OFF * noise),
    )


def _passages(rest: Array, changes: NDArray[np.int64], most: float) -> tuple[tuple[int, int], ...]:
    """Return spans of samples in transition between levels. `rest`: samples (n,) less their levels."""
    near = np.zeros(len(rest), dtype=np.int8)
    for change in changes.tolist():
        near[max(change - LONG_PASSAGE, 0) : change + LONG_PASSAGE] = 1
    off = ((near == 1) & (np.abs(rest) > most)).astype(np.int8)
    edges = np.flatnonzero(np.diff(off, prepend=0, append=0)).reshape(-1, 2)
    return tuple((int(begin), int(end)) for begin, end in edges.tolist())


def telegraph_words(found: Telegraph, unit: str) -> str:
    """Return a sentence on the levels, with their unit."""
    levels = listed([f"{one:.3g}" for one in found.levels])
    return (
        f"Telegraph (popcorn) noise: the samples step between {NUMBERS[len(found.levels)]} levels, {levels} "
        f"{unit}, every {found.every_s:.2g} s or so."
    )


def jump_words(y: Array, unit: str) -> str:
    """Return a sentence on how samples (n,) jump to another value and then stay there.

    Return "" if there are too few such jumps.
    """
    if len(y) < 4 * SOON:
        return ""
    steps = np.abs(np.diff(y))
    calm = float(np.quantile(steps, CALM))
    jumps = np.flatnonzero((steps[SOON:-SOON] > JUMP * calm) & (steps[SOON:-SOON] > 0)) + SOON + 1
    stays = np.abs(y[jumps + SOON - 1] - y[jumps - 1 - SOON]) > JUMP * calm
    if np.count_nonzero(stays) < FEWEST_CHANGES:
        return ""
    size = float(np.median(steps[jumps[stays] - 1]))
    return (
        f"The samples jump {np.count_nonzero(stays)} times, by {size:.2g} {unit} in the median, and stay "
        "there: steps between levels (telegraph noise), or the sensor was moved. Too few samples are left "
        "between jumps."
    )
