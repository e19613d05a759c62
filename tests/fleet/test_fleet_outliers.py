"""Who is unlike the others: on made-up fleets with and without odd sensors."""

import numpy as np
import pytest
from fltea.fleet.figures import figures_of
from fltea.fleet.messages import AxisFit, Interval
from fltea.fleet.outliers import FEWEST, comparisons_of, judge
from hypothesis import given
from hypothesis import strategies as st


def alarms(sensors: int, spread: float, fleets: int) -> float:
    """Share of fleets without an odd sensor in which one is called odd."""
    rng = np.random.default_rng(sensors)
    found = 0
    for _ in range(fleets):
        std = np.exp(rng.normal(0, 0.7, sensors))
        value = rng.normal(0, np.hypot(spread, std))
        found += bool(judge(value, value - 1.96 * std, value + 1.96 * std, comparisons=sensors)[1])
    return found / fleets


@pytest.mark.parametrize("sensors", [8, 200])
@pytest.mark.parametrize("spread", [0.0, 2.0])
def test_false_alarms_are_as_rare_as_stated(sensors: int, spread: float) -> None:
    """One of 1000 fleets; of 150 three are beyond any chance."""
    assert alarms(sensors, spread, 150) <= 2 / 150


@pytest.mark.parametrize("odd", [1, 20])
def test_odd_sensors_are_found_and_move_nothing(odd: int) -> None:
    rng = np.random.default_rng(3)
    std = np.exp(rng.normal(-3, 0.3, 200))
    value = rng.normal(1.0, np.hypot(0.1, std))
    value[:odd] = 2.5
    fleet, found = judge(value, value - 1.96 * std, value + 1.96 * std, comparisons=3000)
    assert fleet is not None
    assert sorted(one.place for one in found) == list(range(odd))
    assert fleet.middle == pytest.approx(1.0, abs=0.04)
    assert fleet.spread == pytest.approx(0.1, rel=0.35)


def test_a_wide_interval_excuses() -> None:
    """The same distance, known well and known badly."""
    value = np.r_[np.linspace(-1, 1, 40), 8.0, 8.0]
    std = np.r_[np.full(40, 0.1), 0.1, 8.0]
    _, found = judge(value, value - 1.96 * std, value + 1.96 * std, comparisons=100)
    assert [one.place for one in found] == [40]


def test_few_sensors_are_not_judged() -> None:
    value = np.r_[np.zeros(FEWEST - 2), 1e9]
    assert judge(value, value - 1, value + 1, comparisons=7) == (None, [])
    value = np.r_[value, 0.0]
    assert judge(value, value - 1, value + 1, comparisons=8)[0] is not None
    assert comparisons_of([FEWEST - 1, FEWEST, 20]) == FEWEST + 20


@given(
    st.lists(st.tuples(st.floats(-50, 50), st.floats(0.01, 5)), min_size=8, max_size=40),
    st.floats(-100, 100),
    st.floats(0.01, 100),
)
def test_units_do_not_matter(sensors: list[tuple[float, float]], shift: float, factor: float) -> None:
    value, std = np.array(sensors).T
    here = judge(value, value - std, value + std, comparisons=100)
    there = judge(*((one * factor + shift) for one in (value, value - std, value + std)), comparisons=100)
    assert here[0] is not None
    assert there[0] is not None
    assert there[0].middle == pytest.approx(here[0].middle * factor + shift, abs=1e-6 * factor + 1e-6)
    near = min((abs(abs(one.p) - 1e-4) for one in here[1]), default=1.0)
    assert [one.place for one in here[1]] == [one.place for one in there[1]] or near < 1e-6


@pytest.mark.parametrize(("R", "rate_hz"), [(1e308, 100.0), (1.0, 1e-308), (1e-320, 1e308)])
def test_figures_that_are_no_numbers_are_left_out(R: float, rate_hz: float) -> None:
    fit = AxisFit("drift", "text", "deg/s", R=Interval(R, R / 2, R * 1.5))
    for figure in figures_of(fit, rate_hz, {}).values():
        assert 0 <= figure.low < figure.high < float("inf")


def test_an_interval_that_is_far_too_narrow_makes_nobody_odd() -> None:
    """Of a likelihood with two maxima: the value is in the tail of the others, its interval is narrow."""
    rng = np.random.default_rng(8)
    std = np.full(40, 0.1)
    value = rng.normal(0, std)
    value[7], std[7] = -0.35, 0.01
    assert judge(value, value - 1.96 * std, value + 1.96 * std, comparisons=200)[1] == []


def test_a_distance_is_in_deviations_of_an_interval_of_95_percent() -> None:
    """Where sensors do not differ by themselves."""
    value = np.zeros(20)
    value[7] = 100.0
    half = 1.959963984540054 * 2
    fleet, odd = judge(value, value - half, value + half, comparisons=1)
    assert fleet is not None
    assert fleet.spread == 0
    assert [(one.place, one.distance) for one in odd] == [(7, pytest.approx(50.0))]
