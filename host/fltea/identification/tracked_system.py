"""Build the tracked system of an axis, which is the state-space model for its tracker.

Forecast, bias, filters and simulations of the axis use this model.

The model consists of the parts of the noise that were fitted to the spectrum and of a random walk of the
offset. The fit leaves out noise so slow that the record has fewer than ten periods of it, so the offset may
walk although no fitted part is a walk.
"""

import math
from collections.abc import Sequence
from typing import Literal

import msgspec
import numpy as np

from fltea.estimator.offset_walk import SHARES, OffsetWalk
from fltea.identification.forecast_judge import FittedSystem, fitted_system
from fltea.noise.parts import Part, high_pass_of
from fltea.records.arrays import Array
from fltea.records.fit import Interval

TOLD_AT = 900.0
"""A record of n samples shows a random walk if q n² / level is at least this. q is the variance of the walk's
steps, and level is the level of the spectrum.

In four of five records, a walk of this size can be told from a constant offset (measured on 40 records of
white noise).
"""
Said = Literal["walks", "likely constant", "not told", "taken out"]
LIKELY = 0.5
SURE = 0.95


class OffsetWalkFound(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Whether the offset of an axis walks. K and its bound are in the unit of the axis per √s."""

    said: Said
    """Whether the offset walks. `not told`: the record is too short to decide. `taken out`: a high-pass has
    removed any walk.
    """
    K: Interval
    """K of the random walk; null unless `said` is `walks`."""
    at_most: float | None
    """Upper bound of K with 95 % probability. Null if `said` is `walks` or `taken out`, or if there is no
    bound.
    """
    tells_s: float | None
    """Length of a record that would show whether the offset walks [s]. Null if `said` is not `not told`, or
    if this length is not known.
    """


def tracked_system(parts: Sequence[Part], y: Array, h: float) -> FittedSystem | None:
    """Return the state-space model by which the bias of samples y (n,) without a gap is tracked.

    `parts`: the parts of the samples' noise. Return None if no Kalman filter works with these parts.
    """
    try:
        return fitted_system(parts, y, h)
    except (ValueError, ArithmeticError):
        return None


def offset_walk_found(tracked: FittedSystem, h: float, K: Interval) -> OffsetWalkFound:
    """Return whether the offset of an axis walks.

    `K`: interval of K by the fit of the spectrum; null if no fitted part is a walk.

    Even if the fit has found a walk, the result has the K of the tracker if there is one: the tracker also
    uses noise slower than the fitted spectrum.
    """
    walk = tracked.walk
    if high_pass_of(tracked.parts) is not None:
        return OffsetWalkFound("taken out", Interval(), None, None)
    if K.value is not None:
        own = walk.K(h) if walk.is_found else Interval()
        return OffsetWalkFound("walks", K if own.value is None else own, None, None)
    if walk.is_found:
        return _in_place_of_a_relaxation(walk, h)
    if walk.is_certain:
        return OffsetWalkFound("walks", walk.K(h), None, None)
    # no random walks were compared with a constant offset, since its likelihood could not be computed
    if not (walk.steps > 0).any():
        return OffsetWalkFound("not told", Interval(), None, None)
    steps, at = np.unique(walk.steps, return_inverse=True)
    stays, *others = np.bincount(at, walk.weights).tolist()
    weights, steps = np.array(others), steps[1:]
    at_most = math.sqrt(_quantile(steps, weights, SURE) / h)
    if stays >= LIKELY:
        return OffsetWalkFound("likely constant", Interval(), at_most, None)
    q = float(weights @ steps) / float(weights.sum())
    # A walk has more power at longer periods: it grows with the square of the period. So at the longest
    # periods of a record, the ratio of the walk's power to the level of the spectrum grows with the square of
    # the record's length.
    longer = math.sqrt(max(TOLD_AT / (SHARES[0] * q / float(steps[0])), 1.0))
    return OffsetWalkFound("not told", Interval(), at_most, longer * tracked.samples * h)


def _in_place_of_a_relaxation(walk: OffsetWalk, h: float) -> OffsetWalkFound:
    """Return whether the offset walks, if the fit of the spectrum has found a slow relaxation.

    The relaxation may be an unbounded walk. The tracker's probabilities of unbounded walks decide.
    """
    steps, at = np.unique(walk.steps, return_inverse=True)
    weights = np.asarray(np.bincount(at, walk.weights * np.isinf(walk.taus)), dtype=np.float64)
    if (endless := float(weights.sum())) >= SURE:
        return OffsetWalkFound("walks", walk.K(h), None, None)
    at_most = math.sqrt(_quantile(steps, weights, SURE) / h)
    said: Said = "likely constant" if 1 - endless >= LIKELY else "not told"
    return OffsetWalkFound(said, Interval(), at_most, None)


def _quantile(steps: Array, weights: Array, share: float) -> float:
    total = np.cumsum(weights) - weights / 2
    return float(np.exp(np.interp(share * weights.sum(), total, np.log(steps))))
