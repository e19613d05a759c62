"""All estimated axes of one sensor: start-up window, filters, supervisor and whiteness of the innovations.

One native call takes a whole block of samples (host/native/axis_bank.hpp). However samples are cut into
blocks, the columns are the same to the bit.
"""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fltea import _native
from fltea.estimator import snapshot
from fltea.estimator.baseline import Baseline, BaselineRule, Moments
from fltea.estimator.engine import CAUSES, instruction_sets
from fltea.estimator.lane_settings import LaneSettings, native_table
from fltea.estimator.lanes import Lost
from fltea.estimator.snapshot import OnlineState
from fltea.settings.estimator import EstimatorConfig
from fltea.spectrum.innovation_whiteness import describes

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
_T = TypeVar("_T")


class BankBlock(NamedTuple):
    """What a bank made of a block of samples; columns (n, axes), in the order of the axes.

    In the start-up window there are no estimates: `estimated` is False, the columns are NaN and `valid` is
    False. An axis that is not valid has NaN in every column of its estimates.
    """

    estimated: bool
    alpha: Array
    alpha_std: Array
    """the filter's own"""
    f: Array
    """in s^-α"""
    f_std: Array
    x: Array
    """noise state, bias removed"""
    innovation: Array
    """measurement minus prediction"""
    innovation_std: Array
    valid: Mask
    lost: list[Lost]
    """lanes (places in the axes) that became invalid with a row, row after row"""


class Variances(NamedTuple):
    """What the filters of an axis are told of the noise, in the sensor's unit squared.

    Q: of a step of its source, h^2α included; R: of what is white in the measurement.
    """

    Q: float
    R: float


