"""Data and settings that the tests of the engine share: the paper's examples and its gyroscope."""

from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise
from typing import Any

import msgspec
import numpy as np
from fltea.estimator.engine import Engine, Estimates
from fltea.estimator.lane_settings import LaneSettings
from fltea.lab.reference import filters as reference
from fltea.noise.simulation import FractionalNoise
from fltea.records.arrays import Array
from fltea.settings.estimator import EstimatorConfig, OrderSettings, ParameterSettings, StateSettings
from numpy.typing import NDArray

ESTIMATES = ("alpha", "alpha_var", "f", "f_var", "x", "P", "innovation", "innovation_var")

# Settings of the paper, section 7.1, for the x axis of its gyroscope.
PRINTED = EstimatorConfig(variant="triple", guard="off", memory="direct")
GYROSCOPE = LaneSettings(PRINTED, h=0.01, R=0.0235)
# Settings of the paper, section 6.1.
EXAMPLE = LaneSettings(
    msgspec.structs.replace(
        PRINTED,
        window=4000,
        state=StateSettings(P0=1, Q=1e-5, x0=0),
        order=OrderSettings(P0=0.05, Q0=0.005, alpha0=1, delta=0.5),
        parameter=ParameterSettings(P0=0.001, Q0=0.01, f0=0, delta=0.5),
    ),
    h=0.001,
    R=1e-3,
)


def with_(settings: LaneSettings, **changes: Any) -> LaneSettings:
    """Return the settings with changes.

    An argument such as `state__Q` changes the setting state.Q. Its value may be an array, with a value for
    each axis that the filters process in parallel.
    """
    numbers = {name.replace("__", "."): changes.pop(name) for name in [*changes] if "__" in name}
    own = {name: changes.pop(name) for name in [*changes] if name in ("h", "R", "accuracy")}
    config = msgspec.structs.replace(settings.config, **changes)
    return replace(settings, config=config, numbers={**settings.numbers, **numbers}, **own)


def saw_tooth(n: int, hz: float = 1.0, h: float = 0.001) -> Array:
    return np.asarray(2 * np.modf(hz * h * np.arange(n) + 0.5)[0] - 1)


def white(n: int, lanes: int, seed: int, variance: float = 0.0235) -> Array:
    return np.random.default_rng(seed).normal(0, variance**0.5, (n, lanes))


def example(number: int, n: int, seed: int) -> tuple[Array, Array]:
    """Return measurements and input of the paper's example `number` (1, 2 or 3), both of shape (n,).

    The input is a saw-tooth between -1 and 1, of 1 Hz.
    """
    rng = np.random.default_rng(seed)
    u = saw_tooth(n) if number < 3 else rng.normal(0, 0.1**0.5, n)
    alpha = 0.6 if number == 1 else 0.2 + 0.1 * 0.001 * np.arange(1, n + 1)
    return driven(alpha, u, rng)[1], u


def driven(alpha: Any, u: Array, seed: int | np.random.Generator) -> tuple[Array, Array]:
    """Return states and measurements of the system in the paper's section 6.1 for an input.

    The input `u` and both results have the shape (n,).
    """
    system = FractionalNoise(alpha, -0.3, 1e-5, 1e-3, 0.001, len(u) + 1, seed)
    y, x = np.array([system.step(one) for one in u.tolist()]).T
    return x, y


def reference_run(
    settings: LaneSettings,
    y: Array,
    u: Array,
    missing: NDArray[np.bool_],
    changes: Mapping[int, tuple[float, float]] | None = None,
) -> Array:
    """Return the estimates of the reference implementation, of shape (n, len(ESTIMATES)).

    The settings must be single numbers, not arrays with a value for each axis. `changes`: Q and R that take
    effect at the given samples.
    """
    config, R = settings.config, settings.R
    state, order, parameter = config.state, config.order, config.parameter
    fltea = reference.Fltea(
        reference.System(lambda w: w.reshape(1, 1), np.eye(1), np.eye(1), float(settings.h)),  # type: ignore[arg-type]
        reference.OrderSettings(order.P0, order.Q0, order.alpha0, R, order.delta),  # type: ignore[arg-type]
        reference.ParameterSettings(parameter.P0, parameter.Q0, parameter.f0, R, parameter.delta),  # type: ignore[arg-type]
        reference.StateSettings(state.P0, state.Q, state.x0, R),
        config.window_samples,
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


def run(settings: LaneSettings, y: Array, u: Array | None = None, **options: Any) -> Estimates:
    """Run one engine over the measurements y, of shape (n, axes)."""
    return Engine(y.shape[1], settings, **options).run(y, u)


def columns(estimates: Estimates) -> Array:
    """Return the estimates of an engine of one axis as an array of shape (n, len(ESTIMATES))."""
    return np.column_stack([getattr(estimates, name)[:, 0] for name in ESTIMATES])


def run_changing(
    settings: LaneSettings, y: Array, u: Array, changes: Mapping[int, tuple[float, float]], **options: Any
) -> Array:
    """Run an engine of one axis over measurements y and input u, both of shape (n,); return the estimates.

    `changes`: Q and R that take effect at the given samples.
    """
    engine, parts = Engine(1, settings, **options), []
    for begin, end in pairwise([0, *changes, len(y)]):
        if begin:
            Q, R = changes[begin]
            engine.retune(with_(settings, state__Q=Q, R=R))
        parts.append(columns(engine.run(y[begin:end, np.newaxis], u[begin:end, np.newaxis])))
    return np.vstack(parts)


def same(a: Estimates, b: Estimates) -> bool:
    """Return whether all estimates and interventions of two runs are equal to the bit."""
    return all(np.array_equal(p, q, equal_nan=True) for p, q in zip(a, b, strict=True))


def lane(estimates: Estimates, index: Any) -> Estimates:
    columns = (column[..., index] for column in estimates[:-1])
    return Estimates._make((*columns, estimates.interventions[index]))
