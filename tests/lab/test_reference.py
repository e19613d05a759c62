import dataclasses
import itertools
from collections.abc import Callable

import numpy as np
import pytest
from fltea.lab.reference.filters import Fltea, OrderSettings, ParameterSettings, StateSettings, Step, System
from fltea.records.arrays import Array
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from tests.rig.engine_cases import driven, saw_tooth

ORDER = OrderSettings(P0=0.05, Q0=0.005, alpha0=1, R=1e-3, delta=0.5)
PARAMETER = ParameterSettings(P0=0.001, Q0=0.01, w0=0, R=1e-3, delta=0.5)
STATE = StateSettings(P0=1, Q=1e-5, x0=0, R=1e-3)


def scalar(w: Array) -> Array:
    return w.reshape(1, 1)


def example_1(window: int) -> Fltea:
    """Return the algorithm FLTEA with the settings of the paper's section 6.1."""
    return Fltea(System(scalar, np.eye(1), np.eye(1), 0.001), ORDER, PARAMETER, STATE, window)


def data(n: int, seed: int = 3) -> tuple[Array, Array]:
    """Return input and output of a system of order 0.6. The input is a saw-tooth of ±1 and 5 Hz."""
    u = saw_tooth(n, 5)
    return u, driven(0.6, u, seed)[1]


def same(a: Step, b: Step) -> bool:
    return all(np.array_equal(p, q, equal_nan=True) for p, q in zip(a, b, strict=True))


def test_parameters_that_enter_linearly_follow_a_plain_kalman_filter() -> None:
    # A(w) x is linear in the parameters w here, and so is the output. Its matrix is H = h^α d(A x)/dw (h:
    # sampling period). The filter of sigma points is then exact, and equals the plain Kalman filter below.
    # With a constant order α, the filters of parameters and state predict the same output, so they have the
    # same innovation.
    h, order, R, delta = 0.25, 0.5, np.diag([0.2, 0.3]), 0.3
    P = np.array([[0.5, 0.2, 0.1], [0.2, 0.4, 0.0], [0.1, 0.0, 0.3]])
    Q = np.diag([0.01, 0.02, 0.03])
    w = np.array([-1.0, 0.5, -2.0])
    fltea = Fltea(
        System(lambda w: np.array([[w[0], w[1]], [0, w[2]]]), None, np.eye(2), h),
        OrderSettings(P0=0, Q0=0, alpha0=order, R=1, delta=0),
        ParameterSettings(P0=P, Q0=Q, w0=w, R=R, delta=delta),
        StateSettings(P0=1, Q=0.1, x0=[1, -1], R=0.5),
    )
    for y in np.random.default_rng(6).normal(0, 1, (30, 2)):
        x = fltea.states.values[0].copy()
        step = fltea.step(y)
        H = h**order * np.array([[x[0], x[1], 0], [0, 0, x[1]]])
        P = P + Q
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
        correction = K @ step.innovation
        w, P = w + correction, P - K @ H @ P
        Q = (1 - delta) * Q + delta * np.outer(correction, correction)
        assert step.w == pytest.approx(w, rel=1e-9)
        assert step.Pw == pytest.approx(P, rel=1e-9, abs=1e-12)


def test_two_outputs_are_one_with_their_combined_noise() -> None:
    # Two measurements of the state with variances 0.2 and 0.3 are equivalent to one measurement: their
    # weighted mean, with variance 1/(1/0.2 + 1/0.3).
    def start(C: Array, R: object) -> Fltea:
        return Fltea(
            System(scalar, None, C, 0.01),
            OrderSettings(P0=0.1, Q0=0.01, alpha0=1, R=R, delta=0.5),  # type: ignore[arg-type]
            ParameterSettings(P0=0.1, Q0=0.1, w0=0, R=R, delta=0.5),  # type: ignore[arg-type]
            StateSettings(P0=1, Q=0.1, x0=0.5, R=R),  # type: ignore[arg-type]
        )

    R = 1 / (1 / 0.2 + 1 / 0.3)
    two, one = start(np.ones((2, 1)), np.diag([0.2, 0.3])), start(np.eye(1), R)
    for y in np.random.default_rng(2).normal(0, 1, (60, 2)):
        a, b = two.step(y), one.step(R * (y[0] / 0.2 + y[1] / 0.3))
        assert (a.x[0], a.P[0, 0], a.order, a.w[0], a.Pw[0, 0]) == pytest.approx(
            (b.x[0], b.P[0, 0], b.order, b.w[0], b.Pw[0, 0]), rel=1e-8
        )


