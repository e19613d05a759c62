"""The oracle's own rules, written out once more: the native estimators follow it (test_lanes, test_bank)."""

import math

import numpy as np
import pytest
from fltea.estimator.lanes import BOUND_SAMPLES, BOUND_SHARE, LOST_ORDER
from hypothesis import given
from hypothesis import strategies as st
from sample_by_sample import BLOCK, BLOCKS, FEWEST, GOOD, Supervisor, Verdict, whiteness


@pytest.mark.parametrize(
    ("alpha", "f", "state", "lost"),
    [
        (0.3, -1.5, 0.1, False),
        (LOST_ORDER, -1e300, 1e300, False),
        (math.nextafter(LOST_ORDER, 9), -1.5, 0.1, True),
        (-5.1, -1.5, 0.1, True),
        (math.nan, -1.5, 0.1, True),
        (0.3, math.inf, 0.1, True),
        (0.3, -1.5, math.nan, True),
    ],
)
def test_what_is_a_runaway(alpha: float, f: float, state: float, lost: bool) -> None:
    verdict = Supervisor().judge(alpha, f, state, state_bound=False)
    assert verdict == (Verdict(False, True, "runaway") if lost else GOOD)


@given(st.lists(st.booleans(), max_size=900))
def test_the_share_of_bounded_samples_decides_and_ends_with_a_restart(bounds: list[bool]) -> None:
    """Against the rule written out: shares over the last samples, entry above, exit at half."""
    supervisor, distrusted = Supervisor(), False
    for k, bound in enumerate(bounds):
        share = sum(bounds[max(0, k - BOUND_SAMPLES + 1) : k + 1]) / BOUND_SAMPLES
        verdict = supervisor.judge(0.3, -1.5, 0.0, state_bound=bound)
        if not distrusted:
            distrusted = share > BOUND_SHARE
            assert verdict == (Verdict(False, False, "bound") if distrusted else GOOD)
        else:
            distrusted = share > BOUND_SHARE / 2
            assert verdict == Verdict(False, not distrusted, None)


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
    assert whiteness(apart).lag1 == pytest.approx(
        0.5
    )  # every pair that is left is equal; half as many as squares
