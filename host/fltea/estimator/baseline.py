"""The baseline: what must be known of the data before the first estimate.

The algorithm assumes noise of zero mean and of known measurement variance R, and it is not forgiving. An
offset of 1 deg/s on white noise of variance 0.0235 (deg/s)² makes the printed algorithm diverge, as does an
R four times too small; a real MPU-9250 has offsets of up to ±5 deg/s. Therefore the first samples, the
start-up window, are collected with the device at rest: their mean is the bias, their variance is R. The
arithmetic is in firmware/core/engine/baseline.hpp.
"""

import math
from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fltea import _native
from fltea.estimator.engine_settings import LARGEST
from fltea.settings.estimator import EstimatorConfig

Array = NDArray[np.float64]


class Baseline(NamedTuple):
    """What the start-up window found, one entry an axis."""

    bias_dps: tuple[float, ...]
    """to be subtracted from each sample"""
    R: tuple[float, ...]
    """measurement variance in (deg/s)²; NaN for the axes in `constant_axes`"""
    constant_axes: tuple[str, ...]
    """axes that never changed: they give no R, so they are invalid"""


class Moments(NamedTuple):
    """What the samples of a start-up window were like, of one axis."""

    mean: float
    variance: float
    """n-1 in the denominator; at least that of rounding to the resolution"""
    constant: bool


class BaselineRule:
    """What of bias and R is given, and what the window has to give.

    `bias` is "startup" (mean of the window), "none", one value in deg/s, or one an axis. `R` is "auto"
    (variance of the window), one value in (deg/s)², or one an axis. `resolution_dps` is the size of one
    count, if known: its quantisation variance, resolution²/12, is the least that `R="auto"` gives. `needed`
    is how many samples the window has, 0 if nothing is drawn from it.

    Raises:
        ValueError: wrong counts, values that are not finite or beyond all measure, R <= 0, or a window too
            short for its purpose.
    """

    def __init__(
        self,
        axes: Sequence[str],
        length: int,
        bias: Literal["startup", "none"] | float | Sequence[float],
        R: Literal["auto"] | float | Sequence[float],
        resolution_dps: float | None = None,
    ) -> None:
        self.axes = tuple(axes)
        self._given_bias = self._check_bias(bias)
        self._given_R = self._check_R(R)
        if resolution_dps is not None and not (math.isfinite(resolution_dps) and resolution_dps > 0):
            raise ValueError(f"resolution_dps is the size of one count and must be > 0, got {resolution_dps}")
        self.resolution = 0.0 if resolution_dps is None else resolution_dps
        shortest = 2 if self._given_R is None else 1 if self._given_bias is None else 0
        if length < shortest:
            raise ValueError(
                f"the start-up window must have at least {shortest} samples, got {length}; "
                "to do without it, give both bias and R"
            )
        self.needed = length if shortest else 0

    def baseline_of(self, window: Sequence[Moments]) -> Baseline:
        """The baseline after a window with these moments; an empty one where none is needed."""
        bias = self._given_bias
        if bias is None:
            bias = tuple(axis.mean for axis in window)
        if self._given_R is not None:
            return Baseline(bias, self._given_R, ())
        # A variance that no filter can work with is as good as none.
        still = [axis.constant or axis.variance < 1 / LARGEST for axis in window]
        R = tuple(math.nan if same else axis.variance for axis, same in zip(window, still, strict=True))
        return Baseline(bias, R, tuple(axis for axis, same in zip(self.axes, still, strict=True) if same))

    def _check_bias(self, bias: str | float | Sequence[float]) -> tuple[float, ...] | None:
        """Values of the bias, None if the window shall give them."""
        if isinstance(bias, str):
            if bias == "startup":
                return None
            if bias == "none":
                return (0.0,) * len(self.axes)
            raise ValueError(
                f'bias must be "startup", "none" or {len(self.axes)} values in deg/s, got "{bias}"'
            )
        values = (bias,) * len(self.axes) if isinstance(bias, int | float) else tuple(bias)
        if len(values) != len(self.axes) or not all(abs(value) <= _native.LARGEST_OFFSET for value in values):
            raise ValueError(f"bias needs one finite value in deg/s, or {len(self.axes)}, got {list(values)}")
        return tuple(map(float, values))

    def _check_R(self, R: str | float | Sequence[float]) -> tuple[float, ...] | None:
        """Values of R, None if the window shall give them."""
        if isinstance(R, str):
            if R == "auto":
                return None
            raise ValueError(f'R must be "auto" or a variance in (deg/s)², got "{R}"')
        values = (R,) * len(self.axes) if isinstance(R, int | float) else tuple(R)
        if len(values) != len(self.axes):
            raise ValueError(f"R needs one value, or {len(self.axes)}, got {list(values)}")
        for axis, value in zip(self.axes, values, strict=True):
            if not (math.isfinite(value) and value > 0):
                raise ValueError(f"R of {axis} is a variance in (deg/s)² and must be > 0, got {value}")
        return tuple(map(float, values))


def rule_of(axes: Sequence[str], config: EstimatorConfig, resolution: float | None) -> BaselineRule:
    """The rule of an estimator's settings; resolution: one LSB in the axes' unit, None where unknown."""
    return BaselineRule(axes, config.startup_samples, config.bias, config.R, resolution)


def baseline_of(y: ArrayLike, axis: str, config: EstimatorConfig, resolution: float | None) -> Baseline:
    """Bias and R of one axis from its first samples, y (n,), or from the settings.

    Raises:
        ValueError: settings as for `BaselineRule`, or fewer samples than the window needs.
    """
    rule = rule_of((axis,), config, resolution)
    window = np.array(np.asarray(y)[: rule.needed], dtype=np.float64)[:, np.newaxis]
    if len(window) < rule.needed:
        raise ValueError(f"the start-up window needs {rule.needed} samples, there are {len(window)}")
    found = _native.moments(window, rule.resolution) if rule.needed else []
    return rule.baseline_of([Moments(*axis) for axis in found])


def lane_moments(window: Array, resolution: float | None) -> tuple[Array, Array]:
    """Means and variances of start-up windows, (n, lanes): as `Moments`, (lanes,) each."""
    found = _native.moments(np.ascontiguousarray(window), resolution or 0.0)
    mean, variance = (np.array([lane[i] for lane in found]) for i in range(2))
    return mean, variance


def lane_baselines(window: Array, config: EstimatorConfig, resolution: float | None) -> tuple[Array, Array]:
    """Bias and R of lanes that all have the settings of one axis, (lanes,) each.

    window: their start-up windows, (n, lanes). R may be 0 where a lane never changed.
    """
    bias, R = np.zeros(window.shape[1]), np.zeros(window.shape[1])
    if len(window):
        bias, R = lane_moments(window, resolution)
    if config.bias != "startup":
        bias = np.full_like(bias, 0.0 if isinstance(config.bias, str) else np.ravel(config.bias)[0])
    if config.R != "auto":
        R = np.full_like(R, np.ravel(config.R)[0])
    return bias, R
