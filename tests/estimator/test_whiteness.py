"""Figures on innovations against their definitions, and against sequences whose answer is known."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sample_by_sample import BLOCK, BLOCKS, FEWEST, Whiteness


def filled(innovations: list[float], std: float = 1.0) -> Whiteness:
    white = Whiteness()
    for innovation in innovations:
        white.add(innovation, std)
    return white


def test_nothing_is_said_of_a_few() -> None:
    values = np.random.default_rng(1).normal(size=FEWEST).tolist()
    assert (filled(values[:-1]).lag1, filled(values[:-1]).nis) == (None, None)
    assert filled(values).lag1 is not None
    assert filled(values).nis is not None


@pytest.mark.parametrize("rho", [0.0, 0.7, -0.5])
def test_first_order_correlation_is_found(rho: float) -> None:
    rng = np.random.default_rng(2)
    x = np.zeros(5000)
    for k in range(1, len(x)):
        x[k] = rho * x[k - 1] + rng.normal()
    n = BLOCK * (BLOCKS - 1)
    assert filled(x.tolist()).lag1 == pytest.approx(rho, abs=4 * math.sqrt((1 - rho**2) / n))


def test_nis_is_one_where_the_variance_is_right_and_scales_with_it() -> None:
    values = (np.random.default_rng(3).normal(size=1000) * 0.3).tolist()
    assert filled(values, 0.3).nis == pytest.approx(1.0, abs=0.2)
    assert filled(values, 0.6).nis == pytest.approx(filled(values, 0.3).nis / 4)


@given(st.lists(st.floats(-1e6, 1e6), min_size=FEWEST, max_size=3 * BLOCK))
def test_equal_to_the_definition_while_nothing_is_forgotten(values: list[float]) -> None:
    x = np.array(values)
    white = filled(values, 2.0)
    squares = float((x * x).sum())
    assert white.nis == pytest.approx(squares / 4 / len(x))
    if squares > 0:
        assert white.lag1 == pytest.approx(float((x[1:] * x[:-1]).sum()) / squares, abs=1e-9)
        assert abs(white.lag1 or 0) <= 1 + 1e-9
    else:
        assert white.lag1 is None


def test_the_past_is_forgotten() -> None:
    white = filled([1e12] * 500)
    for value in np.random.default_rng(4).normal(size=BLOCK * BLOCKS).tolist():
        white.add(value, 1.0)
    assert white.nis == pytest.approx(1.0, abs=0.2)


def test_neighbours_of_a_gap_are_no_pair() -> None:
    white = Whiteness()
    for k in range(FEWEST):
        white.add((-1.0) ** (k // 2), 1.0)
        if k % 2:
            white.skip()
    assert white.lag1 == pytest.approx(0.5)  # every pair that is left is equal; half as many as squares


def test_a_later_lag_is_seen_where_the_first_is_not() -> None:
    """Every second innovation is like the one before the last."""
    rng = np.random.default_rng(5)
    x = np.zeros(1000)
    for k in range(2, len(x)):
        x[k] = 0.5 * x[k - 2] + rng.normal()
    white = filled(x.tolist())
    assert abs(white.lag1 or 0) < 0.15
    assert white.describes_noise is False
    assert filled(rng.normal(size=1000).tolist()).describes_noise is True
    assert filled(x[: FEWEST - 1].tolist()).describes_noise is None
