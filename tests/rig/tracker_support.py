"""Make state-space systems, simulated measurements and a plain Kalman filter for the tracker's tests."""

import math
from typing import Any

import numpy as np
from fltea.estimator.tracker import Tracker, TrackerRules, Tracks
from fltea.noise import parts as p
from fltea.noise.linear_system import System
from fltea.noise.system import system
from fltea.records.arrays import Array

H = 0.01


def kalman(s: System, y: Array) -> dict[str, Array]:
    """Run a textbook's Kalman filter over measurements. NaN stands for a lost sample."""
    x, P, A = np.zeros(len(s.a)), s.P0.copy(), s.A
    of_state, of_bias = s.signal * s.c, np.maximum(s.signal, s.a == 1) * s.c
    rows = []
    for one in y:
        e, S = one - s.c @ x, s.c @ P @ s.c + s.R
        if not math.isnan(one):
            of_one = P @ s.c
            x, P = x + of_one / S * e, P - np.outer(of_one, of_one) / S
        rows.append((of_state @ x, of_state @ P @ of_state, of_bias @ x, of_bias @ P @ of_bias, e, S))
        x, P = A @ x, A @ P @ A.T + s.Q
    state, state_var, bias, bias_var, e, S = np.array(rows).T
    return {
        "state": state,
        "state_std": np.sqrt(np.maximum(state_var, 0)),
        "bias": bias,
        "bias_std": np.sqrt(np.maximum(bias_var, 0)),
        "innovation": e,
        "S": S,
    }


def simulated(s: System, n: int, seed: int) -> tuple[Array, Array]:
    """Return simulated measurements of a system, and its true states. States with a stationary distribution
    begin with a value drawn from this distribution, all other states at 0.
    """
    rng = np.random.default_rng(seed)
    moving = np.hypot(s.a, s.b) < 1
    P0 = np.where(np.outer(moving, moving), s.P0, 0)
    x = rng.multivariate_normal(np.zeros(len(s.a)), P0, method="eigh")
    w = rng.multivariate_normal(np.zeros(len(s.a)), s.Q, n, method="eigh")
    y, state, A = np.empty(n), np.empty(n), s.A
    for k in range(n):
        y[k], state[k] = s.c @ x, (s.signal * s.c) @ x
        x = A @ x + w[k]
    return y + rng.normal(0, math.sqrt(s.R), n), state


def white(R: float) -> System:
    return system([p.White(R)], H, 1)


def walk(R: float, q: float) -> System:
    return system([p.White(R), p.Walk(math.sqrt(q / H))], H, 1)


def relaxing(a: float) -> System:
    return system([p.White(1.0), p.Relaxation(1.0, -H / math.log(a))], H, 1)


def of(*parts: p.Part, samples: int = 10**5) -> System:
    return system([p.White(1.0), *parts], H, samples)


SYSTEMS = {
    "white": white(1.0).with_offset(),
    "walk": walk(1.0, 1e-3),
    "walking offset": white(1.0).with_offset(1e-4, of_state=True),
    "relaxation": relaxing(0.95).with_offset(),
    "relaxation, fixed offset": relaxing(0.95),
    "order": of(p.Order(0.7, -1.0, 0.3 / H**1.4)).with_offset(),
    "anti-persistent order": of(p.Order(0.3, -2.0, 1.0 / H**0.6)).with_offset(),
    "low-pass": of(p.Relaxation(0.5, 0.5), p.LowPass(10.0, 2.0)).with_offset(),
    "resonance": of(p.Relaxation(0.5, 0.5), p.Resonance(5.0, 20.0, 1.0)).with_offset(),
    "quantisation, walk": of(p.Quantisation(H), p.Walk(0.1)),
}


def fixed(s: System) -> bool:
    """Return whether no state of the system is an offset: kept from sample to sample, and measured as it
    is.
    """
    return not np.any((s.a == 1) & (s.c == 1))


def tracker(s: System | None = None, offset: float | None = None, **rules: Any) -> Tracker:
    """Return a tracker of one axis.

    `rules`: fields of TrackerRules that differ from the default.
    """
    one = Tracker([0.0 if s is not None and fixed(s) else offset], TrackerRules(**rules))
    if s is not None:
        one.set(0, s)
    return one


def run(one: Tracker, y: Array) -> Tracks:
    return Tracks._make(column[:, 0] for column in one.run(np.asarray(y, dtype=float)[:, None]))


def lanes(found: Tracks) -> Array:
    return np.array([np.asarray(column, dtype=float) for column in found])
