"""One epoch of estimation: start-up window, then the estimator, sample by sample."""

from fltea.estimator.bias import Baseline, Startup
from fltea.estimator.native_gyroscope import NativeGyroscope
from fltea.estimator.online_state import OnlineState
from fltea.estimator.supervisor import Reason
from fltea.lab.reference.gyroscope import INVALID, AxisEstimate
from fltea.settings.config import EstimatorConfig

__all__ = ["OnlineEstimator", "OnlineState"]


class OnlineEstimator:
    """Bias and R from the start-up window, estimates from the first sample after it.

    axes: names. h: sampling period in s. resolution_dps: one LSB, None where unknown. state: what `save`
    returned, to go on from there without a start-up window.

    Raises:
        ValueError: settings that no filter can work with, or a state that does not fit them.
    """

    def __init__(
        self,
        axes: tuple[str, ...],
        config: EstimatorConfig,
        h: float,
        resolution_dps: float | None,
        state: OnlineState | None = None,
    ):
        self.axes = axes
        self._config = config
        self._h = h
        bias = [config.bias] * len(axes) if isinstance(config.bias, int | float) else config.bias
        self._startup = Startup(axes, config.startup, bias, config.R, resolution_dps)
        self.startup_remaining = self._startup.needed
        self.baseline: Baseline | None = None
        self._estimator: NativeGyroscope | None = None
        if state is not None:
            self._resume(state)
        elif not self.startup_remaining:
            self._begin(self._startup.baseline())

    def on_sample(self, y_dps: tuple[float, ...]) -> dict[str, AxisEstimate] | None:
        """Take one sample in deg/s; None while the start-up window fills.

        An axis that was constant over the start-up window has no variance to filter with: it stays invalid.
        """
        if self._estimator is None:
            self.startup_remaining -= 1
            baseline = self._startup.add(y_dps)
            if baseline is not None:
                self._begin(baseline)
            return None
        estimates = self._estimator.step([y_dps[i] for i in self._live])
        return {axis: estimates.get(axis, INVALID) for axis in self.axes}

    def on_missing(self, count: int) -> None:
        """Bridge lost samples by prediction alone; within the start-up window they do not matter."""
        if self._estimator is not None:
            for _ in range(count):
                self._estimator.step(None)

    def save(self) -> OnlineState | None:
        """What `state` takes; None in the start-up window, and with a constant axis."""
        native, base = self._estimator, self.baseline
        if native is None or base is None or base.constant_axes:
            return None
        return OnlineState(self.axes, base.bias_dps, base.R, self.restarts, native.save())

    @property
    def restarts(self) -> dict[str, int]:
        """How often each axis had to start again because its estimate was not finite."""
        counts = self._estimator.restarts if self._estimator else {}
        return {axis: counts.get(axis, 0) for axis in self.axes}

    @property
    def interventions(self) -> dict[str, dict[str, int]]:
        """How often the guard stepped in, by axis and cause."""
        return self._estimator.interventions if self._estimator else {}

    @property
    def lost(self) -> dict[str, Reason]:
        """Axes that have become invalid with the last sample, and why."""
        return self._estimator.lost if self._estimator else {}

    def _resume(self, state: OnlineState) -> None:
        if state.axes != self.axes or self._config.engine == "reference":
            raise ValueError(f"the state is one of {', '.join(state.axes)} by a native engine")
        state.check(self.axes)
        self.startup_remaining = 0
        self._begin(Baseline(state.bias_dps, state.R, ())).restore(state.engine, state.restarts)

    def _begin(self, baseline: Baseline) -> NativeGyroscope:
        self.baseline = baseline
        self._live = [i for i, axis in enumerate(self.axes) if axis not in baseline.constant_axes]
        axes = [self.axes[i] for i in self._live]
        R = [baseline.R[i] for i in self._live]
        bias = [baseline.bias_dps[i] for i in self._live]
        self._estimator = NativeGyroscope(axes, R, bias, self._h, self._config)
        return self._estimator