class Bank:
    """Bias and R from the start-up window, estimates from the first sample after it.

    axes: names, at least one. h: sampling period in s. resolution: one LSB in the sensor's unit, None where
    unknown. state: what `save` returned, to go on from there without a start-up window. variances: of each
    axis, in use; tuned: axes with those of `retune`.

    Raises:
        ValueError: settings that no filter can work with, or a state that does not fit them or is not wholly
            sound; the text says what is wrong.
    """

    def __init__(
        self,
        axes: tuple[str, ...],
        config: EstimatorConfig,
        h: float,
        resolution: float | None,
        state: OnlineState | None = None,
    ) -> None:
        self.axes = tuple(axes)
        self.baseline: Baseline | None = None
        self._config = config
        self._h = h
        self._rule = BaselineRule(self.axes, config, resolution)
        self.startup_remaining = self._rule.needed
        self._native = _native.Bank(len(self.axes))
        self._instruction_set = instruction_sets()[0]
        self._settings: LaneSettings | None = None
        self.variances: dict[str, Variances] = {}
        self.tuned: set[str] = set()
        if state is not None:
            self._resume(state)
        elif not self.startup_remaining:
            self._begin(self._rule.baseline_of([]))

    def run(self, y: ArrayLike) -> BankBlock:
        """Take n samples of every axis in the sensor's unit, (n, axes).

        While the start-up window fills, at most `startup_remaining` of them. Raises ValueError, and changes
        nothing, for more than that, for a wrong shape, and for numbers that are not finite or beyond all
        measure.
        """
        rows = np.ascontiguousarray(y, dtype=np.float64)
        if rows.ndim != 2 or rows.shape[1] != len(self.axes):
            raise ValueError(
                f"y must have the axes {', '.join(self.axes)} in its last axis, got {rows.shape}"
            )
        n = len(rows)
        estimated = self.baseline is not None
        if not estimated and n > self.startup_remaining:
            raise ValueError(f"{n} samples, but the start-up window takes {self.startup_remaining} more")
        out = np.empty((7, n, len(self.axes)))
        valid = np.empty((n, len(self.axes)), dtype=bool)
        lost = self._native.run(rows, out, valid.view(np.uint8))
        if not estimated:
            self.startup_remaining -= n
            if not self.startup_remaining:
                window = [Moments(*axis) for axis in self._native.window(self._rule.resolution)]
                self._begin(self._rule.baseline_of(window))
        return BankBlock._make((estimated, *out, valid, [Lost(*one) for one in lost] if lost else []))

    def on_missing(self, count: int) -> list[Lost]:
        """Bridge lost samples by prediction alone; within the start-up window they do not matter.

        Returns the lanes that became invalid meanwhile; rows count from the first lost sample.
        """
        return [Lost(*one) for one in self._native.skip(count)]

    def retune(self, variances: Mapping[str, Variances]) -> None:
        """Let axes go on with other variances from the next sample on, and where they begin again.

        All that the filters remember stays. Raises ValueError in the start-up window, for axes that are not
        there or constant, and for variances that no filter can work with; nothing changes then.
        """
        if self.baseline is None or self._settings is None:
            raise ValueError("the start-up window is not full")
        for axis in variances:
            if axis not in self.axes or axis in self.baseline.constant_axes:
                raise ValueError(f"{axis} is not estimated")
        told = {**self.variances, **variances}
        settings = self._settings_of([told[axis] for axis in self.axes])
        self._native.retune(native_table(settings.table(len(self.axes))))
        self._settings, self.variances = settings, told
        self.tuned |= set(variances)

    @property
    def restarts(self) -> dict[str, int]:
        """How often each axis had to begin again."""
        if self.baseline is None:
            return dict.fromkeys(self.axes, 0)
        return self._of_live(self._native.restarts(), 0)

    @property
    def interventions(self) -> dict[str, dict[str, int]]:
        """How often the guard stepped in since the last start of each axis, by cause; zeros left out."""
        none: dict[str, int] = {}
        if self.baseline is None:
            return {axis: {} for axis in self.axes}
        counts = np.empty((len(self.axes), len(CAUSES)), dtype=np.int32)
        self._native.counts(counts)
        found = [{cause: n for cause, n in zip(CAUSES, row, strict=True) if n} for row in counts.tolist()]
        return self._of_live(found, none)

    @property
    def lag1(self) -> dict[str, float | None]:
        """Correlation of neighbouring innovations of each axis; None before there are enough."""
        return {
            axis: _finite(lag1) for axis, (lag1, *_) in zip(self.axes, self._native.whiteness(), strict=True)
        }

    @property
    def nis(self) -> dict[str, float | None]:
        """Mean normalised innovation squared of each axis; None before there are enough."""
        return {
            axis: _finite(nis) for axis, (_, nis, *_) in zip(self.axes, self._native.whiteness(), strict=True)
        }

    @property
    def describes_noise(self) -> dict[str, bool | None]:
        """Whether the last innovations of each axis are white enough; None before there are enough."""
        return {
            axis: describes(samples, ljung_box) if math.isfinite(ljung_box) else None
            for axis, (*_, ljung_box, samples) in zip(self.axes, self._native.whiteness(), strict=True)
        }

    def save(self) -> OnlineState | None:
        """What `state` takes; None in the start-up window and with a constant axis."""
        base, settings = self.baseline, self._settings
        if base is None or settings is None or base.constant_axes:
            return None
        state, supervisors = self._native.save()
        table = settings.table(len(self.axes))
        engine = snapshot.pack(len(self.axes), settings, self._instruction_set, table, state)
        told = [self.variances[axis] for axis in self.axes]
        return OnlineState(
            self.axes,
            base.bias_dps,
            tuple(one.R for one in told),
            self.restarts,
            engine,
            supervisors,
            tuple(one.Q for one in told),
            tuple(axis for axis in self.axes if axis in self.tuned),
        )

    def _settings_of(self, told: Sequence[Variances]) -> LaneSettings:
        R, Q = [one.R for one in told], [one.Q for one in told]
        return LaneSettings(self._config, self._h, R, {"state.Q": Q})

    def _of_live(self, values: list[_T], otherwise: _T) -> dict[str, _T]:
        assert self.baseline is not None
        constant = self.baseline.constant_axes
        return {
            axis: otherwise if axis in constant else value
            for axis, value in zip(self.axes, values, strict=True)
        }

    def _begin(self, baseline: Baseline, Q: Sequence[float] | None = None) -> None:
        """Make the lanes: those of constant axes, which nobody looks at, with any R."""
        live = [axis not in baseline.constant_axes for axis in self.axes]
        R = [R if alive else 1.0 for R, alive in zip(baseline.R, live, strict=True)]
        told = [Variances(*one) for one in zip(Q or [self._config.state.Q] * len(R), R, strict=True)]
        self.variances = dict(zip(self.axes, told, strict=True))
        self._settings = self._settings_of(told)
        table = self._settings.table(len(self.axes))
        self._native.start(
            *self._settings.native(self._instruction_set, table),
            np.array(baseline.bias_dps, dtype=np.float64),
            np.array(live, dtype=np.uint8),
        )
        self.baseline = baseline
        self.startup_remaining = 0

    def _resume(self, state: OnlineState) -> None:
        state.check(self.axes)
        saved = snapshot.unpack(state.engine)
        self._instruction_set = saved.instruction_set
        self._begin(Baseline(state.bias_dps, state.R, ()), state.Q)
        self.tuned = set(state.tuned)
        assert self._settings is not None
        saved.check(self._settings)
        restarts = [state.restarts.get(axis, 0) for axis in self.axes]
        self._native.load(saved.state, state.supervisors, restarts)


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
