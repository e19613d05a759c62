"""The drift rate of an axis by its tracked system: its interval has all slow noise that the axis may have.

The model of the spectrum lacks what is slower than ten periods of the record, which tilts a line the most.
The tracker knows how likely each walk of the offset is, also within bounds: the slope's error has the
variance that each of them gives it, with its probability.
"""

import math

import numpy as np

from fltea.estimator.offset_walk import STAYS, OffsetWalk
from fltea.identification.forecast_judge import Learned
from fltea.noise.parts import Part, Walk, spectrum
from fltea.records.arrays import Array
from fltea.records.fit import Interval
from fltea.spectrum.drift_rate import around, slope, slope_variance

AS_LIKELY = 0.4
"""How likely, before any sample, an offset does not walk, for the interval: an offset that walks too slowly
for the record to show tilts its line threefold, and `STAYS` would too often deny it (measured)."""


def tracked_drift_rate(tracked: Learned, y: Array, h: float) -> Interval:
    """Return the slope of y (n,) in its unit a second, with the 95 % interval; h: sampling period in s."""
    n, walk = len(y), tracked.walk
    steps = (walk.steps > 0).any()
    parts: list[Part] = [part for part in tracked.parts if not (steps and isinstance(part, Walk))]
    level = slope_variance(n, h, lambda lam: spectrum(parts, lam, h))
    taus, at = np.unique(walk.taus, return_inverse=True)
    of_step = np.array([_of_step(n, h, tau) for tau in taus.tolist()])
    variances = level + walk.steps * of_step[at]
    return around(slope(y, h), variances.tolist(), _weights(walk).tolist())


def _weights(walk: OffsetWalk) -> Array:
    """Return how likely each of the tracker's walks is, by the prior of this module."""
    stays = walk.steps == 0
    if not stays.any() or stays.all():
        return walk.weights
    found = walk.weights * np.where(stays, AS_LIKELY / STAYS, (1 - AS_LIKELY) / (1 - STAYS))
    return np.asarray(found / found.sum())


def _of_step(n: int, h: float, tau: float) -> float:
    """Return the variance of the slope by a walk with steps of variance 1, and this correlation time."""
    a = math.exp(-1 / tau)  # 1 of a walk without bounds
    return slope_variance(n, h, lambda lam: 1 / ((1 - a) ** 2 + 4 * a * np.sin(lam / 2) ** 2))
