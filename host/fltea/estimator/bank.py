"""Run the filters of all axes of one sensor, from the start-up window to the test of the innovations.

One native call processes a whole block of samples (host/native/axis_bank.hpp). The results do not depend on
how samples are grouped into blocks, not even in the last bit.
"""

import math
import zlib
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from fltea import _native
from fltea.estimator.baseline import Baseline, BaselineRule, Moments
from fltea.estimator.engine import CAUSES, instruction_sets, interventions_of
from fltea.estimator.filter_model import FilterModel
from fltea.estimator.lane_settings import LaneSettings, native_table
from fltea.estimator.lanes import LaneBlock, Lost
from fltea.estimator.snapshot import OnlineState
from fltea.settings.estimator import EstimatorConfig
from fltea.spectrum.innovation_whiteness import describes

_T = TypeVar("_T")


class Variances(NamedTuple):
    """The variances that the filters of an axis use, in the square of the sensor's unit.

    `Q`: variance that one step adds to the state of the noise. `R`: variance of the white part of the
    measurement.
    """

    Q: float
    R: float


class Bank:
    """Finds bias and R in the start-up window, and runs the filters from the first sample after it.

    `axes`: names, at least one. `h`: sampling period [s]. `resolution`: size of one LSB in the sensor's unit,
    None if unknown. `state`: a result of `save`, to continue without a start-up window. `variances`: the
    present Q and R of each axis. `tuned`: axes whose Q and R were set by `retune`. `filter_models`: order and
    parameter that `retune` set together with Q and R.

    Raises:
        ValueError: no filter works with the settings, or the state does not fit them or is not valid.
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
        self.native = _native.Bank(len(self.axes))
        self._instruction_set = instruction_sets()[0]
        self._settings: LaneSettings | None = None
        self.variances: dict[str, Variances] = {}
        self.tuned: set[str] = set()
        self._set_filter_models({})
        if state is not None:
            self._resume(state)
        elif not self.startup_remaining:
            self._begin(self._rule.baseline_of([]))

    def run(self, y: ArrayLike) -> LaneBlock:
        """Process n samples of every axis, (n, axes), in the sensor's unit.

        The result has one lane (column) for each axis.

        Until the start-up window is full there are no estimates: all results are NaN, and a call may have at
        most `startup_remaining` samples. Raises ValueError, and changes nothing, for more samples in that
        time, for a wrong shape, and for numbers that are not finite or far too large.
        """
        rows = np.ascontiguousarray(y, dtype=np.float64)
        if rows.ndim != 2 or rows.shape[1] != len(self.axes):
            raise ValueError(
                f"y must have the axes {', '.join(self.axes)} in its last axis, got {rows.shape}"
            )
        n = len(rows)
        fills = self.baseline is None
        if fills and n > self.startup_remaining:
            raise ValueError(f"{n} samples, but the start-up window takes {self.startup_remaining} more")
        out = np.empty((7, n, len(self.axes)))
        valid, white = np.empty((2, n, len(self.axes)), dtype=bool)
        lost = self.native.run(rows, out, valid.view(np.uint8), white.view(np.uint8))
        if fills:
            self.startup_remaining -= n
            if not self.startup_remaining:
                self.fill()
        return LaneBlock._make((*out, valid, [Lost(*one) for one in lost], white))

    def fill(self) -> None:
        """Start the filters of all axes after the start-up window. Estimates begin with the next sample."""
        window = [Moments(*axis) for axis in self.native.window(self._rule.resolution)]
        self._begin(self._rule.baseline_of(window))

    def on_missing(self, count: int) -> list[Lost]:
        """Bridge `count` lost samples by prediction alone. In the start-up window lost samples are ignored.

        Returns the axes whose estimates became invalid meanwhile. `Lost.row` counts from the first lost
        sample, which is row 0.
        """
        return [Lost(*one) for one in self.native.skip(count)]

    def retune(
        self, variances: Mapping[str, Variances], filter_models: Mapping[str, FilterModel] | None = None
    ) -> None:
        """Change the variances of axes from the next sample on, also for later restarts of the filters.

        The filters keep their states and memory. `filter_models`: new orders and parameters for some of these
        axes, which replace the present estimates, since those were made with the old variances. Raises
        ValueError, and changes nothing, in the start-up window, for unknown or constant axes, and for values
        that are invalid.
        """
        filter_models = filter_models or {}
        if self.baseline is None or self._settings is None:
            raise ValueError("the start-up window is not full")
        for axis in variances:
            if axis not in self.axes or axis in self.baseline.constant_axes:
                raise ValueError(f"{axis} is not estimated")
        for axis, filter_model in filter_models.items():
            if axis not in variances or not filter_model.is_sound:
                raise ValueError(f"the filters of {axis} cannot continue with {filter_model}")
        in_use = {**self.variances, **variances}
        settings = self._settings_of([in_use[axis] for axis in self.axes])
        self.native.retune(native_table(settings.table(len(self.axes))))
        self._settings, self.variances = settings, in_use
        self.tuned |= set(variances)
        for axis, filter_model in filter_models.items():
            joint = self._config.variant == "joint"
            numbers = filter_model.of_joint() if joint else filter_model.of_triple()
            self.native.set_filter_model(self.axes.index(axis), *numbers)
        self._set_filter_models(
            {axis: one for axis, one in self.filter_models.items() if axis not in variances}
            | {**filter_models}
        )

    def found(self, axis: str) -> tuple[float, float]:
        """Return the order of an axis after the last sample, and its standard deviation; NaN if not valid."""
        return self.native.newest(self.axes.index(axis))

    @property
    def restarts(self) -> dict[str, int]:
        """Number of restarts of each axis's filters."""
        return self._by_axis(self.native.restarts, 0)

    @property
    def interventions(self) -> dict[str, dict[str, int]]:
        """For each axis and cause, the number of samples at which a limit changed an estimate.

        They are counted since the last start of the axis's filters. Causes that did not occur are left out.
        """
        none: dict[str, int] = {}
        return self._by_axis(self._counts, none)

    @property
    def lag1(self) -> dict[str, float | None]:
        """Correlation of successive innovations of each axis; None until there are enough innovations."""
        return self._of_innovations(lambda lag1, nis, ljung_box, samples: _finite(lag1))

    @property
    def nis(self) -> dict[str, float | None]:
        """Mean normalised innovation squared (NIS) of each axis; None until there are enough innovations."""
        return self._of_innovations(lambda lag1, nis, ljung_box, samples: _finite(nis))

    @property
    def is_white(self) -> dict[str, bool | None]:
        """Whether the last innovations of each axis are white; None until there are enough innovations."""
        return self._of_innovations(
            lambda lag1, nis, ljung_box, samples: (
                describes(samples, ljung_box) if math.isfinite(ljung_box) else None
            )
        )

    def save(self) -> OnlineState | None:
        """Return the state for a later bank; None in the start-up window, and if an axis is constant."""
        base, settings = self.baseline, self._settings
        if base is None or settings is None or base.constant_axes:
            return None
        engine, supervisors, whiteness = self.native.save()
        Q, R = zip(*(self.variances[axis] for axis in self.axes), strict=True)
        return OnlineState(
            self.axes,
            base.bias_dps,
            R,
            self.restarts,
            engine,
            zlib.crc32(engine),
            self._instruction_set,
            settings.digest(len(self.axes)),
            supervisors,
            Q,
            tuple(axis for axis in self.axes if axis in self.tuned),
            self.filter_models,
            whiteness,
        )

    def _set_filter_models(self, filter_models: dict[str, FilterModel]) -> None:
        """Store the fitted orders and parameters. The σ of α and f that are reported are those of the fit."""
        self.filter_models = filter_models
        known = map(filter_models.get, self.axes)
        self.native.know([one and (one.alpha, one.alpha_std, one.f, one.f_std) for one in known])

    def _settings_of(self, variances: Sequence[Variances]) -> LaneSettings:
        Q, R = zip(*variances, strict=True)
        return LaneSettings(self._config, self._h, R, {"state.Q": Q})

    def _by_axis(self, values: Callable[[], Sequence[_T]], otherwise: _T) -> dict[str, _T]:
        """Return a value for each axis by name. `values`: function that returns the values of all axes.

        The value is `otherwise` for an axis whose samples never change, and for all axes in the start-up
        window.
        """
        if self.baseline is None:
            return dict.fromkeys(self.axes, otherwise)
        constant = self.baseline.constant_axes
        return {
            axis: otherwise if axis in constant else value
            for axis, value in zip(self.axes, values(), strict=True)
        }

    def _counts(self) -> list[dict[str, int]]:
        counts = interventions_of(self.native, len(self.axes)).tolist()
        return [{cause: n for cause, n in zip(CAUSES, row, strict=True) if n} for row in counts]

    def _of_innovations(self, figure: Callable[[float, float, float, int], _T]) -> dict[str, _T]:
        return {axis: figure(*one) for axis, one in zip(self.axes, self.native.whiteness(), strict=True)}

    def _begin(self, baseline: Baseline, Q: Sequence[float] | None = None) -> None:
        """Start the filters. A constant axis gets an arbitrary R, since its estimates are not used."""
        live = [axis not in baseline.constant_axes for axis in self.axes]
        R = [R if alive else 1.0 for R, alive in zip(baseline.R, live, strict=True)]
        variances = [Variances(*one) for one in zip(Q or [self._config.state.Q] * len(R), R, strict=True)]
        self.variances = dict(zip(self.axes, variances, strict=True))
        self._settings = self._settings_of(variances)
        table = self._settings.table(len(self.axes))
        self.native.start(
            *self._settings.native(self._instruction_set, table),
            np.array(baseline.bias_dps, dtype=np.float64),
            np.array(live, dtype=np.uint8),
        )
        self.baseline = baseline
        self.startup_remaining = 0

    def _resume(self, state: OnlineState) -> None:
        state.check(self.axes)
        self._instruction_set = state.instruction_set
        self._begin(Baseline(state.bias_dps, state.R, ()), state.Q)
        self.tuned = set(state.tuned)
        self._set_filter_models(state.filter_models)
        assert self._settings is not None
        if self._settings.digest(len(self.axes)) != state.settings:
            raise ValueError("it was saved with other settings")
        restarts = [state.restarts.get(axis, 0) for axis in self.axes]
        self.native.load(state.engine, state.supervisors, restarts, state.whiteness)


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
