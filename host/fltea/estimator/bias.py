"""The arithmetic of the start-up window in numpy, sample by sample; `baseline` says what it is for."""

import math
from collections.abc import Sequence
from typing import Literal

import numpy as np

from fltea.estimator.baseline import Baseline, BaselineRule

__all__ = ["Baseline", "Startup"]


class Startup(BaselineRule):
    """Collects `length` samples and turns them into a Baseline; arguments and errors as of `BaselineRule`."""

    def __init__(
        self,
        axes: Sequence[str],
        length: int,
        bias: Literal["startup", "none"] | float | Sequence[float],
        R: Literal["auto"] | float | Sequence[float],
        resolution_dps: float | None = None,
    ) -> None:
        super().__init__(axes, length, bias, R, resolution_dps)
        self._floor = self.resolution**2 / 12
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
