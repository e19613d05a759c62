"""What the engine is told by the settings of an estimator."""

from collections.abc import Sequence

from fltea.estimator.engine_settings import (
    EngineSettings,
    JointTuning,
    OrderTuning,
    ParameterTuning,
    StateTuning,
)
from fltea.settings.estimator import EstimatorConfig


def lane_settings(
    config: EstimatorConfig, h: float, R: Sequence[float], Q: Sequence[float] | None = None
) -> EngineSettings:
    """What the engine is told: a lane for each R, sampling period h in s. Q: in place of the setting's."""
    order, parameter, state, joint = config.order, config.parameter, config.state, config.joint
    return EngineSettings(
        h=h,
        window=config.window_samples or None,
        memory=config.memory,
        variant=config.variant,
        guard=config.guard,
        gate=config.gate,
        state=StateTuning(P0=state.P0, Q=state.Q if Q is None else tuple(Q), x0=state.x0, R=tuple(R)),
        order=OrderTuning(P0=order.P0, Q0=order.Q0, alpha0=order.alpha0, delta=order.delta),
        parameter=ParameterTuning(P0=parameter.P0, Q0=parameter.Q0, f0=parameter.f0, delta=parameter.delta),
        joint=JointTuning(
            P0=joint.P0, Q0=joint.Q0, alpha0=joint.alpha0, beta0=joint.beta0, delta=joint.delta
        ),
    )