def test_two_separate_systems_in_one_keep_apart() -> None:
    # `np.diag` makes the matrix of the system diagonal, so each of two states depends only on itself. With a
    # constant order, one filter of both states is then equivalent to two separate filters.
    order = OrderSettings(P0=0, Q0=0, alpha0=0.6, R=1, delta=0)

    def start(w: list[float]) -> Fltea:
        N = len(w)
        return Fltea(
            System(np.diag, None, np.eye(N), 0.01),
            order,
            ParameterSettings(P0=0, Q0=0, w0=w, R=1, delta=0),
            StateSettings(P0=1, Q=0.1, x0=np.zeros(N), R=0.2),
        )

    both, first, second = start([-1, -3]), start([-1]), start([-3])
    for y in np.random.default_rng(1).normal(0, 1, (50, 2)):
        step, a, b = both.step(y), first.step(y[0]), second.step(y[1])
        assert step.x == pytest.approx([a.x[0], b.x[0]], rel=1e-12)
        assert step.P.ravel() == pytest.approx([a.P[0, 0], 0, 0, b.P[0, 0]], rel=1e-12)


@settings(derandomize=True, deadline=None, max_examples=30)
@given(
    N=st.integers(1, 3),
    p=st.integers(1, 2),
    seed=st.integers(0, 2**32 - 1),
    R=st.floats(1e-3, 10),
    delta=st.floats(0, 1),
)
def test_covariances_stay_symmetric_and_non_negative(
    N: int, p: int, seed: int, R: float, delta: float
) -> None:
    rng = np.random.default_rng(seed)
    A0, A1 = rng.normal(0, 1, (2, N, N))
    fltea = Fltea(
        System(lambda w: A0 * w[0] + A1 * w[1], None, rng.normal(0, 1, (p, N)), 0.1),
        OrderSettings(P0=0.05, Q0=0.01, alpha0=rng.uniform(0, 1.5), R=R, delta=delta),
        ParameterSettings(P0=0.05, Q0=0.01, w0=rng.normal(0, 1, 2), R=R, delta=delta),
        StateSettings(P0=1, Q=0.1, x0=rng.normal(0, 1, N), R=R),
        window=20,
    )
    steps = 0
    for k, y in enumerate(rng.normal(0, 1, (50, p))):
        step = fltea.step(None if k % 7 == 6 else y)
        covariances = (step.P, step.Pw, step.innovation_variance, fltea.order.Q, fltea.parameter.Q)
        assert not step.finite or step.order_variance >= 0
        assert not step.finite or all(np.array_equal(P, P.T) for P in covariances)
        if not (step.finite and abs(step.order) < 3 and max(np.abs(P).max() for P in covariances) < 1e6):
            # The filter diverges. Its numbers are so large that the rounding error of F P F' (the covariance
            # P after a step with the transition matrix F) exceeds the bound below.
            break
        steps += 1
        assert all(np.linalg.eigvalsh(P).min() >= -1e-12 * np.abs(P).max() for P in covariances)
    assume(steps > 0)


def test_results_of_a_step_survive_the_next() -> None:
    u, ys = data(10)
    fltea = example_1(2)
    step = fltea.step(ys[0], u[0])
    kept = [np.copy(value) for value in step]
    fltea.run(ys[1:], u[1:])
    assert all(np.array_equal(a, b) for a, b in zip(step, kept, strict=True))


