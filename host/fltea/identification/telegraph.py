"""Telegraph noise: samples that step to and fro between a few levels, with little noise about them (pure).

It is popcorn noise whose steps are far above the other noise. The tracker would take its steps for motion,
and the spectrum would show nothing else. So the levels are taken off, the rest is looked at as any other
noise, and the levels come back into bias and heading as what their spectrum is: a relaxation (Machlup,
J. Appl. Phys. 25, 1954).
"""

import math
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
CALM, OF_GAUSSIAN = 0.95, 0.871
"""Share of the steps from one sample to the next, the smallest ones, that are of the noise alone; and the
deviation of that share of Gaussian steps over the deviation of all."""
BINS_A_DEVIATION, MOST_BINS = 2.0, 4096
VALLEY = 0.02
"""Samples in a bin between two levels, over those in the fullest bin: 2.8 deviations from a level."""
WIDEST = 9.0
"""Deviations of the noise in the width of a level, at most: it may be a bit coarser than what steps show."""
LEAST_SHARE, AT_LEVELS = 0.01, 0.93
"""Share of samples on a level, and on all of them together."""
MOST_LEVELS = 6
FEWEST_CHANGES = 6
"""Changes of the level from which on they are not told one by one, as steps of the bias are."""
PASSING = 2
"""Samples up to which a stay on another level is one of noise, and no change."""
IRREGULAR = 0.3
"""Standard deviation of the stays over their mean, at least: 1 of random steps. Regular ones are lines."""
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
    if len(y) < 2 * SHORTEST_STAY * FEWEST_CHANGES:
        return series, None
    live = LiveConfig()
    largest = live.largest_step_dps if series.unit == GYRO_UNIT else live.largest_step_ms2
    edges = _edges(y[:LONG], series.lsb, largest)
    if edges is None:
        return series, None
    at = np.searchsorted(edges, y)
    found = _telegraph(y, at, h)
    if found is None:
        return series, None
    level = np.array(found.levels)
    mean = float(level @ found.shares)
    return series._replace(y=y - (level[at] - mean)), found


def _edges(y: Array, lsb: float | None, largest: float) -> Array | None:
    """Return the bounds between levels, (levels - 1,); None where there are none.

    lsb: one count, if known. largest: how far levels of a sensor at rest may be apart.
    """
    apart = np.diff(y)
    if float(y.var()) < LEAST_RATIO / 2 * float(np.square(apart).mean()):
        return None
    sizes = np.abs(apart)
    calm = np.partition(sizes, int(CALM * len(sizes)))[: int(CALM * len(sizes))]
    resolution = lsb or step(y) or 0.0
    noise = math.sqrt(float(np.square(calm).mean()) / 2) / OF_GAUSSIAN
    noise = max(noise, resolution / math.sqrt(12))
    low, high = float(y.min()), float(y.max())
    if not noise > 0 or high - low > largest + 20 * noise:
        return None
    bins = min(math.ceil((high - low) / noise * BINS_A_DEVIATION), MOST_BINS)
    if resolution > 0:  # no bin is between two counts
        bins = min(bins, max(math.floor((high - low) / resolution), 1))
    counts, bounds = np.histogram(y, bins)
    full = np.concatenate([[False], counts > VALLEY * counts.max(), [False]])
    begins, ends = np.flatnonzero(full[1:] & ~full[:-1]), np.flatnonzero(full[:-1] & ~full[1:])
    shares = np.add.reduceat(counts, np.column_stack([begins, ends]).ravel()[: 2 * len(begins) - 1])[::2]
    shares = shares / len(y)
    kept = shares >= LEAST_SHARE
    begins, ends, shares = begins[kept], ends[kept], shares[kept]
    width = float(bounds[1] - bounds[0])
    if not 2 <= len(begins) <= MOST_LEVELS or shares.sum() < AT_LEVELS:
        return None
    if float((ends - begins).max()) * width > WIDEST * noise + 2 * width:
        return None
    edges = (bounds[ends[:-1]] + bounds[begins[1:]]) / 2
    near = np.diff((bounds[begins] + bounds[ends]) / 2).min() <= COARSE * resolution
    return None if near else np.asarray(edges)


def _telegraph(y: Array, at: NDArray[np.int64], h: float) -> Telegraph | None:
    """Return the levels of samples y (n,), each on the level of the number `at` (n,)."""
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
    )


def telegraph_words(found: Telegraph, unit: str) -> str:
    """Return a sentence on the levels, which are in this unit."""
    levels = listed([f"{one:.3g}" for one in found.levels])
    return (
        f"Telegraph (popcorn) noise: the samples step between {NUMBERS[len(found.levels)]} levels, {levels} "
        f"{unit}, every {found.every_s:.2g} s or so."
    )
