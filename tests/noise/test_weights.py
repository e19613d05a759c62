"""The weights of past samples in the numpy reference, and the weighted sums of the past."""

from math import comb

import mpmath
import numpy as np
import pytest
from fltea.noise.memory import NewestFirst
from fltea.noise.weights import weights
from hypothesis import given, settings
from hypothesis import strategies as st


# The weight of the sample j steps back is that of the sample j - 1 steps back times 1 - (order + 1) / j. For
# an integer order, this factor has to be exactly 0 at j = order + 1, so that all later weights are 0. Order
# 48 is included, since 49 * (1/49) is not 1 in floating-point numbers.
@pytest.mark.parametrize("order", [*range(9), 48])
def test_integer_orders_are_signed_binomials_and_end_in_exact_zeros(order: int) -> None:
    c = weights(float(order), 100)
    assert c[: order + 1] == pytest.approx([(-1) ** j * comb(order, j) for j in range(order + 1)], rel=2e-14)
    assert not c[order + 1 :].any()


@settings(derandomize=True, deadline=None, max_examples=60)
@given(st.floats(-0.9, 3))
def test_real_orders_against_arbitrary_precision(order: float) -> None:
    # The weight of the sample j steps back is a product of j factors, each of which is rounded three times.
    # At j = 5000 the sum of these errors is at most 5000 * 3 * 1.1e-16 = 1.7e-12. The absolute tolerance is
    # for orders so near to 0 that even the 40 digits of the exact value are not enough.
    c = weights(order, 5000)
    for j in (0, 1, 2, 3, 4, 10, 100, 1000, 5000):
        with mpmath.workdps(40):
            exact = float((-1) ** j * mpmath.binomial(mpmath.mpf(order), j))
        assert c[j] == pytest.approx(exact, rel=2e-12, abs=1e-30)


def test_several_orders_are_the_rows_of_single_ones() -> None:
    orders = np.array([-0.5, 0.0, 0.3, 2.0])
    together = weights(orders, 777)
    assert together.shape == (4, 778)
    for row, order in zip(together, orders, strict=True):
        assert np.array_equal(row, weights(order, 777))


@pytest.mark.parametrize("n", [0, 1, 2, 3, 4, 7, 8, 9])
def test_lengths_around_powers_of_two(n: int) -> None:
    assert np.array_equal(weights(0.3, n), weights(0.3, 100)[: n + 1])


def test_a_huge_order_is_not_an_exception() -> None:
    with np.errstate(all="ignore"):
        assert not np.isfinite(weights(1e9, 100)).all()


def test_wrong_arguments() -> None:
    with pytest.raises(ValueError, match="n >= 0"):
        weights(0.5, -1)
    with pytest.raises(ValueError, match="shape"):
        weights(np.ones((2, 2)), 3)


@settings(derandomize=True, deadline=None, max_examples=50)
@given(window=st.integers(1, 9), pushes=st.integers(0, 50))
def test_holds_the_newest_first(window: int, pushes: int) -> None:
    memory = NewestFirst(window)
    for value in range(pushes):
        memory.push(float(value))
        expected = list(range(value, max(-1, value - window), -1))
        assert memory.values.tolist() == expected
        assert len(memory) == len(expected)


def test_arrays_are_copied_and_contiguous() -> None:
    memory = NewestFirst(3, (2, 2))
    P = np.empty((2, 2))
    for k in range(8):
        P[:] = k
        memory.push(P)
    assert memory.values[:, 0, 0].tolist() == [7, 6, 5]
    assert memory.values.flags.c_contiguous
    assert (len(memory), memory.window) == (3, 3)


@pytest.mark.parametrize("window", [0, -1])
def test_a_window_has_at_least_one_sample(window: int) -> None:
    with pytest.raises(ValueError, match="window must be at least 1 sample"):
        NewestFirst(window)
