"""The estimator that a simulated board runs, computed by the host's engine.

The engine computes in double precision; the protocol's messages round to single precision. Like the firmware,
this estimator computes the bias and the variance R of the white noise from the first samples, the start-up
window. After that it estimates with a memory of all samples.
"""

from collections.abc import Sequence
from struct import pack, unpack

import numpy as np
from fltea.estimator.engine import Engine
from fltea.estimator.lane_settings import LaneSettings
from fltea.settings.config import Config
from fltea.settings.duration import known
from fltea.settings.estimator import (
    EstimatorConfig,
    JointSettings,
    OrderSettings,
    ParameterSettings,
    StateSettings,
)
from fltea.wire import layout as wire

CONFIG = Config()
SETTINGS = CONFIG.estimator
NOT_TRACKED = (0.0,) * 4
"""Values of the bias tracker's fields in ESTIMATE. They are zero, because the simulated board makes no fits
and has no tracker.
"""


def f32(value: float) -> float:
    """Return the number of single precision that is nearest to `value`."""
    return float(unpack("<f", pack("<f", value))[0])


JOINT = wire.Estimator._make([0] * len(wire.Estimator._fields))._replace(
    variant=wire.EstimatorVariant.JOINT,
    guard=wire.EstimatorGuard.CONSISTENT,
    startup=SETTINGS.startup_samples,
    max_gap=known("max_gap", CONFIG.link.max_gap),
    every=1,
    remaining=SETTINGS.startup_samples,
    begun=1,
    fit_every=300,
    longest_axis=2400,
    longest_slice=1200,
    state_x0=f32(SETTINGS.state.x0),
    state_p0=f32(SETTINGS.state.P0),
    state_q=f32(SETTINGS.state.Q),
    alpha0=f32(SETTINGS.joint.alpha0),
    alpha_p0=f32(SETTINGS.joint.P0),
    alpha_q0=f32(SETTINGS.joint.Q0),
    alpha_delta=f32(SETTINGS.joint.delta),
    parameter0=f32(SETTINGS.joint.beta0),
    parameter_p0=f32(SETTINGS.joint.P0),
    parameter_q0=f32(SETTINGS.joint.Q0),
    parameter_delta=f32(SETTINGS.joint.delta),
    gate=f32(SETTINGS.gate),
)
"""The message ESTIMATOR, in which a board states its estimator's settings: here the defaults of `fltea run`,
for the algorithm's variant `joint`.
"""

TRIPLE = JOINT._replace(
    variant=wire.EstimatorVariant.TRIPLE,
    alpha0=f32(SETTINGS.order.alpha0),
    alpha_p0=f32(SETTINGS.order.P0),
    alpha_q0=f32(SETTINGS.order.Q0),
    alpha_delta=f32(SETTINGS.order.delta),
    parameter0=f32(SETTINGS.parameter.f0),
    parameter_p0=f32(SETTINGS.parameter.P0),
    parameter_q0=f32(SETTINGS.parameter.Q0),
    parameter_delta=f32(SETTINGS.parameter.delta),
)
"""As `JOINT`, but for the algorithm's variant `triple`."""


class OwnEstimator:
    """Computes the estimates of three axes from samples in counts.

    `lsb`: counts per deg/s. `h`: sampling period [s].

    `stated`: the message ESTIMATOR. It has the settings, the bias and R of each axis once they are known, and
    the number of samples that the start-up window still needs.
    """

    def __init__(self, stated: wire.Estimator, lsb: float, h: float) -> None:
        self.stated = stated
        self._lsb, self._h = lsb, h
        self._window: list[Sequence[int]] = []
        self._engine: Engine | None = None
        self._live: list[int] = []
        self._bias = np.zeros(3)
        self._age = 0

    def step(self, counts: Sequence[int] | None, sample: int) -> list[wire.Estimate]:
        """Process one sample, or None for a missing one; return an estimate of each axis.

        During the start-up window there are no estimates.
        """
        if self._engine is None:
            if counts is not None:
                self._window.append(counts)
                self.stated = self.stated._replace(remaining=self.stated.startup - len(self._window))
            if not self.stated.remaining:
                self._begin()
            return []
        self._age += 1
        y = (np.zeros(3) if counts is None else np.array(counts) / self._lsb) - self._bias
        e = self._engine.step(y[self._live], missing=np.full(len(self._live), counts is None))
        found = []
        for axis in range(3):
            numbers: tuple[float, ...] = (0.0,) * 6
            causes, flags = [0] * 9, wire.EstimateFlags.CONSTANT
            if axis in self._live:
                i = self._live.index(axis)
                flags, causes = wire.EstimateFlags.VALID, e.interventions[i].tolist()
                stds = e.alpha_var[i] ** 0.5, e.f_var[i] ** 0.5
                innovation = 0.0 if counts is None else e.innovation[i]
                numbers = e.alpha[i], stds[0], e.f[i], stds[1], e.x[i], innovation
            if counts is None:
                flags |= wire.EstimateFlags.MISSING
            alpha, alpha_std, f, f_std, x, innovation = map(float, numbers)
            place = axis, flags, sample, self._age
            numbers = alpha, alpha_std, f, f_std, x, innovation
            found.append(wire.Estimate._make([*place, *numbers, *causes, *NOT_TRACKED]))
        return found

    def _begin(self) -> None:
        s = self.stated
        window = np.array(self._window)
        self._live = [axis for axis in range(3) if np.ptp(window[:, axis])]
        rates = window / self._lsb
        self._bias = rates.mean(axis=0)
        R = np.maximum(rates.var(axis=0, ddof=1), (1 / self._lsb) ** 2 / 12)
        joint = s.variant == wire.EstimatorVariant.JOINT
        config = EstimatorConfig(
            window=0,
            variant="joint" if joint else "triple",
            guard=("off", "faithful", "consistent")[s.guard],
            gate=s.gate,
            state=StateSettings(P0=s.state_p0, Q=s.state_q, x0=s.state_x0),
            order=OrderSettings(P0=s.alpha_p0, Q0=s.alpha_q0, alpha0=s.alpha0, delta=s.alpha_delta),
            parameter=ParameterSettings(
                P0=s.parameter_p0, Q0=s.parameter_q0, f0=s.parameter0, delta=s.parameter_delta
            ),
            joint=JointSettings(
                P0=s.alpha_p0, Q0=s.alpha_q0, alpha0=s.alpha0, beta0=s.parameter0, delta=s.alpha_delta
            ),
        )
        self._engine = Engine(len(self._live), LaneSettings(config, self._h, R[self._live]))
        R[[axis for axis in range(3) if axis not in self._live]] = 0.0
        x, y, z = map(f32, self._bias)
        r_x, r_y, r_z = map(f32, R)
        self.stated = s._replace(bias_x=x, bias_y=y, bias_z=z, r_x=r_x, r_y=r_y, r_z=r_z)
