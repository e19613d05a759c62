"""The start-up window: what must be known of the data before the first estimate.

The algorithm assumes noise of zero mean and of known measurement variance R, and it is not forgiving. An
offset of 1 deg/s on white noise of variance 0.0235 (deg/s)² makes the printed algorithm diverge, as does an
R four times too small; a real MPU-9250 has offsets of up to ±5 deg/s. Therefore the first samples are
collected with the device at rest: their mean is the bias, their variance is R.
"""

import math
from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np


class Baseline(NamedTuple):
    """What the start-up window found, one entry an axis."""

    bias_dps: tuple[float, ...]
    """to be subtracted from each sample"""
    R: tuple[float, ...]
    """measurement variance in (deg/s)²; NaN for the axes in `constant_axes`"""
    constant_axes: tuple[str, ...]
    """axes that never changed: they give no R, so they are invalid"""


class Startup:
    """Collects `length` samples and turns them into a Baseline.

    `bias` is "startup" (mean of the window), "none", one value in deg/s, or one an axis. `R` is "auto"
    (variance of the window, n-1 in the denominator), one value in (deg/s)², or one an axis.
    `resolution_dps` is the size of one count, if known: its quantisation variance, resolution²/12, is the
    least that `R="auto"` gives. If neither needs a window, `needed` is 0 and `baseline()` is ready at once.
    Raises ValueError for wrong counts, values that are not finite, R <= 0, or a window too short for its
    purpose.
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
        self._floor = 0.0 if resolution_dps is None else resolution_dps**2 / 12
        shortest = 2 if self._given_R is None else 1 if self._given_bias is None else 0
        if length < shortest:
            raise ValueError(
                f"the start-up window must have at least {shortest} samples, got {length}; "
                "to do without it, give both bias and R"
            )
        self.needed = length if shortest else 0
        self._samples: list[tuple[float, ...]] = []

    def add(self, y_dps: Sequence[float]) -> Baseline | None:
        """Take one sample in deg/s of all axes; return the Baseline once the window is full, until then None.

        Samples beyond the window do not change it. Raises ValueError for a wrong count or numbers not finite.
        """
        if len(y_dps) != len(self.axes):
            raise ValueError(f"expected {len(self.axes)} axes in a sample, got {len(y_dps)}")
        for axis, y in zip(self.axes, y_dps, strict=True):
            if not math.isfinite(y):
                raise ValueError(f"{axis} is {y}: leave missing samples out of the start-up window")
        if len(self._samples) < self.needed:
            self._samples.append(tuple(y_dps))
        return self.baseline() if len(self._samples) == self.needed else None

    def baseline(self) -> Baseline:
        """Return the Baseline; ValueError if samples are still missing."""
        missing = self.needed - len(self._samples)
        if missing:
            raise ValueError(f"the start-up window still needs {missing} of {self.needed} samples")
        window = np.array(self._samples).reshape(self.needed, len(self.axes))
        bias = window.mean(axis=0) if self._given_bias is None else self._given_bias
        constant: tuple[str, ...] = ()
        if self._given_R is None:
            R = np.maximum(window.var(axis=0, ddof=1), self._floor)
            # By comparison and not by the variance, in which rounding leaves a trace of the mean. Also where
            # the resolution is known: a channel that is stuck would else look like a quiet one.
            still = (window == window[0]).all(axis=0)
            constant = tuple(axis for axis, same in zip(self.axes, still, strict=True) if same)
            R[still] = np.nan
        else:
            R = np.array(self._given_R)
        return Baseline(tuple(map(float, bias)), tuple(map(float, R)), constant)

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
        if len(values) != len(self.axes) or not all(math.isfinite(value) for value in values):
            raise ValueError(f"bias needs one finite value in deg/s, or {len(self.axes)}, got {list(values)}")
        return values

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
        return values