def test_a_missing_measurement_is_a_prediction() -> None:
    u, ys = data(100)
    fltea, twin = example_1(100), example_1(100)
    before = fltea.run(ys[:60], u[:60])[-1]
    twin.run(ys[:60], u[:60])
    order, parameter = fltea.order, fltea.parameter
    for _ in range(3):
        step = fltea.step(None, u[60])
        assert same(step, twin.predict(u[60]))
        assert (step.order, step.w[0]) == (before.order, before.w[0])
        assert (step.order_variance, step.Pw) == (before.order_variance, before.Pw)
        assert (fltea.order, fltea.parameter) == (order, parameter)
        assert np.isnan(step.innovation).all()
        assert step.finite
        assert fltea.states.values[0] == step.x
        assert fltea.covariances.values[0] == step.P
    assert step.P > before.P
    assert len(fltea.states) == 64
    assert all(step.finite for step in fltea.run(ys[63:], u[63:]))


def test_a_prediction_is_what_the_next_measurement_is_compared_with() -> None:
    u, ys = data(50)
    fixed_order = dataclasses.replace(ORDER, P0=0, Q0=0, alpha0=0.6)
    fixed = dataclasses.replace(PARAMETER, P0=0, Q0=0, w0=-0.3)
    system = System(scalar, np.eye(1), np.eye(1), 0.001)
    measured, missing = (Fltea(system, fixed_order, fixed, STATE) for _ in range(2))
    measured.run(ys[:-1], u[:-1])
    missing.run(ys[:-1], u[:-1])
    a, b = measured.step(ys[-1], u[-1]), missing.step(None, u[-1])
    assert a.innovation == ys[-1] - b.x
    assert np.array_equal(a.innovation_variance, b.innovation_variance)


def test_divergence_is_told_and_never_raised() -> None:
    # The filters have the settings of the paper's section 7.1. One sample is absurd but finite, and its
    # square is too large for a float.
    fltea = Fltea(
        System(scalar, None, np.eye(1), 0.01),
        OrderSettings(P0=0.01, Q0=0.1, alpha0=1, R=0.0235, delta=0.5),
        ParameterSettings(P0=0.01, Q0=0.1, w0=0, R=0.0235, delta=0.5),
        StateSettings(P0=0.01, Q=0.15, x0=0, R=0.0235),
    )
    ys = np.random.default_rng(0).normal(0, 0.0235**0.5, 60)
    ys[30] = 1e200
    steps = fltea.run(ys)
    finite = [step.finite for step in steps]
    assert finite[0]
    assert not finite[-1]
    # After the first estimate that is not finite, no later estimate is finite, with or without measurements.
    assert sorted(finite, reverse=True) == finite
    assert not fltea.step(None).finite
    assert fltea.step(0.0).finite is False


@pytest.mark.parametrize("C", [np.eye(2), np.ones((2, 2))], ids=["regular", "singular"])
def test_divergence_of_several_outputs_is_told_as_well(C: Array) -> None:
    fltea = Fltea(
        System(lambda w: np.diag([w[0], w[1] * 1e200]), None, C, 0.5),
        OrderSettings(P0=1, Q0=1, alpha0=1, R=1e-9, delta=1),
        ParameterSettings(P0=1, Q0=1, w0=[0, 1], R=1e-9, delta=1),
        StateSettings(P0=1, Q=1, x0=[1, 1], R=1e-9),
    )
    assert not fltea.run(np.random.default_rng(0).normal(0, 1, (30, 2)))[-1].finite


@pytest.mark.parametrize("bad", [np.nan, np.inf, [1.0, 2.0], []])
def test_a_wrong_measurement_or_input_changes_nothing(bad: object) -> None:
    u, ys = data(20)
    fltea, twin = example_1(100), example_1(100)
    for f in (fltea, twin):
        f.run(ys[:10], u[:10])
    with pytest.raises(ValueError, match="y must"):
        fltea.step(bad, 0)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="u must"):
        fltea.step(0, bad)  # type: ignore[arg-type]
    assert all(map(same, fltea.run(ys[10:], u[10:]), twin.run(ys[10:], u[10:])))


