"""Several gyroscope axes on the native engine, each a lane, under the supervisor.

The same interface as `gyroscope.GyroscopeEstimator`, which runs the numpy reference.
"""

import math
from collections.abc import Sequence

import numpy as np

from fltea.estimator.engine import (
    CAUSES,
    Engine,
    EngineSettings,
    JointTuning,
    OrderTuning,
    ParameterTuning,
    StateTuning,
)
from fltea.estimator.supervisor import Reason, Supervisor
from fltea.lab.reference.gyroscope import INVALID, AxisEstimate
from fltea.settings.config import EstimatorConfig

STATE_BOUND = CAUSES.index("state_bound")


class NativeGyroscope:
    """FLTEA for named axes on the native engine; `step` takes one sample of all of them.

    Arguments as for `GyroscopeEstimator`; `config` names memory, variant and guard too.
    `lost` holds, after a step, the axes that have just become invalid and why.
    Raises ValueError for settings that no filter can work with.
    """

    def __init__(
        self,
        axes: Sequence[str],
        R: Sequence[float],
        bias: Sequence[float],
        h: float,
        config: EstimatorConfig,
    ) -> None:
        self.axes = tuple(axes)
        self.lost: dict[str, Reason] = {}
        self.restarts = dict.fromkeys(self.axes, 0)
        self._bias = np.array(bias, dtype=np.float64)
        self._supervisors = [Supervisor() for _ in self.axes]
        self._settings = lane_settings(config, h, R)
        self._engine = Engine(len(self.axes), self._settings) if self.axes else None
        self._bounded = np.zeros(len(self.axes), dtype=np.int32)

    def step(self, y_dps: Sequence[float] | None) -> dict[str, AxisEstimate]:
        """Take one sample in deg/s of all axes, or None for a missing one; an estimate for each axis.

        Raises ValueError for a sample that is not finite, and leaves every axis as it was.
        """
        self.lost = {}
        if self._engine is None:
            return {}
        missing = None if y_dps is not None else np.ones(len(self.axes), dtype=bool)
        y = np.zeros(len(self.axes)) if y_dps is None else np.asarray(y_dps) - self._bias
        e = self._engine.step(y, missing=missing)
        bounded = e.interventions[:, STATE_BOUND]
        held = (bounded > self._bounded).tolist()
        # Lists at once: to take numbers out of arrays one by one would cost more than the engine's step.
        lanes = zip(*(column.tolist() for column in e[:8]), held, strict=True)
        result = {}
        restarts = []
        for i, (axis, (alpha, alpha_var, f, f_var, x, _, nu, nu_var, is_held)) in enumerate(
            zip(self.axes, lanes, strict=True)
        ):
            verdict = self._supervisors[i].judge(alpha, f, x, state_bound=is_held)
            if verdict.restart:
                restarts.append(i)
            if verdict.news:
                self.lost[axis] = verdict.news
            result[axis] = (
                AxisEstimate(alpha, _std(alpha_var), f, _std(f_var), x, nu, _std(nu_var), valid=True)
                if verdict.valid
                else INVALID
            )
        self._bounded = bounded.copy()
        if restarts:
            mask = np.zeros(len(self.axes), dtype=bool)
            mask[restarts] = True
            self._engine.reset(mask)
            for i in restarts:
                self.restarts[self.axes[i]] += 1
                self._supervisors[i] = Supervisor()
                self._bounded[i] = 0
        return result

    def save(self) -> bytes:
        """The filters as bytes; what the supervisors have seen is not among them."""
        return self._engine.save() if self._engine else b""

    def restore(self, data: bytes, restarts: dict[str, int]) -> None:
        """Go on from what `save` returned; raises ValueError if it was saved with other settings."""
        self._engine = Engine.restore(data, self._settings)
        self._bounded = self._engine.interventions()[:, STATE_BOUND].copy()
        self.restarts.update(restarts)

    @property
    def interventions(self) -> dict[str, dict[str, int]]:
        """How often the guard stepped in since the lane's last start, by axis and cause; zeros left out."""
        if self._engine is None:
            return {}
        counts = self._engine.interventions()
        return {
            axis: {cause: int(n) for cause, n in zip(CAUSES, counts[i], strict=True) if n}
            for i, axis in enumerate(self.axes)
        }


def lane_settings(config: EstimatorConfig, h: float, R: Sequence[float]) -> EngineSettings:
    """What the engine is told: a lane for each R, sampling period h in s."""
    order, parameter, state, joint = config.order, config.parameter, config.state, config.joint
    return EngineSettings(
        h=h,
        window=config.window or None,
        memory=config.memory,
        variant=config.variant,
        guard=config.guard,
        gate=config.gate,
        state=StateTuning(P0=state.P0, Q=state.Q, x0=state.x0, R=tuple(R)),
        order=OrderTuning(P0=order.P0, Q0=order.Q0, alpha0=order.alpha0, delta=order.delta),
        parameter=ParameterTuning(P0=parameter.P0, Q0=parameter.Q0, f0=parameter.f0, delta=parameter.delta),
        joint=JointTuning(
            P0=joint.P0, Q0=joint.Q0, alpha0=joint.alpha0, beta0=joint.beta0, delta=joint.delta
        ),
    )


def _std(variance: float) -> float:
    return math.sqrt(max(variance, 0.0))
