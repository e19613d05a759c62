"""Tests of the engine's variant "joint", which estimates α and f together. It is compared with a plain
implementation with matrices, and tested on noise of known order and parameter.
"""

from collections.abc import Mapping

import numpy as np
import pytest
from fltea.estimator.engine import CAUSES, Engine
from fltea.noise.simulation import FractionalNoise
from fltea.noise.weights import weights
from fltea.records.arrays import Array
from fltea.settings.estimator import JointSettings, StateSettings

from tests.rig.engine_cases import GYROSCOPE, columns, run, run_changing, white, with_

RESTING = 0.0235


def straight_loop(
    y: Array,
    u: Array,
    h: float,
    tuning: JointSettings,
    state: StateSettings,
    *,
    consistent: bool,
    limit: float = np.inf,
    changes: Mapping[int, tuple[float, float]] | None = None,
) -> Array:
    """Return α, the variance of α, f, the variance of f, the state x and its variance P for every sample.

    The settings must be plain numbers. `changes`: values of Q and R by the number of the sample at which they
    take effect.
    """
    Q, R = state.Q, RESTING
    mean = np.array([tuning.alpha0, tuning.beta0], dtype=np.float64)
    P = np.eye(2) * tuning.P0
    walk = np.eye(2) * tuning.Q0
    delta = tuning.delta
    states, variances = [state.x0], [state.P0]
    V, rows = 0.0, []
    Wm, Wc = np.full(5, 1 / 6), np.full(5, 1 / 6)
    Wm[0], Wc[0] = 1 / 3, 1 / 3 + 2

    def output(alpha: float, beta: float, drive: float) -> float:
        past = weights(alpha, len(states))[1:] @ states[::-1]
        return float(beta * states[-1] + h**alpha * drive - past)

    for k, (measured, drive) in enumerate(zip(y, u, strict=True)):
        Q, R = (changes or {}).get(k, (Q, R))
        predicted = P + walk
        shrink = np.diag([min(1.0, np.sqrt(limit / predicted[0, 0])), 1.0])
        predicted = shrink @ predicted @ shrink
        root = np.sqrt(3) * np.linalg.cholesky(predicted).T
        points = np.vstack([mean, mean + root, mean - root])
        Y = np.array([output(alpha, beta, drive) for alpha, beta in points])
        noise = Q + R
        if consistent:
            noise += mean.sum() ** 2 * variances[-1] + V
        dx, dy = points - mean, Y - Wm @ Y
        Pyy = (Wc * dy) @ dy + noise
        K = dx.T @ (Wc * dy) / Pyy
        moved = K * (measured - Wm @ Y)
        mean, P = mean + moved, predicted - Pyy * np.outer(K, K)
        walk = (1 - delta) * walk + delta * np.outer(moved, moved)

        alpha, beta = mean
        c = weights(alpha, len(states))
        V = float(c[2:] ** 2 @ variances[-2::-1])
        P_state = (beta + alpha) ** 2 * variances[-1] + Q + V
        expected = output(alpha, beta, drive)
        states.append(expected + P_state / (P_state + R) * (measured - expected))
        variances.append(P_state * R / (P_state + R))
        # derivatives of f = beta h^-alpha by alpha and by beta, the two numbers that the filter estimates
        slope = h**-alpha * np.array([-np.log(h) * beta, 1.0])
        rows.append((alpha, P[0, 0], beta * h**-alpha, slope @ P @ slope, states[-1], variances[-1]))
    return np.array(rows)


@pytest.mark.parametrize(
    ("delta", "changes"),
    [(0.0, {}), (0.3, {}), (0.1, {40: (0.01, 0.02), 41: (0.2, 0.004), 120: (0.0, 0.03)})],
)
@pytest.mark.parametrize("guard", ["off", "consistent"])
def test_joint_equals_a_straight_loop(
    guard: str, delta: float, changes: dict[int, tuple[float, float]]
) -> None:
    y, u = white(150, 1, 3)[:, 0], white(150, 1, 4)[:, 0]
    joint = JointSettings(P0=0.02, Q0=1e-3, alpha0=0.6, beta0=-0.2, delta=delta)
    state = StateSettings(P0=0.02, Q=0.1, x0=0.3)
    expected = straight_loop(y, u, 0.01, joint, state, consistent=guard == "consistent", changes=changes)
    tuning = with_(GYROSCOPE, variant="joint", guard=guard, gate=1e3, joint=joint, state=state)
    assert not run(tuning, y[:, np.newaxis], u[:, np.newaxis]).interventions.any()
    got = run_changing(tuning, y, u, changes)[:, :6]
    np.testing.assert_allclose(got, expected, rtol=1e-8, atol=1e-12)