def test_an_input_without_B_is_refused() -> None:
    fltea = Fltea(System(scalar, None, np.eye(1), 0.01), ORDER, PARAMETER, STATE)
    with pytest.raises(ValueError, match="no input"):
        fltea.step(1, 1)


def test_records_of_different_length_are_refused() -> None:
    with pytest.raises(ValueError, match="shorter"):
        example_1(10).run([1, 2], [1])


SYSTEM = System(scalar, None, np.eye(1), 0.01)
WRONG: list[tuple[str, Callable[[], object]]] = [
    ("h is the sampling time", lambda: dataclasses.replace(SYSTEM, h=0)),
    ("C must be a finite matrix", lambda: dataclasses.replace(SYSTEM, C=np.ones(1))),
    ("B must be a finite matrix", lambda: dataclasses.replace(SYSTEM, B=np.full((1, 1), np.nan))),
    (
        "C must have 1 columns",
        lambda: Fltea(dataclasses.replace(SYSTEM, C=np.eye(2)), ORDER, PARAMETER, STATE),
    ),
    (
        "B must have 1 rows",
        lambda: Fltea(dataclasses.replace(SYSTEM, B=np.eye(2)), ORDER, PARAMETER, STATE),
    ),
    (
        r"A\(w0\) must have shape \(2, 2\)",
        lambda: Fltea(SYSTEM, ORDER, PARAMETER, dataclasses.replace(STATE, x0=[0, 0])),
    ),
    ("w0 must be", lambda: Fltea(SYSTEM, ORDER, dataclasses.replace(PARAMETER, w0=[]), STATE)),
    ("x0 must be", lambda: dataclasses.replace(STATE, x0=np.nan)),
    ("alpha0 must be", lambda: dataclasses.replace(ORDER, alpha0=np.inf)),
    ("order P0 is a covariance", lambda: dataclasses.replace(ORDER, P0=-1)),
    ("order Q0 must be finite", lambda: dataclasses.replace(ORDER, Q0=np.nan)),
    ("order delta", lambda: dataclasses.replace(ORDER, delta=1.5)),
    ("parameter delta", lambda: dataclasses.replace(PARAMETER, delta=-0.1)),
    ("state R must be positive", lambda: Fltea(SYSTEM, ORDER, PARAMETER, dataclasses.replace(STATE, R=0))),
    (
        "parameter P0 must be a number or have shape",
        lambda: Fltea(SYSTEM, ORDER, dataclasses.replace(PARAMETER, P0=np.eye(2)), STATE),
    ),
    (
        "symmetric",
        lambda: Fltea(
            dataclasses.replace(SYSTEM, A=np.diag, C=np.eye(2)),
            ORDER,
            dataclasses.replace(PARAMETER, w0=[1, 2], P0=[[1, 0.5], [0, 1]]),
            dataclasses.replace(STATE, x0=[0, 0]),
        ),
    ),
    ("window must be at least 1", lambda: Fltea(SYSTEM, ORDER, PARAMETER, STATE, window=0)),
]


@pytest.mark.parametrize(("text", "make"), WRONG, ids=[text for text, _ in WRONG])
def test_wrong_settings_are_named(text: str, make: Callable[[], object]) -> None:
    with pytest.raises(ValueError, match=text):
        make()


def test_covariances_of_parameters_may_be_singular() -> None:
    # The first parameter is known exactly. The other two are unknown, but always equal. So their initial
    # covariance P0 is singular: its rank is one.
    P0 = np.zeros((3, 3))
    P0[1:, 1:] = 0.04
    fltea = Fltea(
        System(lambda w: np.diag(w[:1] + w[1:2]), None, np.eye(1), 0.01),
        ORDER,
        ParameterSettings(P0=P0, Q0=0, w0=[-1, 0, 0], R=1e-3, delta=0),
        STATE,
    )
    ws = [step.w for step in fltea.run(np.random.default_rng(4).normal(0, 0.03, 30))]
    assert all(w[0] == -1 and w[1] == pytest.approx(w[2], rel=1e-9) for w in ws)
    assert all(a[1] != b[1] for a, b in itertools.pairwise(ws))
