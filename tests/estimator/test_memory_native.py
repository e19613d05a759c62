"""Tests of the native memories of past samples: elementary functions, sums, compressed weights, invalid
states.
"""

from collections.abc import Callable, Iterable, Mapping
from functools import cache
from typing import Any

import mpmath
import numpy as np
import pytest
from fltea.noise.weights import weights
from hypothesis import example, given, settings
from hypothesis import strategies as st

from tests.rig.memory_probe import DIRECT, SETS, Memory, math
from tests.rig.tiers import slow, slow_but

EPS = {"f": 2.0**-24, "d": 2.0**-53, "w": 2.0**-53}

finite = st.floats(allow_nan=False, allow_infinity=False)
orders_in_range = st.floats(-0.9, 3)


def history(n: int, seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    random = np.random.default_rng(seed)
    return random.standard_normal(n), random.uniform(0.5, 2, n)


def exact_sums(a: float, x: np.ndarray, P: np.ndarray, window: int = 0) -> tuple[float, float]:
    """Return the sums S (of states) and V (of variances) over past samples, with the weights of the numpy
    reference.

    The arrays `x` (states) and `P` (variances) begin with the oldest sample.
    """
    n = min(len(x), window) if window else len(x)
    if n == 0:
        return 0.0, 0.0
    c = weights(a, n)[1:]
    return float(c @ x[::-1][:n]), float((c[1:] ** 2) @ P[::-1][1:n])


# --- elementary functions


@cache
def exact_exp(kind: str) -> tuple[np.ndarray, np.ndarray]:
    """Return numbers x, which are floats if `kind` is "f" and doubles otherwise, and exp(x) to more digits
    than a double has.
    """
    span = 86.9 if kind == "f" else 707.9
    random = np.random.default_rng(1)
    x = np.concatenate((random.uniform(-span, span, 3000), random.uniform(-3, 3, 3000), [0, -0.0, 1e-300]))
    x = x.astype(np.float32).astype(np.float64) if kind == "f" else x
    return x, to_more_digits(mpmath.exp, x)


@cache
def exact_sine(kind: str) -> tuple[np.ndarray, np.ndarray]:
    """Return numbers x, which are floats if `kind` is "f" and doubles otherwise, and sin(πx) to more digits
    than a double has.
    """
    x = np.random.default_rng(2).uniform(-6, 6, 4000)
    x = x.astype(np.float32).astype(np.float64) if kind == "f" else x
    return x, to_more_digits(mpmath.sinpi, x)


def to_more_digits(function: Callable[[float], Any], x: np.ndarray) -> np.ndarray:
    assert np.finfo(np.longdouble).eps < EPS["d"] / 1000
    with mpmath.workdps(40):
        return np.array([mpmath.nstr(function(value), 30) for value in x]).astype(np.longdouble)


@pytest.mark.parametrize("instruction_set", SETS)
@pytest.mark.parametrize("kind", slow_but("dw", "fdw"))
def test_exp_to_two_units_in_the_last_place(kind: str, instruction_set: str) -> None:
    x, expected = exact_exp("d" if kind == "w" else kind)
    up, down, _ = math(kind, x, instruction_set)
    assert (abs(up / expected - 1) <= 4 * EPS[kind]).all()
    assert (abs(down * expected - 1) <= 4 * EPS[kind]).all()


@pytest.mark.parametrize("instruction_set", SETS)
@pytest.mark.parametrize("kind", "fdw")
def test_sine_to_a_few_units_in_the_last_place_and_zero_at_integers(kind: str, instruction_set: str) -> None:
    x, expected = exact_sine("d" if kind == "w" else kind)
    sine = math(kind, x, instruction_set)[2]
    assert (abs(sine - expected) <= 4 * EPS[kind] * abs(expected)).all()
    integers = np.array([0.0, 1, -1, 2, 3, 4, -7, 1e6, 2.0**22, 2.0**51])
    assert not math(kind, integers, instruction_set)[2].any()
    halves = np.array([0.5, 1.5, -0.5, 2.5, 1e6 + 0.5])
    np.testing.assert_allclose(math(kind, halves, instruction_set)[2], [1, -1, -1, 1, 1], rtol=4 * EPS[kind])


@given(x=finite)
@example(x=6.53021945968722e16)
@example(x=-1.7e308)
def test_functions_are_finite_for_every_finite_number(x: float) -> None:
    up, down, sine = math("w", np.array([x]))
    assert 0 < up[0] < np.inf
    assert 0 < down[0] < np.inf
    assert abs(sine[0]) <= 1


# --- the direct memory, which keeps all past states


@given(
    a=st.floats(-2, 8),
    window=st.integers(1, 60),
    n=st.integers(0, 130),
    seed=st.integers(0, 2**32),
)
@settings(max_examples=150)
def test_direct_sums_are_the_references(a: float, window: int, n: int, seed: int) -> None:
    x, P = history(n, seed)
    memory = Memory(DIRECT, window)
    memory.push(x, P)
    S, V = memory.sums(a)
    c = weights(a, window)
    # The rounding error of nested sums is relative to the sum of the terms' magnitudes, not to the sum
    # itself.
    expected_S, expected_V = exact_sums(a, x, P, window)
    assert abs(S[0] - expected_S) <= 1e-14 * (abs(c).sum() * (abs(x).max() if n else 0))
    assert abs(V[0] - expected_V) <= 1e-13 * expected_V
    (several, _), V_alone = memory.evaluate([0.5, a, 1.5]), memory.evaluate([a, a, a])[1]
    assert several[1, 0] == pytest.approx(S[0], rel=0, abs=1e-14 * abs(c).sum() * 10)
    assert V_alone[0] == V[0]


@pytest.mark.parametrize("digits", [DIRECT, 6])
@pytest.mark.parametrize("instruction_set", SETS)
def test_integer_orders_are_ordinary_differences(digits: int, instruction_set: str) -> None:
    x, P = np.arange(1.0, 401.0) ** 3 % 97, np.arange(1.0, 401.0) % 13
    memory = Memory(digits, 300, "w", instruction_set)
    memory.push(x, P)
    new = x[::-1]
    for a, S, V in (
        (0.0, 0.0, 0.0),
        (1.0, -new[0], 0.0),
        (2.0, -2 * new[0] + new[1], P[-2]),
        (3.0, -3 * new[0] + 3 * new[1] - new[2], 9 * P[-2] + P[-3]),
    ):
        tolerance = 1e-15 * 97 * 8
        np.testing.assert_allclose(memory.sums(a)[0], S, rtol=0, atol=tolerance)
        np.testing.assert_allclose(memory.sums(a)[1], V, rtol=1e-15, atol=0)
        np.testing.assert_allclose(memory.evaluate([a, a, a])[0], S, rtol=0, atol=tolerance)


# --- the compressed memory: the weight of one past state


def weight_errors(
    memory: Memory, ages: dict[float, list[int]]
) -> dict[float, tuple[list[float], list[float]]]:
    """Return, for each order, the relative errors of the weights that the memory gives to past samples. The
    state that is j samples old has the weight c_j, and its variance has c_j². `ages`: the tested ages j.

    The memory gets one state of 1 and then zeros, so that its sum after j samples is c_j. All orders use the
    same memory: what it keeps does not depend on the order, only the weights of the sum do.
    """
    memory.reset()
    memory.push([1.0], [1.0])
    age = 1
    found: dict[float, tuple[list[float], list[float]]] = {order: ([], []) for order in ages}
    for j, order in sorted((j, order) for order, some in ages.items() for j in some):
        memory.push_zeros(j - age)
        age = j
        S, V = memory.sums(order)
        with mpmath.workdps(30):
            a = mpmath.mpf(order)
            c = mpmath.gammaprod([j - a], [-a, j + 1])
            found[order][0].append(float(abs(S[0] / c - 1)))
            found[order][1].append(float(abs(V[0] / (c * c) - 1)) if j > 1 else 0.0)
    return found


def bounds(order: float, digits: int) -> tuple[float, float]:
    """Return the relative error that compressed_config() promises for the weights c_j of past samples, and
    the resulting error of their squares (docs/theory/filters.md).
    """
    state = 10.0**-digits * (1 if order <= 1 else 50)
    return state, 10.0**-digits * (100 if order <= 1 else 10_000)


@pytest.mark.parametrize(("digits", "farthest"), [(6, 1e5), slow(3, 1e6), slow(6, 1e6), slow(9, 1e7)])
def test_weights_over_millions_of_samples(digits: int, farthest: float) -> None:
    """The weights are tested for past states that are up to `farthest` samples old. The memory with nine
    digits, which has the smallest error bounds, is tested with the oldest states.
    """
    random = np.random.default_rng(3)
    ages: dict[float, list[int]] = {}
    for order in [-0.9, *random.uniform(-0.9, 3, 6), 0.999999, 1 + 1e-9, 2.9999]:
        far = np.unique(np.exp(random.uniform(3, np.log(farthest), 12)).astype(int)).tolist()
        ages[float(order)] = [1, 2, 14, 15, 16, 17, *far]
    for order, (state, variance) in weight_errors(Memory(digits), ages).items():
        # The bounds are enlarged by 1e-9 (states) and 1e-8 (variances), for rounding errors of weights that
        # become very small over ten million samples.
        assert max(state[:4]) < 1e-14
        assert max(state) < bounds(order, digits)[0] + 1e-9
        assert max(variance) < bounds(order, digits)[1] + 1e-8


@given(order=orders_in_range, j=st.integers(1, 5000))
@settings(max_examples=80)
def test_weights_anywhere(order: float, j: int) -> None:
    if order in (0, 1, 2, 3) or min(abs(order - n) for n in range(4)) < 1e-100:
        return  # at integer orders, the weights of old samples are 0 and have no relative error
    state, variance = weight_errors(Memory(8), {order: [j]})[order]
    assert state[0] < bounds(order, 8)[0]
    assert variance[0] < bounds(order, 8)[1]


@pytest.mark.parametrize("order", [-1.95, -1.6, -1.3, -1.1, -1.000001, -1.0, -0.999999, -0.95])
def test_orders_below_minus_one_are_the_continuation(order: float) -> None:
    window = 3000
    memory = Memory(6, window)
    memory.push([1.0], [1.0])
    age = 1
    c = weights(order, window)
    for j in (2, 15, 16, 100, 1000, 2900, 3000):
        memory.push_zeros(j - age)
        age = j
        S, V = memory.evaluate([order] * 3)
        assert S[0, 0] == pytest.approx(c[j], rel=1e-6)
        if order >= -1.3:
            assert V[0] == pytest.approx(c[j] ** 2, rel=1e-5)
    memory.push_zeros(1)
    assert abs(memory.evaluate([order] * 3)[0][0, 0]) < 1e-9 * c[window]


# --- the compressed memory: weighted sums of many past states


@pytest.mark.parametrize("window", [1, 2, 10, 15, 16, 100, 3000])
@pytest.mark.parametrize("kind", "dw")
def test_sums_are_those_of_the_direct_memory(window: int, kind: str) -> None:
    compressed, direct = Memory(8, window, kind), Memory(DIRECT, window, kind)
    random = np.random.default_rng(window)
    for seed in range(12):
        n = int(random.integers(1, 2 * window + 3))
        x, P = history(n, seed)
        for memory in (compressed, direct):
            memory.push(x, P)
        orders = random.uniform(-0.9, 3, 3)
        S, V = compressed.evaluate(orders)
        expected_S, expected_V = direct.evaluate(orders)
        np.testing.assert_allclose(S, expected_S, rtol=0, atol=3e-8 * 4)
        np.testing.assert_allclose(V, expected_V, rtol=1e-6)
        if window <= 15:
            np.testing.assert_allclose(S, expected_S, rtol=0, atol=1e-14 * 20)
            np.testing.assert_allclose(V, expected_V, rtol=1e-14)


def assert_like_direct(
    memory: Memory, direct: Memory, orders: Iterable[float], S: Mapping[str, float], V: float
) -> None:
    """Check the memory's sums over past samples.

    S, the sum of states, may differ by the tolerances for states, and V, the sum of variances, by the
    relative tolerance for variances.
    """
    for order in orders:
        found, expected = memory.sums(order), direct.sums(order)
        assert found[0][0] == pytest.approx(expected[0][0], **S)
        assert found[1][0] == pytest.approx(expected[1][0], rel=V)


def test_a_window_of_a_million() -> None:
    compressed, direct = Memory(7, 1_000_000), Memory(DIRECT, 1_000_000)
    for memory in (compressed, direct):
        memory.stir(1_300_000, 5)
    assert_like_direct(compressed, direct, (-0.7, -0.3, 0.2, 0.5, 1.4), {"rel": 1e-6, "abs": 1e-8}, 1e-6)


@given(order=finite, digits=st.sampled_from([DIRECT + 4, 6, 11]), window=st.sampled_from([0, 7, 500]))
@settings(max_examples=300)
def test_every_finite_order_has_finite_sums(order: float, digits: int, window: int) -> None:
    memory = Memory(digits, window)
    memory.push(*history(1000))
    S, V = memory.evaluate([order, -order, order / 2])
    assert np.isfinite(S).all()
    assert np.isfinite(V).all()
    assert V.min() >= 0


@pytest.mark.parametrize(("order", "nearest"), [(-50.0, -1.95), (4.5, 4.0), (1e300, 4.0), (-1e300, -1.95)])
def test_orders_out_of_range_are_the_nearest_inside(order: float, nearest: float) -> None:
    memory = Memory(6, 500)
    memory.push(*history(1000))
    assert (memory.evaluate([order] * 3)[0] == memory.evaluate([nearest] * 3)[0]).all()
    assert memory.sums(order) == memory.sums(max(nearest, -1.3))


@pytest.mark.parametrize("order", [0.0, 1.0, 2.0, 3.0])
def test_sums_are_continuous_at_integer_orders(order: float) -> None:
    memory = Memory(8, 3000)
    memory.push(*history(4000))
    S, V = memory.sums(order)
    for h in (1e-14, 1e-11, 1e-8, 1e-6):
        for near in (order - h, order + h):
            assert memory.sums(near)[0][0] == pytest.approx(S[0], rel=0, abs=20 * h + 1e-13)
            assert memory.sums(near)[1][0] == pytest.approx(V[0], rel=0, abs=60 * h + 1e-13)


def test_variance_is_not_negative_when_rounding_is_all_there_is() -> None:
    memory = Memory(6, 50)
    memory.push(*history(200))
    memory.push_zeros(60)
    for order in np.linspace(-1.3, 4, 107):
        S, V = memory.sums(order)
        assert abs(S[0]) < 1e-12
        assert 0 <= V[0] < 1e-9


@pytest.mark.parametrize("window", [0, 3000])
def test_nothing_grows_over_ten_million_steps(window: int) -> None:
    worn, fresh = Memory(6, window), Memory(6, window)
    worn.stir(10_000_000, 7)
    # with unlimited memory the result depends on all ten million samples, so only its size is tested
    if window == 0:
        for order in (-0.5, 0.3, 0.8):
            S, V = worn.sums(order)
            assert abs(S[0]) < 10
            assert 0 < V[0] < 10
        return
    for memory in (worn, fresh):
        memory.stir(window, 8)
    for order in (-0.9, -0.5, 0.0, 0.3, 0.8, 1.5):
        (S, V), (expected_S, expected_V) = worn.sums(order), fresh.sums(order)
        assert abs(S[0] - expected_S[0]) < 2e-10
        assert abs(V[0] - expected_V[0]) < 2e-10


def test_a_constant_offset_does_not_drift() -> None:
    memory, direct = Memory(8, 3000), Memory(DIRECT, 3000)
    for each in (memory, direct):
        each.push(np.full(50_000, 5.0), np.full(50_000, 0.02))
    assert_like_direct(memory, direct, (-0.5, 0.1, 0.5, 1.2), {"rel": 1e-8}, 1e-7)


def test_float32_is_good_for_six_digits() -> None:
    compressed, direct = Memory(5, 3000, "f"), Memory(DIRECT, 3000)
    x, P = (a.astype(np.float32).astype(np.float64) for a in history(10_000))
    for memory in (compressed, direct):
        memory.push(x, P)
    orders = np.float32([-0.5, -0.2, 0.1, 0.3, 0.5, 0.8, 1.0, 1.7, 2.5])
    assert_like_direct(compressed, direct, orders, {"rel": 0, "abs": 1e-5}, 1e-5)


# --- cost and constants


def test_cost_in_modes() -> None:
    """A compressed memory consists of decaying sums (modes). Their number follows from the number of digits
    and the length of the window.

    The expected numbers are stated here, so that a change of the rule makes the test fail.
    """
    by_digits = [Memory(digits, 3000).modes for digits in (3, 6, 9, 11)]
    assert by_digits == [(16, 16), (32, 28), (48, 48), (64, 64)]
    by_window = [Memory(6, window).modes for window in (10, 1000, 10**6, 0)]
    assert by_window == [(0, 0), (28, 28), (40, 40), (56, 56)]
