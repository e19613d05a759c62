"""Identification of the noise of several gyroscope axes at once.

Each axis is a system of its own with one state, one output and no input (Macias & Sierociuk 2023, section 7):

    D^α x = f x + ω,    y - bias = x + v,    var v = R

with y, x in deg/s, f in s^-α and time in s. A negative f pulls x back to zero.

Rule of restart: the printed algorithm can diverge. An axis is lost when its estimate is no longer finite or
its order is beyond ±LOST_ORDER. It is then reported once with `valid=False`, counted in `restarts`, and
begins again at the next sample from its initial conditions with an empty memory. The other axes do not
notice.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from fltea.estimator.lanes import LOST_ORDER, Reason
from fltea.lab.reference import filters as reference
from fltea.settings.duration import known
from fltea.settings.estimator import EstimatorConfig


class AxisEstimate(NamedTuple):
    """Estimate of one axis after one sample.

    The standard deviations are the filters' own and say how much the estimate moves, not how far it is from
    the truth. After a missing sample the innovation is NaN. With `valid=False` every number is NaN.
    """

    alpha: float
    alpha_std: float
    f: float
    """in s^-α"""
    f_std: float
    state_dps: float
    """noise state x, bias removed"""
    innovation_dps: float
    """measurement minus prediction"""
    innovation_std_dps: float
    valid: bool


_NAN = math.nan
INVALID = AxisEstimate(_NAN, _NAN, _NAN, _NAN, _NAN, _NAN, _NAN, valid=False)


class GyroscopeEstimator:
    """FLTEA for named axes; `step` takes one sample of all of them.

    `lost` holds, after a step, the axes that have just become invalid and why.

    Arguments, each with one entry an axis where it is a sequence: `R`, measurement variances in (deg/s)²,
    used in all three filters as in the paper; `bias` in deg/s, subtracted before anything else; `h`,
    sampling time in s. Raises ValueError for wrong counts, R <= 0, h <= 0 or numbers that are not finite.
    """

    def __init__(
        self,
        axes: Sequence[str],
        R: Sequence[float],
        bias: Sequence[float],
        h: float,
        settings: EstimatorConfig | None = None,
    ) -> None:
        self.axes = tuple(axes)
        if len(set(self.axes)) != len(self.axes):
            raise ValueError(f"axes must have different names, got {self.axes}")
        if not len(self.axes) == len(R) == len(bias):
            raise ValueError(f"{len(self.axes)} axes need as many R and bias, got {len(R)} and {len(bias)}")
        if not all(math.isfinite(b) for b in bias):
            raise ValueError(f"bias must be finite, got {tuple(bias)}")
        for axis, variance in zip(self.axes, R, strict=True):
            if not (math.isfinite(variance) and variance > 0):
                raise ValueError(f"R of {axis} is a variance in (deg/s)² and must be > 0, got {variance}")
        self.R = tuple(R)
        self.bias = tuple(bias)
        self.h = h
        self.settings = EstimatorConfig() if settings is None else settings
        if abs(self.settings.order.alpha0) > LOST_ORDER:
            raise ValueError(f"alpha0 must lie within ±{LOST_ORDER:g}, got {self.settings.order.alpha0}")
        self.restarts = dict.fromkeys(self.axes, 0)
        self.lost: dict[str, Reason] = {}
        self._filters = [self._start(R_axis) for R_axis in self.R]

    def step(self, y_dps: Sequence[float] | None) -> dict[str, AxisEstimate]:
        """Take one sample in deg/s of all axes, or None for a missing one; return an estimate for each axis.

        A missing sample makes a prediction-only step. A sample with a wrong count or a number that is not
        finite raises ValueError and leaves every axis as it was: once in the memory, a NaN would stay for a
        whole window.
        """
        if y_dps is not None:
            if len(y_dps) != len(self.axes):
                raise ValueError(f"expected {len(self.axes)} axes in a sample, got {len(y_dps)}")
            for axis, y in zip(self.axes, y_dps, strict=True):
                if not math.isfinite(y):
                    raise ValueError(f"{axis} is {y}: pass None for a missing sample")
        self.lost = {}
        return {
            axis: self._step_axis(i, None if y_dps is None else y_dps[i]) for i, axis in enumerate(self.axes)
        }

    def _step_axis(self, i: int, y: float | None) -> AxisEstimate:
        step = self._filters[i].step(None if y is None else y - self.bias[i])
        if abs(step.order) > LOST_ORDER or not step.finite:
            self.lost[self.axes[i]] = "runaway"
            self.restarts[self.axes[i]] += 1
            self._filters[i] = self._start(self.R[i])
            return INVALID
        return AxisEstimate(
            alpha=step.order,
            alpha_std=_std(step.order_variance),
            f=float(step.w[0]),
            f_std=_std(step.Pw[0, 0]),
            state_dps=float(step.x[0]),
            innovation_dps=float(step.innovation[0]),
            innovation_std_dps=_std(step.innovation_variance[0, 0]),
            valid=True,
        )

    def _start(self, R: float) -> reference.Fltea:
        state, order, parameter = self.settings.state, self.settings.order, self.settings.parameter
        return reference.Fltea(
            reference.System(A=_as_matrix, B=None, C=np.eye(1), h=self.h),
            reference.OrderSettings(P0=order.P0, Q0=order.Q0, alpha0=order.alpha0, R=R, delta=order.delta),
            reference.ParameterSettings(
                P0=parameter.P0, Q0=parameter.Q0, w0=parameter.f0, R=R, delta=parameter.delta
            ),
            reference.StateSettings(P0=state.P0, Q=state.Q, x0=state.x0, R=R),
            window=known("window", self.settings.window),
        )


def _as_matrix(w: reference.Array) -> reference.Array:
    """A(w) = f of section 7 as a 1 x 1 matrix."""
    return w.reshape(1, 1)


def _std(variance: float) -> float:
    """Square root that takes the rounding error of a vanishing variance for zero."""
    return math.sqrt(max(variance, 0.0))
