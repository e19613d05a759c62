"""Estimate the drift rate of an axis, with an interval that allows for slow noise.

The drift rate is the slope of a straight line that is fitted to the samples. Very slow noise changes this
slope most: noise of which the record has fewer than ten periods. The model that was fitted to the spectrum
lacks such noise. But the tracker has tried several random walks of the offset, bounded and unbounded ones,
and knows the probability of each. Each walk gives the slope a variance. These variances, weighted by the
probabilities of the walks, give the interval of the slope.
"""

import math

import numpy as np

from fltea.estimator.offset_walk import STAYS, OffsetWalk
from fltea.identification.forecast_judge import FittedSystem
from fltea.noise.parts import Part, Walk, spectrum
from fltea.records.arrays import Array
from fltea.records.fit import Interval
from fltea.spectrum.drift_rate import around, slope, slope_variance

AS_LIKELY = 0.4
"""Prior probability that the offset does not follow a random walk. It is used for the drift rate's interval.

Even a random walk that is too slow for the record to show it can triple the error of the drift rate. The
tracker itself uses the higher prior `STAYS`. With `STAYS`, the interval would be too narrow too often, since
it would leave out such walks (measured).
"""


def tracked_drift_rate(tracked: FittedSystem, y: Array, h: float) -> Interval:
    """Return the slope of y (n,) per second with its 95 % interval. `h`: sampling period [s]."""
    n, walk = len(y), tracked.walk
    steps = (walk.steps > 0).any()
    parts: list[Part] = [part for part in tracked.parts if not (steps and isinstance(part, Walk))]
    level = slope_variance(n, h, lambda lam: spectrum(parts, lam, h))
    taus, at = np.unique(walk.taus, return_inverse=True)
    of_step = np.array([_of_step(n, h, tau) for tau in taus.tolist()])
    variances = level + walk.steps * of_step[at]
    return around(slope(y, h), variances.tolist(), _weights(walk).tolist())


def _weights(walk: OffsetWalk) -> Array:
    """Return the probability of each random walk that the tracker tried, and that of no walk.

    The tracker's prior for no walk, `STAYS`, is replaced by `AS_LIKELY`.
    """
    stays = walk.steps == 0
    if not stays.any() or stays.all():
        return walk.weights
    found = walk.weights * np.where(stays, AS_LIKELY / STAYS, (1 - AS_LIKELY) / (1 - STAYS))
    return np.asarray(found / found.sum())


def _of_step(n: int, h: float, tau: float) -> float:
    """Return the variance of the fitted slope that comes from a random walk whose steps have variance 1.

    `tau`: correlation time of the walk in samples.
    """
    # `a` is the factor by which the walk is multiplied from sample to sample; 1 if the walk is unbounded
    a = math.exp(-1 / tau)
    return slope_variance(n, h, lambda lam: 1 / ((1 - a) ** 2 + 4 * a * np.sin(lam / 2) ** 2))
