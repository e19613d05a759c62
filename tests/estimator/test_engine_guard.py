"""Tests of the guard, which keeps the engine's estimates within bounds: no estimate leaves the bounds, every
intervention is counted, and without an intervention nothing changes.
"""

import itertools
import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pytest
from fltea.estimator.engine import CAUSES, LARGEST_INPUT, Engine, Estimates
from fltea.estimator.lane_settings import LaneSettings
from fltea.records.arrays import Array
from fltea.settings.estimator import OrderSettings, StateSettings
from hypothesis import example as case
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from tests.rig.engine_cases import ESTIMATES, GYROSCOPE, columns, run, same, saw_tooth, white, with_

Flags = NDArray[np.bool_]

GUARDED = [
    with_(GYROSCOPE, variant=variant, guard=guard, memory=memory, window=50)
    for variant, guard, memory in itertools.product(
        ("triple", "joint"), ("faithful", "consistent"), ("direct", "compressed")
    )
]


def kind(engine_settings: LaneSettings) -> str:
    c = engine_settings.config
    return f"{c.variant} {c.guard} {c.memory}"


def counted(estimates: Estimates) -> dict[str, int]:
    return dict(zip(CAUSES, estimates.interventions.sum(axis=0).tolist(), strict=True))


def assert_within_bounds(tuning: LaneSettings, estimates: Estimates, y: Array, missing: Flags) -> None:
    """Check that estimates are finite and within their bounds, that variances are not negative, and that the
    state is near the measurement at samples that have one.
    """
    for name in ESTIMATES:
        assert np.isfinite(getattr(estimates, name)[~missing if name == "innovation" else ...]).all(), name
    beta = np.asarray(tuning.h) ** estimates.alpha * estimates.f
    assert (estimates.alpha >= 0).all()
    assert (estimates.alpha <= 2).all()
    assert (beta <= 1 + 1e-12).all()
    assert (beta >= -2 * 2**estimates.alpha * (1 + 1e-12)).all()
    for name in ("alpha_var", "f_var", "P", "innovation_var"):
        assert (getattr(estimates, name) >= 0).all(), name
    rounding = 1e-12 * (np.abs(y) + np.abs(np.nan_to_num(estimates.innovation)))
    far = np.abs(y - estimates.x) > 4 * np.sqrt(np.asarray(tuning.R)) * (1 + 1e-9) + rounding
    assert not far[~missing].any()


numbers = st.floats(-LARGEST_INPUT, LARGEST_INPUT, allow_nan=False)
variances = st.floats(-60, 60).map(lambda exponent: 10.0**exponent)
small_variances = st.one_of(st.just(0.0), st.floats(-9, 9).map(lambda exponent: 10.0**exponent))


@pytest.mark.parametrize("tuning", GUARDED, ids=kind)
@given(data=st.data())
def test_no_input_and_no_settings_leave_the_bounds(tuning: LaneSettings, data: Any) -> None:
    n = data.draw(st.integers(1, 40))
    y = np.array(data.draw(st.lists(numbers, min_size=n, max_size=n)))[:, np.newaxis]
    u = np.array(data.draw(st.lists(numbers, min_size=n, max_size=n)))[:, np.newaxis]
    missing = np.array(data.draw(st.lists(st.booleans(), min_size=n, max_size=n)))[:, np.newaxis]
    if data.draw(st.booleans()):
        u = np.zeros_like(u)
    tuning = with_(
        tuning,
        h=data.draw(st.floats(1e-6, 10)),
        R=data.draw(variances),
        state__Q=data.draw(st.one_of(st.just(0.0), variances)),
        state__P0=data.draw(variances),
        state__x0=data.draw(numbers),
        order__P0=data.draw(small_variances),
        order__Q0=data.draw(small_variances),
        order__alpha0=data.draw(st.floats(0, 2)),
        order__delta=data.draw(st.floats(0, 1)),
        parameter__P0=data.draw(variances),
        parameter__Q0=data.draw(variances),
        parameter__f0=data.draw(numbers),
        parameter__delta=data.draw(st.floats(0, 1)),
        joint__P0=data.draw(small_variances),
        joint__Q0=data.draw(small_variances),
        joint__alpha0=data.draw(st.floats(0, 2)),
        joint__beta0=data.draw(st.floats(-2, 1)),
        joint__delta=data.draw(st.floats(0, 1)),
    )
    estimates = Engine(1, tuning).run(np.where(missing, np.nan, y), u, missing)
    assert_within_bounds(tuning, estimates, y, missing)


