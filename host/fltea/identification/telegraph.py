"""Telegraph noise: samples that step to and fro between a few levels, with little noise about them (pure).

It is popcorn noise whose steps are far above the other noise. The tracker would take its steps for motion,
and the spectrum would show nothing else. So the levels are taken off, the rest is looked at as any other
noise, and the levels come back into bias and heading as what their spectrum is: a relaxation (Machlup,
J. Appl. Phys. 25, 1954).
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
"""Variance of the samples over half of the mean square of their steps: below, nothing stays at a level."""
OUTLIERS = 5e-4
"""Share of samples at either end that may be anywhere."""
CALM, OF_GAUSSIAN = 0.95, 0.871
"""Share of the steps from one sample to the next, the smallest ones, that are of the noise alone; and the
deviation of that share of Gaussian steps over the deviation of all."""
BINS_A_DEVIATION, MOST_BINS = 2.0, 4096
VALLEY = 0.02
"""Samples in a bin between two levels, over those in the fullest bin: 2.8 deviations from a level."""
APART = 5.5
"""Deviations of the noise between two levels, at least."""
WIDEST, LOOSE = 9.0, 0.5
"""Deviations of the noise in the width of a level, at most; or the width over the distance of levels, since
slow noise goes on about them."""
SOON, JUMPS = 4, 0.7
"""Samples on either side of a change between which the samples go this share of the way, in the median."""
LONG_PASSAGE, OFF = 8, 6.0
"""Samples on either side of a change that may be on the way, behind a filter of the sensor; and deviations of
the noise by which they are off a level then."""
LEAST_SHARE, AT_LEVELS = 0.01, 0.93
"""Share of samples on a level, and on all of them together."""
MOST_LEVELS = 6
FEWEST_CHANGES = 6
"""Changes of the level from which on they are not told one by one, as steps of the bias are."""
PASSING = 2
"""Samples up to which a stay on another level is one of noise, and no change."""
IRREGULAR = 0.3
"""Standard deviation of the stays over their mean, at least: 1 of random steps. Regular ones are lines."""
JUMP = 4.0
"""Steps from one sample to the next, over those that only a few exceed, from which on they are jumps."""
COARSE = 1.5
"""Steps of the resolution: levels no farther apart are neighbouring counts of slow noise."""


class Telegraph(NamedTuple):
    """Levels between which samples step; values in the unit of the axis."""

    levels: tuple[float, ...]
    shares: tuple[float, ...]
    """Of the samples, on each level."""
    changes: int
    every_s: float
    """Mean time from a change to the next."""
    sigma: float
    """Standard deviation of the level about its mean."""
    tau_s: float
    """Time within which it forgets itself."""
    ends_at: float
    """The last level less the mean of all."""
    passages: tuple[tuple[int, int], ...]
    """Samples begin … end - 1 that are on no level, but on the way to one."""

    @property
    def part(self) -> Relaxation:
        """A relaxation with the same autocovariance."""
        return Relaxation(self.sigma, self.tau_s)

    def ahead(self, t_s: float) -> float:
        """Return what the last level adds to the mean of the next t_s, as expected."""
        return self.ends_at * self.tau_s / t_s * -math.expm1(-t_s / self.tau_s)


def without_levels(series: Series, h: float) -> tuple[Series, Telegraph | None]:
    """Return samples less their levels, of which the mean is left, and the levels; h: sampling period in s.

    Where samples are at no levels they are returned as they are, with None.
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
    """The newest few arrays, which nobody changes, of which something is known."""

    def __init__(self) -> None:
        self._arrays: deque[weakref.ref[Array]] = deque(maxlen=12)

    def add(self, y: Array) -> None:
        """Remember an array for as long as it is there."""
        self._arrays.append(weakref.ref(y))

    def knows(self, y: Array) -> bool:
        """Whether it is the very array."""
        return any(one() is y for one in list(self._arrays))


