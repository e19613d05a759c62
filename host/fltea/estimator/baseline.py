"""The baseline is what must be known of the data before the first estimate: offset and variance.

The algorithm assumes noise of zero mean and of known measurement variance R, and it is not forgiving. An
offset of 1 deg/s on white noise of variance 0.0235 (deg/s)² makes the printed algorithm diverge, as does an
R four times too small; a real MPU-9250 has offsets of up to ±5 deg/s. Therefore the first samples, the
start-up window, are collected with the device at rest: their mean is the bias, their variance is R. The
arithmetic is in firmware/core/engine/baseline.hpp.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from fltea import _native
from fltea.records.arrays import Array
from fltea.settings.estimator import LARGEST, EstimatorConfig


class Baseline(NamedTuple):
    """Holds what the start-up window found, with one entry for each axis."""

    bias_dps: tuple[float, ...]
    """to be subtracted from each sample"""
    R: tuple[float, ...]
    """measurement variance in (deg/s)²; NaN for the axes in `constant_axes`"""
    constant_axes: tuple[str, ...]
    """axes that never changed: they give no R, so they are invalid"""


class Moments(NamedTuple):
    """Describes the samples of one axis in a start-up window."""

    mean: float
    variance: float
    """n-1 in the denominator; at least that of rounding to the resolution"""
    constant: bool


class BaselineRule:
    """Knows which of bias and R the settings give, and takes the others from the start-up window.

    `resolution` is the size of one count in the axes' unit, if known: its quantisation variance,
    resolution²/12, is the least that R "auto" gives. `needed` is how many samples the window has, 0 if
    nothing is drawn from it.

    Raises:
        ValueError: settings with another number of axes, or a resolution that is none.
    """

    def __init__(self, axes: Sequence[str], config: EstimatorConfig, resolution: float | None = None) -> None:
        self.axes = tuple(axes)
        self._given_bias = self._given("bias", 0.0 if config.bias == "none" else config.bias)
        self._given_R = self._given("R", config.R)
        if resolution is not None and not (math.isfinite(resolution) and resolution > 0):
            raise ValueError(f"the resolution is the size of one count and must be > 0, got {resolution}")
        self.resolution = resolution or 0.0
        self.needed = config.startup_needed

    def baseline_of(self, window: Sequence[Moments]) -> Baseline:
        """Return the baseline after a window with these moments; it is empty where no window is needed."""
        bias = self._given_bias
        if bias is None:
            bias = tuple(axis.mean for axis in window)
        if self._given_R is not None:
            return Baseline(bias, self._given_R, ())
        # A variance that no filter can work with is as good as none.
        still = [axis.constant or axis.variance < 1 / LARGEST for axis in window]
        R = tuple(math.nan if same else axis.variance for axis, same in zip(window, still, strict=True))
        return Baseline(bias, R, tuple(axis for axis, same in zip(self.axes, still, strict=True) if same))

    def _given(self, name: str, value: str | float | list[float]) -> tuple[float, ...] | None:
        """Return the value of each axis; None if the window has to give them."""
        if isinstance(value, str):
            return None
        values = tuple(value) if isinstance(value, list | tuple) else (value,) * len(self.axes)
        if len(values) != len(self.axes):
            raise ValueError(f"{name} needs one value, or {len(self.axes)}, got {list(values)}")
        return tuple(map(float, values))


def baseline_of(y: ArrayLike, axis: str, config: EstimatorConfig, resolution: float | None) -> Baseline:
    """Return bias and R of one axis from its first samples, y (n,), or from the settings.

    Raises:
        ValueError: settings as for `BaselineRule`, or fewer samples than the window needs.
    """
    rule = BaselineRule((axis,), config, resolution)
    window = np.array(np.asarray(y)[: rule.needed], dtype=np.float64)[:, np.newaxis]
    if len(window) < rule.needed:
        raise ValueError(f"the start-up window needs {rule.needed} samples, there are {len(window)}")
    found = _native.moments(window, rule.resolution) if rule.needed else []
    return rule.baseline_of([Moments(*axis) for axis in found])


def lane_baselines(window: Array, config: EstimatorConfig, resolution: float | None) -> tuple[Array, Array]:
    """Return bias and R, (lanes,) each, of lanes that all have the settings of one axis.

    window: their start-up windows, (n, lanes). R may be 0 where a lane never changed.
    """
    bias, R = np.zeros(window.shape[1]), np.zeros(window.shape[1])
    if len(window):
        bias, R, _ = np.array(_native.moments(np.ascontiguousarray(window), resolution or 0.0)).T
    if config.bias != "startup":
        bias = np.full_like(bias, 0.0 if isinstance(config.bias, str) else np.ravel(config.bias)[0])
    if config.R != "auto":
        R = np.full_like(R, np.ravel(config.R)[0])
    return bias, R