def test_missing_samples_leave_the_joint_filter_alone() -> None:
    tuning = with_(GYROSCOPE, variant="joint", joint__Q0=0.01, joint__delta=0.5)
    engine = Engine(1, tuning)
    before = engine.run(white(20, 1, 1))
    first, second = (engine.step([np.nan], missing=[True]) for _ in range(2))
    assert first.alpha == before.alpha[-1]
    assert first.f == before.f[-1]
    assert first.alpha_var == second.alpha_var == before.alpha_var[-1]
    assert np.isnan(first.innovation)


@pytest.mark.parametrize(("alpha", "f"), [(0.4, -1.0), (0.6, -3.0), (0.8, -1.0), (0.8, -10.0)], ids=str)
def test_joint_finds_order_and_parameter_within_its_own_deviation(alpha: float, f: float) -> None:
    h, step_Q, R, lanes = 0.01, 0.15, 0.0235, 12
    noise = [
        FractionalNoise(alpha, f, step_Q / h ** (2 * alpha), R, h, 3000, seed, warmup=300)
        for seed in range(lanes)
    ]
    y = np.column_stack([lane_noise.samples(3000)[0] for lane_noise in noise])
    estimates = run(with_(GYROSCOPE, variant="joint", state__Q=step_Q, R=R), y)
    beta = h ** estimates.alpha[-1] * estimates.f[-1]
    assert abs(estimates.alpha[-1].mean() - alpha) < 0.06
    assert beta.mean() == pytest.approx(h**alpha * f, abs=0.04)
    # The reported standard deviation is right: the errors of the estimates scatter by about as much.
    alpha_errors = (estimates.alpha[-1] - alpha) / np.sqrt(estimates.alpha_var[-1])
    f_errors = (estimates.f[-1] - f) / np.sqrt(estimates.f_var[-1])
    assert np.sqrt(np.mean(alpha_errors**2)) < 2
    assert np.sqrt(np.mean(f_errors**2)) < 2


def test_the_limit_of_the_order_s_variance_keeps_the_correlation() -> None:
    y, u = white(8, 1, 2)[:, 0], np.zeros(8)
    joint = JointSettings(P0=0.1, Q0=0.3, alpha0=0.7, beta0=-0.3)
    state = StateSettings(P0=0.02, Q=0.1, x0=0.3)
    expected = straight_loop(y, u, 0.01, joint, state, consistent=True, limit=1 / 3)
    unlimited = straight_loop(y, u, 0.01, joint, state, consistent=True)
    tuning = with_(GYROSCOPE, variant="joint", guard="consistent", gate=1e3, joint=joint, state=state)
    estimates = run(tuning, y[:, np.newaxis], u[:, np.newaxis])
    counts = dict(zip(CAUSES, estimates.interventions[0].tolist(), strict=True))
    assert counts.pop("order_variance") == 8
    assert not any(counts.values()), counts
    np.testing.assert_allclose(columns(estimates)[:, :6], expected, rtol=1e-8, atol=1e-12)
    assert np.abs(expected - unlimited).max() > 1e-3


def test_joint_with_nothing_to_learn_keeps_its_start() -> None:
    held = JointSettings(P0=0, Q0=0, alpha0=0.7, beta0=-0.2)
    estimates = run(with_(GYROSCOPE, variant="joint", joint=held), white(50, 2, 1))
    assert (estimates.alpha == 0.7).all()
    np.testing.assert_allclose(estimates.f, -0.2 * 0.01**-0.7, rtol=1e-14)
    assert (estimates.alpha_var == 0).all()
    assert (estimates.f_var == 0).all()
    # With fixed order and parameter, the state filter equals that of the variant "triple".
    fixed = with_(
        GYROSCOPE,
        order__P0=0,
        order__Q0=0,
        order__alpha0=0.7,
        parameter__P0=0,
        parameter__Q0=0,
        parameter__f0=-0.2 * 0.01**-0.7,
    )
    np.testing.assert_allclose(run(fixed, white(50, 2, 1)).x, estimates.x, rtol=1e-10, atol=1e-13)
