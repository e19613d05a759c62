"""Tests of the figures of an axis in a fleet: which figures the verdict permits, and how often their
intervals contain the truth.

Also tested is which sensors count as outliers.
"""

import math
from functools import cache

import msgspec
import numpy as np
import pytest
from fltea.fleet.figures import Figure, figures_of
from fltea.fleet.messages import Allan, AxisFit, Interval
from fltea.fleet.outliers import FEWEST, comparisons_of, judge
from hypothesis import given
from hypothesis import strategies as st

from tools.fleet_fits import NOISES, RATE_HZ, Noise, fits

RECORDS, SAMPLES = 40, 20_000


def fitted(noise: Noise, samples: int, seed: int) -> AxisFit:
    """Return the fields that a fleet reads from a daemon's fit, for simulated noise."""
    record = noise.draw(samples, np.random.default_rng(seed))
    return msgspec.json.decode(msgspec.json.encode(next(fits(record, [samples]))), type=AxisFit)


@cache
def of_white() -> list[tuple[AxisFit, dict[str, Figure]]]:
    found = [fitted(NOISES["white"], SAMPLES, seed) for seed in range(RECORDS)]
    return [(fit, figures_of(fit, RATE_HZ, {})) for fit in found]


@pytest.mark.parametrize("kind", NOISES)
def test_every_noise_with_white_noise_in_it_has_a_density(kind: str) -> None:
    found = figures_of(fitted(NOISES[kind], 40_000, 1), RATE_HZ, {})["density"]
    assert found.value == pytest.approx(math.sqrt(2) * NOISES[kind].N, rel=0.15)
    assert found.low < found.value < found.high
    assert found.high / found.low < 1.3


def test_of_white_noise_19_of_20_intervals_of_the_density_hold_it() -> None:
    """Of 40 intervals of 95 %, at least 34 contain the true density, with a probability of 0.99.

    The median interval is at most twice as wide as necessary.
    """
    truth = math.sqrt(2) * NOISES["white"].N
    held = [figures["density"].low <= truth <= figures["density"].high for _, figures in of_white()]
    assert sum(held) >= RECORDS - 6
    known = 2 * 1.96 / math.sqrt(2 * SAMPLES)
    widths = [math.log(figures["density"].high / figures["density"].low) for _, figures in of_white()]
    assert known < np.median(widths) < 2 * known


def test_a_white_sensors_density_is_that_of_its_angle_random_walk() -> None:
    for _, figures in of_white():
        assert figures["density"] == pytest.approx([math.sqrt(2) * one for one in figures["N"]])


def test_a_density_stays_between_curves() -> None:
    fit, figures = of_white()[0]
    between = msgspec.structs.replace(fit, allan=None)
    assert figures_of(between, RATE_HZ, figures)["density"] == figures["density"]
    assert set(figures_of(between, RATE_HZ, {})) == {"density"}


def test_the_angle_random_walk_of_one_noise_is_the_same_in_all_records() -> None:
    """The Allan curve of this noise has the slope -1/2, that of white noise, in two ranges of averaging
    times.

    In some records the one range is longer, in others the other. N always comes from the same range.
    """
    records = [fitted(NOISES["fractional"], 100_000, seed) for seed in (0, 1)]
    records += [fitted(NOISES["fractional"], 400_000, seed) for seed in (2, 3)]
    kept = [figures_of(fit, RATE_HZ, {})["N"].value for fit in records]
    assert max(kept) < 1.1 * min(kept)


@pytest.mark.parametrize(("verdict", "kept"), [("white", {"N", "density"}), ("undecided", set())])
def test_where_noise_may_have_an_order_and_its_white_noise_is_unknown_there_is_no_density(
    verdict: str, kept: set[str]
) -> None:
    """If noise may have an order α and its white noise is unknown, no density is given.

    In an earlier version, √2 N was given as the density, which is true of white noise only. For a new sensor
    with fractional noise, it was 1.8 times the true density, and wrong by 13 standard deviations.
    """
    fit, _ = of_white()[0]
    R = fit.R if verdict == "white" else Interval(fit.R.value, 0.0, fit.R.high)
    assert set(figures_of(msgspec.structs.replace(fit, verdict=verdict, R=R), RATE_HZ, {})) == kept


