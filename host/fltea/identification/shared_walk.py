"""Estimate one common figure for the random walk of the offset on all axes of a sensor, if they agree.

The axes of a sensor are built alike. Each axis alone hardly shows the size of its random walk, or the
correlation time that bounds it. So the likelihoods of the axes are multiplied, if a random walk of one size
for all axes explains the samples at least as well as a size for each axis. Each axis keeps its own slope of
the offset, since axes that warm up drift in different directions.
"""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from fltea.estimator.offset_walk import STAYS, OffsetWalk, walks_tried, without_walk
from fltea.identification.forecast_judge import FittedSystem
from fltea.records.arrays import Array

A_DECADE = 4
"""Number of values in each decade that are tried for the variance of a walk's steps."""
UNLIKELY = 1e-300


def shared_walk(tracked: Mapping[str, FittedSystem], h: float) -> dict[str, FittedSystem]:
    """Return the tracked system of each axis of a sensor, by name, with one random walk for all if possible.

    A tracked system is the state-space model for the tracker of an axis. Its random walk has a step variance,
    and a correlation time that bounds it. The axes get the same probabilities for both. If the spectrum
    itself shows a walk, each axis keeps its own step variance, and only the correlation time is common.

    Systems are returned unchanged if separate walks explain the samples better than a common one. They are
    also unchanged without a second axis of the same kind: the spectrum shows a walk on both axes or on
    neither, and the same correlation times were tried for both (none is tried for noise with an order).
    """
    alike: dict[tuple[bool, tuple[float, ...]], list[str]] = {}
    for name, one in tracked.items():
        if (one.walk.steps > 0).any():
            kind = one.walk.is_found, tuple(np.unique(one.walk.taus))
            alike.setdefault(kind, []).append(name)
    found = dict(tracked)
    for (is_found, taus), names in alike.items():
        agree = _agreed_bounds if is_found else _agreed
        walks = agree([tracked[name].walk for name in names], taus) if len(names) > 1 else []
        found |= {name: _with(tracked[name], walk, h) for name, walk in zip(names, walks, strict=False)}
    return found


def _agreed_bounds(walks: list[OffsetWalk], taus: tuple[float, ...]) -> list[OffsetWalk]:
    """Return the walks with common probabilities of the correlation times; an empty list if axes disagree.

    An infinite correlation time stands for an unbounded walk, a finite one for a bounded walk (a relaxation).
    Each axis keeps its own probabilities of the step variances that were tried with a correlation time.
    """
    prior = _prior(walks[0].steps[:1].tolist(), taus, stays=0.0)
    own = np.array([[walk.weights[walk.taus == tau].sum() for tau in taus] for walk in walks])
    own = np.maximum(own, UNLIKELY)
    together = (np.log(own) - np.log(prior)).sum(axis=0)
    weights = prior * np.exp(together - together.max())
    if math.log(weights.sum()) + together.max() < 0:
        return []
    shares = weights / weights.sum() / own
    return [
        walk._replace(weights=walk.weights * share[np.searchsorted(taus, walk.taus)])
        for walk, share in zip(walks, shares, strict=True)
    ]


def _prior(steps: list[float], taus: Sequence[float], stays: float) -> Array:
    """Return the prior probabilities of the random walks that are tried.

    The walks are in rising order of their step variance. Walks of equal step variance are in rising order of
    their correlation time.
    """
    tried = sorted(walks_tried(steps, [one for one in taus if math.isfinite(one)], stays))
    return np.array([weight for _, _, weight in tried])


def _agreed(walks: list[OffsetWalk], taus: tuple[float, ...]) -> list[OffsetWalk]:
    """Return the walks of the axes with the same probabilities; an empty list if the axes disagree.

    Each pair of a step variance and a correlation time has one probability, which holds for all axes. An
    infinite correlation time stands for a walk without a bound.
    """
    low = min(float(walk.steps[walk.steps > 0].min()) for walk in walks)
    high = max(float(walk.steps.max()) for walk in walks)
    steps = np.geomspace(low, high, round(A_DECADE * math.log10(high / low)) + 1).tolist()
    q, tau, prior = np.array(list(walks_tried(steps, [one for one in taus if math.isfinite(one)], STAYS))).T
    # logarithm of the likelihood of each random walk with each slope of the offset, (axes, walks, slopes)
    likely = np.array([_log_likelihoods(walk, q, tau) for walk in walks])
    by_walk = np.log(np.exp(likely).sum(axis=2))
    each = np.log(np.exp(by_walk) @ prior).sum()
    together = by_walk.sum(axis=0)
    weights = prior * np.exp(together - together.max())
    if math.log(weights.sum()) + together.max() < each:
        return []
    weights /= weights.sum()
    return [_of_axis(walk, q, tau, weights, own) for walk, own in zip(walks, likely, strict=True)]


def _log_likelihoods(walk: OffsetWalk, q: Array, tau: Array) -> Array:
    """Return the logarithm of the likelihood of each walk with each slope of the offset, (walks, slopes).

    `q`, `tau`: step variance and correlation time of each walk. The slopes are those that were tried. All
    logarithms lack the same constant.

    The likelihood includes the prior probability of the slope, but not that of the walk.
    """
    steps, taus, _, weights = walk.by_walk
    bounds = [one for one in np.unique(taus) if math.isfinite(one)]
    known = np.unique(steps[steps > 0])
    prior = np.array([weight for _, _, weight in walks_tried(known.tolist(), bounds, STAYS)])
    own = np.log(np.maximum(weights, UNLIKELY)) - np.log(prior)[:, None]
    # Only some step variances of a walk were tried. Between them, the logarithm of the likelihood is
    # interpolated. A walk with at most a tenth of the smallest variance gets the likelihood of no walk.
    at = np.log(np.append(known[0] / 10, known))
    found = np.empty((len(q), own.shape[1]))
    for slope, column in enumerate(own.T):
        constant = column[steps == 0]
        found[q == 0, slope] = constant
        for bound in np.unique(taus):
            these = (tau == bound) & (q > 0)
            those = np.append(constant, column[(taus == bound) & (steps > 0)])
            found[these, slope] = np.interp(np.log(q[these]), at, those)
    return found


def _of_axis(walk: OffsetWalk, q: Array, tau: Array, weights: Array, likely: Array) -> OffsetWalk:
    """Return the probability of each walk with each slope of the offset, for one axis.

    `weights`: probabilities of the walks, which are common to all axes. `likely`: logarithms of the
    likelihoods, (walks, slopes), from which this axis gets its own probabilities of the slopes.
    """
    slopes = walk.by_walk[2]
    share = np.exp(likely - likely.max(axis=1, keepdims=True))
    own = weights[:, None] * share / share.sum(axis=1, keepdims=True)
    each = len(slopes)
    return OffsetWalk(np.repeat(q, each), np.repeat(tau, each), np.tile(slopes, len(q)), own.ravel())


def _with(one: FittedSystem, walk: OffsetWalk, h: float) -> FittedSystem:
    bare, _ = without_walk(one.parts, h, one.samples)
    return one._replace(system=walk.system(bare, one.samples), walk=walk)
