"""The estimated axes of one sensor: estimator, whiteness of samples and innovations, and all as records."""

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import msgspec

from fltea.estimator.online import OnlineEstimator, OnlineState
from fltea.estimator.running_null import RunningNull
from fltea.estimator.supervisor import Reason
from fltea.estimator.whiteness import Whiteness
from fltea.lab.reference import gyroscope
from fltea.records.records import AccelEstimate, AccelStats, AxisEstimate, AxisStats, EstimatorInfo
from fltea.settings.config import EstimatorConfig


class _Figures(NamedTuple):
    """Columns of AxisStats and AccelStats."""

    bias: float | None
    R: float | None
    restarts: int
    interventions: dict[str, int]
    innovation_lag1: float | None
    innovation_nis: float | None


class Channels:
    """Estimates the axes `names`, which are the values at `places` of each sample, in the sensor's unit.

    h: sampling period in s. resolution: one LSB in the sensor's unit, None where unknown. state: what
    `save` returned, to go on from there.

    Raises:
        ValueError: settings that no filter can work with, or a state that does not fit them.
    """

    def __init__(
        self,
        names: Sequence[str],
        places: Sequence[int],
        config: EstimatorConfig,
        h: float,
        resolution: float | None,
        state: OnlineState | None = None,
    ) -> None:
        self.config = config
        self._places = tuple(places)
        self._estimator = OnlineEstimator(tuple(names), config, h, resolution, state)
        self._whiteness = {name: Whiteness() for name in names}
        saved = state.null if state is not None else None
        self._null = RunningNull(len(names)) if saved is None else RunningNull.restore(len(names), saved)

    @property
    def startup_remaining(self) -> int:
        """Samples until the start-up window is full."""
        return self._estimator.startup_remaining

    @property
    def lost(self) -> dict[str, Reason]:
        """Axes that have become invalid with the last sample, and why."""
        return self._estimator.lost

    @property
    def constant_axes(self) -> tuple[str, ...] | None:
        """Axes that did not change over the start-up window; None while it fills."""
        baseline = self._estimator.baseline
        return None if baseline is None else baseline.constant_axes

    def on_sample(self, values: Sequence[float]) -> dict[str, gyroscope.AxisEstimate] | None:
        """Take one sample; None while the start-up window fills."""
        own = tuple([values[place] for place in self._places])
        estimates = self._estimator.on_sample(own)
        self._null.add(own)
        for name, estimate in (estimates or {}).items():
            if estimate.valid:
                self._whiteness[name].add(estimate.innovation_dps, estimate.innovation_std_dps)
            else:
                self._whiteness[name].skip()
        return estimates

    def on_missing(self, count: int) -> None:
        """Bridge lost samples."""
        self._estimator.on_missing(count)
        self._null.skip(count)
        if count:
            for whiteness in self._whiteness.values():
                whiteness.skip()

    def save(self) -> OnlineState | None:
        """What a later run needs to go on; None while the start-up window fills."""
        state = self._estimator.save()
        return None if state is None else msgspec.structs.replace(state, null=self._null.save())

    def info(self) -> EstimatorInfo:
        """What they are estimated with."""
        c = self.config
        bias = tuple(c.bias) if isinstance(c.bias, list) else c.bias
        R = tuple(c.R) if isinstance(c.R, list) else c.R
        return EstimatorInfo(c.variant, c.estimate_on, c.memory, c.guard, c.window, c.startup_needed, bias, R)

    def gyro_estimates(self, estimates: dict[str, gyroscope.AxisEstimate]) -> dict[str, AxisEstimate]:
        """Estimates of the newest sample as records: null in place of any number that is not finite."""
        pairs = zip(estimates.items(), self._null.standings, strict=True)
        return {name: AxisEstimate(*_six(e), e.valid, *null) for (name, e), null in pairs}

    def accel_estimates(self, estimates: dict[str, gyroscope.AxisEstimate]) -> dict[str, AccelEstimate]:
        """The same of an accelerometer."""
        pairs = zip(estimates.items(), self._null.standings, strict=True)
        return {name: AccelEstimate(*_six(e), e.valid, *null) for (name, e), null in pairs}

    def gyro_stats(self) -> dict[str, AxisStats]:
        """Their statistics as those of a gyroscope."""
        return {name: AxisStats(*figures) for name, figures in self._figures()}

    def accel_stats(self) -> dict[str, AccelStats]:
        """Their statistics as those of an accelerometer."""
        return {name: AccelStats(*figures) for name, figures in self._figures()}

    def _figures(self) -> Iterator[tuple[str, _Figures]]:
        e = self._estimator
        for i, name in enumerate(e.axes):
            if e.baseline is None:
                yield name, _Figures(None, None, 0, {}, None, None)
                continue
            R, white = e.baseline.R[i], self._whiteness[name]
            yield (
                name,
                _Figures(
                    e.baseline.bias_dps[i],
                    R if math.isfinite(R) else None,
                    e.restarts[name],
                    e.interventions.get(name, {}),
                    _finite(white.lag1),
                    _finite(white.nis),
                ),
            )


_Six = tuple[float | None, float | None, float | None, float | None, float | None, float | None]


def _six(e: gyroscope.AxisEstimate) -> _Six:
    if all(map(math.isfinite, e[:6])):
        return e[:6]
    alpha, alpha_std, f, f_std, state, innovation = map(_finite, e[:6])
    return alpha, alpha_std, f, f_std, state, innovation


def explain_lost(axis: str, reason: Reason) -> tuple[str, str]:
    """Kind and text of the error that an axis has become invalid."""
    if reason == "runaway":
        return "axis_runaway", (
            f"{axis} ran away (order or parameter beyond all bounds) and begins anew: an offset, a wrong R "
            "or a moving sensor does this to the unguarded algorithm. --guard consistent holds it."
        )
    return "axis_bound", (
        f"{axis} needs the guard in more than a quarter of its samples, so it is not valid until that ends: "
        "is the sensor at rest, and does R (see stats) fit it?"
    )


def _finite(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None
