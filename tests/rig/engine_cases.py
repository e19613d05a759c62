"""Data and settings that the tests of the engine share: the paper's examples and its gyroscope."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from fltea.estimator.engine import (
    Engine,
    EngineSettings,
    Estimates,
    OrderTuning,
    ParameterTuning,
    StateTuning,
)
from fltea.lab.reference import filters as reference
from fltea.noise.simulation import fractional_system
from numpy.typing import NDArray

Array = NDArray[np.float64]

ESTIMATES = ("alpha", "alpha_var", "f", "f_var", "x", "P", "innovation", "innovation_var")

# Section 7.1, x axis.
GYROSCOPE = EngineSettings(h=0.01, window=3000, memory="direct")
# Section 6.1.
EXAMPLE = EngineSettings(
    h=0.001,
    window=4000,
    memory="direct",
    state=StateTuning(P0=1, Q=1e-5, x0=0, R=1e-3),
    order=OrderTuning(P0=0.05, Q0=0.005, alpha0=1, delta=0.5),
    parameter=ParameterTuning(P0=0.001, Q0=0.01, f0=0, delta=0.5),
)


def with_(settings: EngineSettings, **changes: Any) -> EngineSettings:
    return replace(settings, **changes)


def saw_tooth(n: int, hz: float = 1.0, h: float = 0.001) -> Array:
    return np.asarray(2 * np.modf(hz * h * np.arange(n) + 0.5)[0] - 1)


def white(n: int, lanes: int, seed: int, variance: float = 0.0235) -> Array:
    return np.random.default_rng(seed).normal(0, variance**0.5, (n, lanes))


def example(number: int, n: int, seed: int) -> tuple[Array, Array]:
    """y and u, each (n,), of example 1, 2 or 3 with a saw-tooth of ±1 and 1 Hz."""
    rng = np.random.default_rng(seed)
    u = saw_tooth(n) if number < 3 else rng.normal(0, 0.1**0.5, n)
    alpha = 0.6 if number == 1 else 0.2 + 0.1 * 0.001 * np.arange(1, n + 1)
    return fractional_system(alpha, -0.3, u, 1e-5, 1e-3, 0.001, n, rng)[1], u


def reference_run(
    settings: EngineSettings,
    y: Array,
    u: Array,
    missing: NDArray[np.bool_],
    changes: Mapping[int, tuple[float, float]] | None = None,
) -> Array:
    """The reference's answer, (n, len(ESTIMATES)); settings with plain numbers only.

    changes: Q and R from those samples on.
    """
    state, order, parameter = settings.state, settings.order, settings.parameter
    assert settings.window is not None
    fltea = reference.Fltea(
        reference.System(lambda w: w.reshape(1, 1), np.eye(1), np.eye(1), float(settings.h)),  # type: ignore[arg-type]
        reference.OrderSettings(order.P0, order.Q0, order.alpha0, state.R, order.delta),  # type: ignore[arg-type]
        reference.ParameterSettings(parameter.P0, parameter.Q0, parameter.f0, state.R, parameter.delta),  # type: ignore[arg-type]
        reference.StateSettings(state.P0, state.Q, state.x0, state.R),
        settings.window,
    )
    rows = []
    for k in range(len(y)):
        if changes and k in changes:
            fltea.retune(*changes[k])
        s = fltea.step(None if missing[k] else y[k], u[k])
        rows.append(
            (
                *(s.order, s.order_variance, s.w[0], s.Pw[0, 0], s.x[0], s.P[0, 0]),
                *(s.innovation[0], s.innovation_variance[0, 0]),
            )
        )
    return np.array(rows)


def run(settings: EngineSettings, y: Array, u: Array | None = None, **options: Any) -> Estimates:
    """One engine for all columns of y (n, lanes)."""
    return Engine(y.shape[1], settings, **options).run(y, u)


def same(a: Estimates, b: Estimates) -> bool:
    """Equal to the bit, interventions too."""
    return all(np.array_equal(p, q, equal_nan=True) for p, q in zip(a, b, strict=True))


def lane(estimates: Estimates, index: Any) -> Estimates:
    """The estimates of some lanes."""
    columns = (column[..., index] for column in estimates[:-1])
    return Estimates._make((*columns, estimates.interventions[index]))
