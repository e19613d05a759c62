"""Tests that a plain Kalman filter that uses only the exported file predicts the error of the heading."""

import json
import re
from pathlib import Path

import msgspec
import numpy as np
import pytest
from fltea.identification.axis import IdentifyOptions, analyse
from fltea.identification.forecast_judge import FittedSystem, fitted_system
from fltea.identification.navigation_filter import TOLD_S, NavigationFilter, navigation_filter
from fltea.identification.noise_model import AxisModel, draw
from fltea.noise.filters import LowPass
from fltea.noise.parts import AnyPart, Arfima, Order, Relaxation, Walk, White
from fltea.records.arrays import Array
from scipy.signal import lfilter

from tests.rig.model_support import EXAMPLES

H, N = 0.01, 60_000
PAGE = Path(__file__).parents[2] / "host/docs/cookbook/vins.md"
OPTIONS = IdentifyOptions(shuffles=0)

OF_EACH_PART: dict[str, tuple[AnyPart, ...]] = {
    f"example of {kind}": (White(1.0), part) for kind, part in EXAMPLES.items()
}
NOISES: dict[str, tuple[AnyPart, ...]] = {
    "white": (White(0.01),),
    "walk that the verdict calls drift": (White(0.01), Walk(0.0005)),
    "walk": (White(0.02), Walk(0.003)),
    "relaxation": (White(0.02), Relaxation(0.05, 2.0)),
    "two relaxations": (White(0.02), Relaxation(0.1, 0.2), Relaxation(0.1, 10.0)),
    "order": (White(0.02), Order(0.7, -2.0, 0.006 / H**1.4)),
    "1/f": (White(0.02), Arfima(0.45, 1e-9, 0.004)),
    "low-pass": (White(0.02), LowPass(10.0, 2.0)),
}


def noise(name: str, n: int, rng: np.random.Generator) -> Array:
    if name == "EMA":
        return np.asarray(lfilter([0.2], [1, -0.8], rng.normal(size=n + 200) * 0.1)[200:])
    return draw(AxisModel((NOISES | OF_EACH_PART)[name]), H, n, rng)[0]


def tracked(y: Array) -> FittedSystem:
    return fitted_system(analyse(y, H, OPTIONS).figures.model.parts(H), y, H)


def by_the_page(plain: NavigationFilter, at_rest: Array, t_s: float, folder: Path) -> tuple[float, float]:
    """Return the drift of the heading and its σ, by the code of the cookbook."""
    (block,) = re.findall(r"^```python\n(.*?)^```", PAGE.read_text(encoding="utf-8"), re.M | re.S)
    entry = {"h_s": H, "axes": {"gyro_z": {"filter": msgspec.to_builtins(plain)}}}
    (folder / "navigation.json").write_text(json.dumps(entry))
    names = {"at_rest": at_rest, "t_s": t_s}
    exec(block.replace("navigation.json", str(folder / "navigation.json")), names)
    n, x, P = (names[name] for name in ("n", "x", "P"))
    return float(x[n]), float(np.sqrt(P[n, n]))


@pytest.mark.parametrize("name", ["walk", "two relaxations", "order", *OF_EACH_PART])
def test_the_page_s_filter_says_what_the_file_says(name: str, tmp_path: Path) -> None:
    y = 3.0 + noise(name, N, np.random.default_rng(1))
    plain = navigation_filter(tracked(y), y, H)
    for told in plain.heading_std[:3]:
        drift, std = by_the_page(plain, y[:0], told.t_s, tmp_path)
        # `std` and `told.filter` differ a little: `std` is a sum over samples, and `told.filter` an integral
        assert std == pytest.approx(told.filter, rel=0.03)
        assert drift == pytest.approx(plain.bias * told.t_s)


@pytest.mark.parametrize("name", [*NOISES, "EMA"])
def test_the_filter_s_heading_is_the_forecast_s(name: str) -> None:
    """From one minute on, the exported filter and the forecast give the same σ of the heading.

    Before that, the forecast's σ may be smaller, since it knows the states at the end of the record.
    """
    for seed in range(2):
        y = noise(name, N, np.random.default_rng(seed))
        plain = navigation_filter(tracked(y), y, H)
        assert [one.t_s for one in plain.heading_std] == list(TOLD_S)
        for one in plain.heading_std[2:]:
            assert one.filter / one.forecast == pytest.approx(1.0, abs=0.15)
        for one in plain.heading_std[:2]:
            assert 0.9 < one.filter / one.forecast < 2.0


@pytest.mark.slow
def test_the_heading_is_as_far_off_as_it_says() -> None:
    """The errors of the heading after 10, 60 and 300 s are as large as the filter's σ says.

    The error is divided by its σ. Over all noises, the root mean square of these ratios is close to 1.
    """
    squares = []
    for seed in range(8):
        for name in (*NOISES, "EMA"):
            y = 1.0 + noise(name, N + 30_000, np.random.default_rng((seed, 7)))
            plain = navigation_filter(tracked(y[:N]), y[:N], H)
            heading = H * np.cumsum(y[N:])
            squares.append(
                [
                    (heading[round(one.t_s / H) - 1] - plain.bias * one.t_s) / one.filter
                    for one in plain.heading_std[1:]
                ]
            )
    rms = np.sqrt((np.array(squares) ** 2).mean(axis=0))
    assert (rms > 0.8).all(), rms
    assert (rms < 1.2).all(), rms


def test_a_slope_is_a_walk_of_the_bias() -> None:
    """The bias rises by 0.05 deg/s in ten minutes. If this goes on, the heading error is slope × t² / 2.

    The filter has no slope, but a random walk of the bias, which predicts errors of about this size.
    """
    slope = 0.05 / 600
    squares = []
    for seed in range(6):
        y = np.random.default_rng((seed, 8)).normal(size=N) * 0.1 + slope * H * np.arange(N)
        plain = navigation_filter(fitted_system([White(0.01)], y, H), y, H)
        squares.append(
            [
                (one.t_s * (slope * (N * H + one.t_s / 2) - plain.bias) / one.filter) ** 2
                for one in plain.heading_std[2:]
            ]
        )
    assert (np.sqrt(np.mean(squares, axis=0)) < 2).all()


@pytest.mark.parametrize("name", ["EMA", "low-pass"])
def test_what_a_low_pass_takes_away_is_in_n_as_it_was_before(name: str) -> None:
    y = noise(name, N, np.random.default_rng(2))
    plain = navigation_filter(tracked(y), y, H)
    density = np.sqrt(0.01 * H) if name == "EMA" else np.sqrt(0.02 * H)
    # relaxations slower than 1 s describe the offset here, and not the low-passed noise, so they are left out
    fast = (state for state in plain.gauss_markov if state.tau_s < 1)
    slow = sum(2 * state.sigma**2 * state.tau_s for state in fast)
    assert np.sqrt(plain.N**2 + slow) == pytest.approx(density, rel=0.05)


@pytest.mark.parametrize("seconds", [3, 10, 60])
@pytest.mark.parametrize("name", ["white", "two relaxations", "order", *OF_EACH_PART])
def test_it_is_always_filled(name: str, seconds: int) -> None:
    y = noise(name, round(seconds / H), np.random.default_rng(5))
    plain = navigation_filter(tracked(y), y, H)
    numbers = [plain.N, plain.K, plain.bias, plain.bias_std]
    numbers += [x for state in plain.gauss_markov for x in (state.sigma, state.tau_s)]
    assert np.isfinite(numbers).all()
    assert plain.N > 0
    assert min(plain.K, plain.bias_std) >= 0
