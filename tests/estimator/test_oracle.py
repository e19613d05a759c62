"""Tests of `whiteness`, which computes in plain Python whether innovations are correlated, and as large as
predicted. In test_bank.py, the native estimators are compared with it.
"""

import math

import numpy as np
import pytest

from tests.rig.sample_by_sample import BLOCK, BLOCKS, FEWEST, whiteness


def autoregression(lag: int, rho: float, n: int) -> list[tuple[float, float]]:
    x = np.random.default_rng(2).normal(size=n)
    for k in range(lag, n):
        x[k] += rho * x[k - lag]
    return [(value, 2.0) for value in x.tolist()]


@pytest.mark.parametrize("rho", [0.0, 0.7, -0.5])
def test_correlation_and_size_of_innovations_are_found(rho: float) -> None:
    found = whiteness(autoregression(1, rho, 5000))
    n = BLOCK * (BLOCKS - 1)
    assert found.lag1 == pytest.approx(rho, abs=4 * math.sqrt((1 - rho**2) / n))
    assert found.nis == pytest.approx(1 / (1 - rho**2) / 4, rel=0.25)
    assert found.is_white is (rho == 0)


def test_a_later_lag_is_seen_where_the_first_is_not() -> None:
    found = whiteness(autoregression(2, 0.5, 1000))
    assert abs(found.lag1 or 0) < 0.15
    assert found.is_white is False


def test_few_innovations_the_past_and_neighbours_of_a_gap_do_not_count() -> None:
    white = autoregression(1, 0.0, FEWEST + BLOCK * BLOCKS)
    assert whiteness(white[: FEWEST - 1]) == (None, None, None)
    assert None not in whiteness(white[:FEWEST])
    assert whiteness([(1e12, 1.0)] * 500 + white).nis == pytest.approx(0.25, rel=0.2)
    pairs = [((-1.0) ** k, 1.0) for k in range(FEWEST // 2) for _ in range(2)]
    apart = [row for k, one in enumerate(pairs) for row in ([one, None] if k % 2 else [one])]
    # Neighbours with a gap (None) between them do not count. The other pairs of neighbours are equal, and are
    # half as many as the innovations.
    assert whiteness(apart).lag1 == pytest.approx(0.5)