def wild_signals(n: int) -> Array:
    """Return signals of a broken sensor, a wrong range or a wrong unit, as an array (n, signals)."""
    noise = white(n, 1, 1)[:, 0]
    spikes = noise.copy()
    spikes[:: n // 9] = 2000.0
    step = np.where(np.arange(n) < n // 2, noise, noise + 300)
    patterns = [
        np.zeros(n),
        np.full(n, 7.0),
        spikes,
        step,
        np.clip(noise * 1e6, -2000, 2000),
        np.cumsum(noise) * 10,
        2000 * saw_tooth(n, 5),
        np.where(np.arange(n) % 2, 1.0, -1.0),
    ]
    return np.column_stack([pattern * scale for pattern in patterns for scale in (1e-12, 1.0, 1e12)])


@pytest.mark.parametrize("ratio", [0.1, 1.0, 10.0])
@pytest.mark.parametrize("tuning", GUARDED, ids=kind)
def test_wild_signals_leave_the_state_at_the_measurement(tuning: LaneSettings, ratio: float) -> None:
    y = wild_signals(1500)
    tuning = with_(tuning, window=3000, R=0.0235 * ratio)
    estimates = run(tuning, y)
    assert_within_bounds(tuning, estimates, y, np.zeros(y.shape, dtype=bool))


@pytest.mark.parametrize("guard", ["faithful", "consistent"])
@pytest.mark.parametrize("variant", ["triple", "joint"])
def test_a_prediction_cannot_run_away(guard: str, variant: str) -> None:
    # With α = 1 and h^α f = -4, the state is multiplied by h^α f + α = -3 at each sample. The filter of the
    # paper reaches 1e300 after 630 missing samples.
    tuning = with_(
        GYROSCOPE,
        variant=variant,
        guard=guard,
        order__P0=0,
        order__Q0=0,
        parameter__P0=0,
        parameter__Q0=0,
        parameter__f0=-400,
        joint__alpha0=1,
        joint__P0=0,
        joint__Q0=0,
        joint__beta0=-4,
    )
    y = np.r_[white(20, 1, 3)[:, 0], np.zeros(3000)][:, np.newaxis]
    missing = np.arange(len(y))[:, np.newaxis] >= 20
    free = Engine(1, with_(tuning, guard="off")).run(y, missing=missing)
    assert not np.isfinite(free.x).all()
    held = Engine(1, tuning).run(y, missing=missing)
    assert np.isfinite(held.x).all()
    assert np.isfinite(held.P).all()
    assert np.abs(held.x).max() < 10 * (np.abs(y).max() + 4 * 0.0235**0.5 + 0.15**0.5 + 0.1 + 1e-9)
    assert counted(held)["state_bound"] > 2900


@pytest.mark.parametrize("memory", ["direct", "compressed"])
@pytest.mark.parametrize("variant", ["triple", "joint"])
def test_a_guard_that_is_never_needed_changes_no_bit(variant: str, memory: str) -> None:
    y, u = white(3000, 8, 4), white(3000, 8, 5)
    tuning = with_(GYROSCOPE, variant=variant, memory=memory, R=0.3, gate=8.0)
    printed, guarded = (run(with_(tuning, guard=guard), y, u) for guard in ("off", "faithful"))
    assert not guarded.interventions[:, :-1].any()
    quiet = ~printed.interventions.any(axis=1)
    assert quiet.any()
    for name in ESTIMATES:
        assert np.array_equal(getattr(printed, name)[:, quiet], getattr(guarded, name)[:, quiet])


class Walk(NamedTuple):
    """Settings and state of a filter that estimates the order α or the parameter f as a random walk."""

    value: float
    P: float
    Q: float
    R: float
    delta: float


def c(a: float, n: int) -> list[float]:
    result = [1.0]
    for j in range(1, n + 1):
        result.append(result[-1] * (1 - (a + 1) / j))
    return result


def unscented(walk: Walk, y: float, output: Callable[[float], float]) -> Walk:
    P = walk.P + walk.Q
    root = math.sqrt(3 * P)
    points = [walk.value, walk.value + root, walk.value - root]
    Y = [output(point) for point in points]
    Wm, Wc = [2 / 3, 1 / 6, 1 / 6], [8 / 3, 1 / 6, 1 / 6]
    predicted = sum(Wm[i] * Y[i] for i in range(3))
    Pyy = walk.R
    Pxy = 0.0
    for i in range(3):
        Pyy += Wc[i] * (Y[i] - predicted) ** 2
        Pxy += Wc[i] * (points[i] - walk.value) * (Y[i] - predicted)
    K = Pxy / Pyy
    correction = K * (y - predicted)
    return walk._replace(
        value=walk.value + correction,
        P=P - K * Pyy * K,
        Q=(1 - walk.delta) * walk.Q + walk.delta * correction**2,
    )


def test_consistent_equals_a_straight_loop() -> None:
    # The expected filters are those of the paper, but with a larger variance in place of the measurement's
    # variance R. The filters of the order (KFo) and of the parameter f (KFw) add the predicted variance of
    # the state, which includes V, the variance of the weighted past states. KFo uses V of the last sample.
    # KFw runs later and uses V of this sample.
    n, h, Q, R = 60, 0.01, 0.15, 0.0235
    y = white(n, 1, 12)[:, 0]
    order, parameter = Walk(1.0, 0.01, 0.1, R, 0.5), Walk(0.0, 0.01, 0.1, R, 0.5)
    states, variances, V = [0.0], [0.01], 0.0
    expected = []
    for k in range(1, n + 1):

        def past(a: float, k: int = k) -> float:
            return sum(c(a, k)[j] * states[k - j] for j in range(1, k + 1))

        x, P, f = states[-1], variances[-1], parameter.value

        def output(a: float, f: float, x: float = x) -> float:
            return h**a * f * x - past(a)

        F = h**order.value * f + order.value
        order = unscented(order._replace(R=R + F * P * F + Q + V), y[k - 1], lambda a, f=f: output(a, f))  # type: ignore[misc]
        a, F = order.value, h**order.value * f + order.value
        V = sum(c(a, k)[j] ** 2 * variances[k - j] for j in range(2, k + 1))
        P = F * P * F + Q + V
        x = output(a, f)
        parameter = unscented(parameter._replace(R=R + P), y[k - 1], lambda f, a=a: output(a, f))  # type: ignore[misc]
        states.append(x + P / (P + R) * (y[k - 1] - x))
        variances.append(P * R / (P + R))
        expected.append((a, order.P, parameter.value, parameter.P, states[-1], variances[-1]))
    estimates = run(with_(GYROSCOPE, guard="consistent", gate=1e3), y[:, np.newaxis])
    assert not estimates.interventions.any()
    np.testing.assert_allclose(columns(estimates)[:, :6], expected, rtol=1e-10, atol=1e-13)


def test_faithful_gate_softens_the_update_to_its_width() -> None:
    # By hand: the measurement y is far from the prediction. The guard limits the innovation e to `gate`
    # standard deviations: it makes the innovation's variance (e / gate)². The correction of α is e Pαy
    # divided by this variance, so it is gate² Pαy / e. Pαy: covariance of α and y.
    gate, y = 4.0, np.array([[50.0]])
    tuning = with_(GYROSCOPE, guard="faithful", gate=gate, order__P0=0.001, order__Q0=0.001)
    estimates = run(tuning, y, np.array([[1.0]]))
    a = np.array([1.0, 1 + np.sqrt(0.006), 1 - np.sqrt(0.006)])
    Y = 0.01**a
    predicted = np.array([2 / 3, 1 / 6, 1 / 6]) @ Y
    P_ay = ((a - 1) * (Y - predicted))[1:].sum() / 6
    expected = 1 + gate**2 * P_ay / (50.0 - predicted)
    assert estimates.alpha[0, 0] == pytest.approx(expected, rel=1e-12)
    assert counted(estimates)["order_gate"] == 1
    assert counted(estimates)["state_bound"] == 1
    # By hand: the guard limits the state filter's innovation e to 4 standard deviations: it makes the
    # innovation's variance S = (e / 4)². The state x then differs from the measurement by e R / S = 16 R / e.
    assert abs(50.0 - estimates.x[0, 0]) == pytest.approx(16 * 0.0235 / estimates.innovation[0, 0], rel=1e-9)


@pytest.mark.parametrize("guard", ["faithful", "consistent"])
def test_the_state_bound_begins_at_four_deviations(guard: str) -> None:
    # With P0 = Q = 0, the prediction of the state is certain, so the variance of the innovation is that of
    # the measurement, R.
    R = 0.04
    tuning = with_(GYROSCOPE, guard=guard, state__P0=0, state__Q=0, R=R)
    y = np.array([[-3.99, 3.99, 4.01, -4.01]]) * R**0.5
    estimates = run(tuning, y)
    assert estimates.interventions[:, CAUSES.index("state_bound")].tolist() == [0, 0, 1, 1]
    assert (estimates.x[0, :2] == 0).all()
    np.testing.assert_allclose(np.abs(y - estimates.x)[0, 2:], 16 / 4.01 * R**0.5, rtol=1e-12)


@pytest.mark.parametrize("guard", ["faithful", "consistent"])
def test_the_walk_learns_from_the_correction_that_the_box_left(guard: str) -> None:
    # The prediction of a sample is (f + α) x. With f0 = 0 and x0 = 1, it is α. So the measurement 3 pulls α
    # from 1.9 to beyond 2, the largest permitted value. The guard keeps α at 2, so α changes by only 0.1.
    # With the forgetting factor delta = 1, the variance Q of α's random walk becomes the square of this
    # change, 0.01. The later estimates are those of a filter that has Q = 0.01 from the beginning (and the
    # same P0 + Q0).
    state = StateSettings(x0=1, P0=0, Q=0)
    learning = OrderSettings(P0=0.2, Q0=0.1, alpha0=1.9, delta=1)
    told = OrderSettings(P0=0.29, Q0=0.01, alpha0=1.9, delta=0)
    after = []
    for order in (learning, told):
        engine = Engine(1, with_(GYROSCOPE, guard=guard, order=order, state=state))
        first = engine.step([3.0])
        assert first.alpha == 2.0
        assert first.interventions[0, CAUSES.index("order_box")] == 1
        after.append(engine.step([1.5]))
    assert after[0].alpha_var[0] == pytest.approx(after[1].alpha_var[0], rel=1e-12)
    assert after[0].alpha_var[0] != pytest.approx(first.alpha_var[0], rel=1e-3)


def test_every_cause_can_be_provoked() -> None:
    y, u = white(400, 3, 5), np.zeros((400, 3))
    y[:, 1] += 5.0
    y[200:, 2] += 1000.0
    total = dict.fromkeys(CAUSES, 0)
    wide = with_(GYROSCOPE, parameter__P0=1e9, parameter__Q0=1e9, order__P0=3.0)
    for tuning in (with_(GYROSCOPE, guard="faithful"), with_(wide, guard="faithful"), with_(GYROSCOPE)):
        for cause, n in counted(run(with_(tuning, memory="compressed"), y, u)).items():
            total[cause] += n
    assert all(total.values()), total


def test_a_cause_counts_once_a_sample_and_only_for_its_lane() -> None:
    y = white(300, 2, 6)
    y[200:205, 1] = [9.0, -9.0, 9.0, -9.0, 9.0]
    tuning = with_(GYROSCOPE, R=0.3, gate=8.0)
    estimates = run(with_(tuning, guard="faithful"), y)
    assert not estimates.interventions[0].any()
    assert 1 <= estimates.interventions[1, CAUSES.index("order_gate")] <= 5
    assert 1 <= estimates.interventions[1, CAUSES.index("state_bound")] <= 5
    assert not run(tuning, y).interventions.any()


@settings(max_examples=50)
@case(value=float("nan"))
@case(value=float("inf"))
@case(value=1e300)
@given(value=st.floats(min_value=LARGEST_INPUT, exclude_min=True))
def test_numbers_that_have_no_square_are_refused_and_change_nothing(value: float) -> None:
    y = white(6, 2, 7)
    engine, twin = Engine(2, GYROSCOPE), Engine(2, GYROSCOPE)
    engine.run(y[:3])
    for sign, name in itertools.product((-1, 1), ("y", "u")):
        block = {"y": y[3:].copy(), "u": np.zeros((3, 2))}
        block[name][1, 1] = sign * value
        with pytest.raises(ValueError, match=rf"{name}\[1\], lane 1"):
            engine.run(**block)
    twin.run(y[:3])
    assert same(engine.run(y[3:]), twin.run(y[3:]))
