"""Figures of an axis: which a verdict leaves room for, and how often their intervals hold the truth."""

import math
from functools import cache

import msgspec
import numpy as np
import pytest
from fltea.fleet.figures import Figure, figures_of
from fltea.fleet.messages import Allan, AxisFit, Interval
from hypothesis import given
from hypothesis import strategies as st

from tools.fleet_fits import NOISES, RATE_HZ, Noise, fits

RECORDS, SAMPLES = 40, 20_000


def fitted(noise: Noise, samples: int, seed: int) -> AxisFit:
    """What a fleet reads of a daemon's fit of simulated noise."""
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
    """Of 40 all but 6 with a probability of 0.99 or more; they are not wider than twice what is known."""
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
    """The curve of this noise has two stretches of slope -1/2, of which either may be the longer one."""
    records = [fitted(NOISES["fractional"], 100_000, seed) for seed in (0, 1)]
    records += [fitted(NOISES["fractional"], 400_000, seed) for seed in (2, 3)]
    kept = [figures_of(fit, RATE_HZ, {})["N"].value for fit in records]
    assert max(kept) < 1.1 * min(kept)


@pytest.mark.parametrize(("verdict", "kept"), [("white", {"N", "density"}), ("undecided", set())])
def test_where_noise_may_have_an_order_and_its_white_noise_is_unknown_there_is_no_density(
    verdict: str, kept: set[str]
) -> None:
    """Of a young fractional sensor √2 N was 1.8 times its density, thirteen deviations off."""
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
    """Real fits of one noise: f of -0.18 (-0.53 to 0) beside -1, α of 0.16 (0.14 to 0.21) beside 0.6."""
    assert set(figures_of(AxisFit("fractional", "text", "deg/s", alpha, f), RATE_HZ, {})) == kept


NUMBERS = st.lists(st.one_of(st.floats(), st.floats(1e-3, 1e3)), max_size=12)


@given(NUMBERS, NUMBERS, NUMBERS, NUMBERS, st.floats(), st.floats())
def test_any_numbers_at_all(
    tau_s: list[float], adev: list[float], low: list[float], high: list[float], N: float, R: float
) -> None:
    """A stranger's curve stops nothing."""
    allan = Allan(tau_s, adev, low, high, N, N, N)
    fit = AxisFit(
        "fractional", "text", "deg/s", Interval(R, N, R), Interval(N, R, N), Interval(R, R, N), allan
    )
    for figure in figures_of(fit, RATE_HZ, {}).values():
        assert all(map(math.isfinite, figure))
        assert figure.low <= figure.value <= figure.high
