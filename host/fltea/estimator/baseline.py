"""Find the offset and the variance of the samples, which must be known before the first estimate.

The algorithm assumes noise with zero mean and a known measurement variance R. It does not tolerate errors in
either. An offset of 1 deg/s on white noise of variance 0.0235 (deg/s)² makes the algorithm as printed in the
paper diverge. An R that is four times too small makes it diverge, too; a real MPU-9250 has offsets of up to
±5 deg/s. Therefore the first samples, the start-up window, are taken with the device at rest: their mean is
the bias, their variance is R. The arithmetic is in firmware/core/engine/baseline.hpp.
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
    """Bias and measurement variance from the start-up window, with one entry for each axis."""

    bias_dps: tuple[float, ...]
    """Bias to be subtracted from each sample."""
    R: tuple[float, ...]
    """Measurement variance in (deg/s)²; NaN for the axes in `constant_axes`."""
    constant_axes: tuple[str, ...]
    """Axes whose samples never changed. Such an axis gives no R, so its estimates are invalid."""


class Moments(NamedTuple):
    """Mean and variance of the samples of one axis in a start-up window."""

    mean: float
    variance: float
    """Variance of the samples, with n-1 in the denominator. It is at least the variance of rounding to the
    resolution.
    """
    constant: bool


class BaselineRule:
    """Finds bias and R: in the settings if they are stated there, otherwise from the start-up window.

    `resolution`: size of one count in the axes' unit, if known. The quantisation variance, resolution²/12, is
    the smallest R that "auto" gives. `needed`: number of samples in the start-up window, 0 if no window is
    needed.

    Raises:
        ValueError: the settings have another number of axes, or the resolution is not positive.
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
        """Return bias and variance R of each axis, from its moments in a start-up window.

        `window` is empty if no window is needed.
        """
        bias = self._given_bias
        if bias is None:
            bias = tuple(axis.mean for axis in window)
        if self._given_R is not None:
            return Baseline(bias, self._given_R, ())
        # An axis with a variance below 1 / LARGEST counts as constant: no filter works with such a variance.
        still = [axis.constant or axis.variance < 1 / LARGEST for axis in window]
        R = tuple(math.nan if same else axis.variance for axis, same in zip(window, still, strict=True))
        return Baseline(bias, R, tuple(axis for axis, same in zip(self.axes, still, strict=True) if same))

    def _given(self, name: str, value: str | float | list[float]) -> tuple[float, ...] | None:
        """Return the setting's value for each axis; None if the start-up window has to give the values."""
        if isinstance(value, str):
            return None
        values = tuple(value) if isinstance(value, list | tuple) else (value,) * len(self.axes)
        if len(values) != len(self.axes):
            raise ValueError(f"{name} needs one value, or {len(self.axes)}, got {list(values)}")
        return tuple(map(float, values))


def baseline_of(y: ArrayLike, axis: str, config: EstimatorConfig, resolution: float | None) -> Baseline:
    """Return bias and R of one axis from its first samples, `y` (n,), or from the settings.

    Raises:
        ValueError: the settings are wrong, as in `BaselineRule`, or the window has too few samples.
    """
    rule = BaselineRule((axis,), config, resolution)
    window = np.array(np.asarray(y)[: rule.needed], dtype=np.float64)[:, np.newaxis]
    if len(window) < rule.needed:
        raise ValueError(f"the start-up window needs {rule.needed} samples, there are {len(window)}")
    found = _native.moments(window, rule.resolution) if rule.needed else []
    return rule.baseline_of([Moments(*axis) for axis in found])


def lane_baselines(window: Array, config: EstimatorConfig, resolution: float | None) -> tuple[Array, Array]:
    """Return bias and R of each lane (axis, or copy of one), as two arrays (lanes,).

    All lanes have the settings of one axis. `window`: samples of the lanes' start-up windows, (n, lanes). R
    may be 0 for a lane that never changed.
    """
    bias, R = np.zeros(window.shape[1]), np.zeros(window.shape[1])
    if len(window):
        bias, R, _ = np.array(_native.moments(np.ascontiguousarray(window), resolution or 0.0)).T
    if config.bias != "startup":
        bias = np.full_like(bias, 0.0 if isinstance(config.bias, str) else np.ravel(config.bias)[0])
    if config.R != "auto":
        R = np.full_like(R, np.ravel(config.R)[0])
    return bias, R