_NONE = _Recent()
"""Samples without levels: watched and concluded are those that were looked at."""


def _edges(y: Array, lsb: float | None, largest: float) -> tuple[Array, float] | None:
    """Return the bounds between levels, (levels - 1,), and the deviation of the noise; None without levels.

    lsb: one count, if known. largest: how far levels of a sensor at rest may be apart.
    """
    few = int(OUTLIERS * len(y))
    low, high = (float(np.partition(y, at)[at]) for at in (few, len(y) - 1 - few))
    inside = y.clip(low, high)
    apart = np.diff(inside)
    if float(inside.var()) <= LEAST_RATIO / 2 * float(np.square(apart).mean()):
        return None
    sizes = np.abs(apart)
    calm = np.partition(sizes, int(CALM * len(sizes)))[: int(CALM * len(sizes))]
    resolution = lsb or step(y) or 0.0
    noise = math.sqrt(float(np.square(calm).mean()) / 2) / OF_GAUSSIAN
    noise = max(noise, resolution / math.sqrt(12))
    if not noise > 0 or not 0 < high - low <= largest + 20 * noise:
        return None
    width = max(noise / BINS_A_DEVIATION, (high - low) / MOST_BINS)
    if resolution > 0:  # whole counts, or some bins would have one more of them than others
        width = max(math.ceil(width / resolution), 1) * resolution
    first = low - resolution / 2
    bins = math.ceil((high + resolution / 2 - first) / width)
    edges = _between_groups(y, first + width * np.arange(bins + 1.0), noise, resolution)
    return None if edges is None else (edges, noise)


def _between_groups(y: Array, bounds: Array, noise: float, resolution: float) -> Array | None:
    """Return the middle between neighbouring levels, (levels - 1,); None where values are at no levels.

    bounds: those of the bins in which values are counted, all of one width.
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
    """Return the levels of samples y (n,), each on the level of the number `at` (n,).

    noise: deviation of the samples about the levels.
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
    # The autocovariance of the level falls by half of the mean square of its steps.
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
    """Return which samples near a change are on no level; rest: samples (n,) less their levels."""
    near = np.zeros(len(rest), dtype=np.int8)
    for change in changes.tolist():
        near[max(change - LONG_PASSAGE, 0) : change + LONG_PASSAGE] = 1
    off = ((near == 1) & (np.abs(rest) > most)).astype(np.int8)
    edges = np.flatnonzero(np.diff(off, prepend=0, append=0)).reshape(-1, 2)
    return tuple((int(begin), int(end)) for begin, end in edges.tolist())


def telegraph_words(found: Telegraph, unit: str) -> str:
    """Return a sentence on the levels, which are in this unit."""
    levels = listed([f"{one:.3g}" for one in found.levels])
    return (
        f"Telegraph (popcorn) noise: the samples step between {NUMBERS[len(found.levels)]} levels, {levels} "
        f"{unit}, every {found.every_s:.2g} s or so."
    )


def jump_words(y: Array, unit: str) -> str:
    """Return a sentence on jumps of samples (n,) that stay where they jump to; "" if they are few."""
    if len(y) < 4 * SOON:
        return ""
    apart = np.abs(np.diff(y))
    calm = float(np.quantile(apart, CALM))
    jumps = np.flatnonzero((apart[SOON:-SOON] > JUMP * calm) & (apart[SOON:-SOON] > 0)) + SOON + 1
    stays = np.abs(y[jumps + SOON - 1] - y[jumps - 1 - SOON]) > JUMP * calm
    if np.count_nonzero(stays) < FEWEST_CHANGES:
        return ""
    size = float(np.median(apart[jumps[stays] - 1]))
    return (
        f"The samples jump {np.count_nonzero(stays)} times, by {size:.2g} {unit} in the median, and stay "
        "there: steps between levels (telegraph noise), or the sensor was moved. Too little is left between."
    )