def test_a_curve_of_a_hundred_thousand_points_costs_no_more_than_a_usual_one() -> None:
    many = [0.01 * (1 + one) for one in range(100_000)]
    allan = Allan(many, many, many, [2 * one for one in many], N=1.0, B=1.0, K=1.0)
    assert set(figures_of(AxisFit("white", "text", "deg/s", allan=allan), RATE_HZ, {})) <= set("NBK") | {
        "density"
    }


@pytest.mark.parametrize(
    ("alpha", "f", "kept"),
    [
        (Interval(0.5, 0.46, 0.54), Interval(-1.0, -1.5, -0.5), {"alpha", "f"}),
        (Interval(0.5, 0.4, 0.6), Interval(-1.0, -1.5, -0.5), set()),
        (Interval(0.5, 0.46, 0.54), Interval(-1.0, -1.5, -0.0), {"alpha"}),
        (Interval(0.03, 0.0, 0.06), Interval(-1.0, -1.5, -0.5), {"f"}),
        (Interval(1.98, 1.95, 1.9999), Interval(-1.0, -1.5, -0.5), {"f"}),
        (Interval(0.5), Interval(-1.0, None, None), set()),
    ],
)
def test_an_order_counts_once_it_is_known(alpha: Interval, f: Interval, kept: set[str]) -> None:
    """α and f are compared only if the interval of α is narrow, and if their own intervals do not reach 0
    (or, for α, the largest order that is fitted).

    Otherwise, fits of the same noise may differ much. In two fits of one noise, α was 0.16 (0.14 to 0.21) and
    0.6, and f was -0.18 (-0.53 to 0) and -1.
    """
    assert set(figures_of(AxisFit("fractional", "text", "deg/s", alpha, f), RATE_HZ, {})) == kept


NUMBERS = st.lists(st.one_of(st.floats(), st.floats(1e-3, 1e3)), max_size=12)


@given(NUMBERS, NUMBERS, NUMBERS, NUMBERS, st.floats(), st.floats())
def test_any_numbers_at_all(
    tau_s: list[float], adev: list[float], low: list[float], high: list[float], N: float, R: float
) -> None:
    """No Allan curve causes an error, whatever a client of the broker sends."""
    allan = Allan(tau_s, adev, low, high, N, N, N)
    fit = AxisFit(
        "fractional", "text", "deg/s", Interval(R, N, R), Interval(N, R, N), Interval(R, R, N), allan
    )
    for figure in figures_of(fit, RATE_HZ, {}).values():
        assert all(map(math.isfinite, figure))
        assert figure.low <= figure.value <= figure.high


def alarms(sensors: int, spread: float, fleets: int) -> float:
    """Return the proportion of fleets without an outlier in which some sensor is called an outlier."""
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
    """Of 1,000 fleets without an outlier, one may raise a false alarm. So three of 150 would be too many."""
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
    """A value far from the others is an outlier if its interval is narrow, but not if it is wide."""
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
    """If a likelihood has two maxima, the interval may be narrow and contain only the wrong one. It is
    widened to the median width of all intervals, so the sensor does not count as an outlier.
    """
    rng = np.random.default_rng(8)
    std = np.full(40, 0.1)
    value = rng.normal(0, std)
    value[7], std[7] = -0.35, 0.01
    assert judge(value, value - 1.96 * std, value + 1.96 * std, comparisons=200)[1] == []


def test_a_distance_is_in_deviations_of_an_interval_of_95_percent() -> None:
    """If all other sensors agree, a sensor's distance from them is in standard deviations of its own
    estimate.
    """
    value = np.zeros(20)
    value[7] = 100.0
    half = 1.96 * 2
    fleet, odd = judge(value, value - half, value + half, comparisons=1)
    assert fleet is not None
    assert fleet.spread == 0
    assert [(one.place, one.distance) for one in odd] == [(7, pytest.approx(50.0))]
