"""Build the tracked system of an axis: the state-space model for its tracker.

Forecast, bias, filters and simulations use it.

It consists of the parts of the noise and of a random walk of the offset. The spectrum leaves out noise slower
than ten periods of a record, so the offset may walk although no part of the model is a walk.
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
"""Variance of a walk's step, times n² / (level of the spectrum), from which a record shows the walk.

In four of five records of n samples, it is then told from a constant offset (measured: white noise, 40
records).
"""
Said = Literal["walks", "likely constant", "not told", "taken out"]
LIKELY = 0.5
SURE = 0.95


class OffsetWalkFound(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Whether the offset of an axis walks; figures per √s, in the unit of the axis."""

    said: Said
    """The answer; `not told`: the record is too short. `taken out`: a high-pass has removed any walk."""
    K: Interval
    """K of the random walk; null unless the offset walks."""
    at_most: float | None
    """Upper bound of K with 95 % probability; null if the offset walks."""
    tells_s: float | None
    """Length of a record that would be enough to decide, if `said` is `not told` [s]; null if not known."""


def tracked_system(parts: Sequence[Part], y: Array, h: float) -> FittedSystem | None:
    """Return the tracked system of samples y (n,) without a gap; None if no filter works with the noise."""
    try:
        return fitted_system(parts, y, h)
    except (ValueError, ArithmeticError):
        return None


def offset_walk_found(tracked: FittedSystem, h: float, K: Interval) -> OffsetWalkFound:
    """Return whether the offset walks. `K`: K of the parts, null if no part is a walk.

    Even if the spectrum shows a walk, K comes from the tracker, which also uses slower noise.
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
    if not (walk.steps > 0).any():  # the likelihood of a constant offset could not be computed
        return OffsetWalkFound("not told", Interval(), None, None)
    steps, at = np.unique(walk.steps, return_inverse=True)
    stays, *others = np.bincount(at, walk.weights).tolist()
    weights, steps = np.array(others), steps[1:]
    at_most = math.sqrt(_quantile(steps, weights, SURE) / h)
    if stays >= LIKELY:
        return OffsetWalkFound("likely constant", Interval(), at_most, None)
    q = float(weights @ steps) / float(weights.sum())
    # The power of a walk, relative to the spectrum's level, grows with the square of the record's length.
    longer = math.sqrt(max(TOLD_AT / (SHARES[0] * q / float(steps[0])), 1.0))
    return OffsetWalkFound("not told", Interval(), at_most, longer * tracked.samples * h)


def _in_place_of_a_relaxation(walk: OffsetWalk, h: float) -> OffsetWalkFound:
    """Return whether a part that the fit of the spectrum made a slow relaxation is an unbounded walk."""
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
