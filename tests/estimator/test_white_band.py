"""The band of white noise: covers white noise in just its share, and nothing about it is left to chance."""

from typing import Literal

import numpy as np
import pytest
from fltea.estimator.bank import Bank
from fltea.estimator.white_band import WhiteBand, _quantiles
from fltea.noise.simulation import FractionalNoise
from fltea.settings.config import EstimatorConfig
from hypothesis import given
from hypothesis import strategies as st

H = 0.01
POWER = 0.02
LSB = 1 / 16.4
Variant = Literal["joint", "triple"]
Guard = Literal["off", "faithful", "consistent"]


def quick(variant: Variant = "joint", guard: Guard = "consistent", **more: object) -> EstimatorConfig:
    return EstimatorConfig(variant=variant, guard=guard, startup=100, window=200, **more)  # type: ignore[arg-type]


@pytest.mark.parametrize(("variant", "guard"), [("joint", "consistent"), ("triple", "faithful")])
@pytest.mark.parametrize(("offset", "lsb"), [(1.37, LSB), (0.0, None)])
def test_covers_white_noise_in_just_its_share(
    variant: Variant, guard: Guard, offset: float, lsb: float | None
) -> None:
    """90 % of white axes that walk the daemon's own way are within, early and late, for α and for f."""
    config = quick(variant, guard)
    axes = tuple(f"axis_{i}" for i in range(120))
    rng = np.random.default_rng(5)
    y = offset + rng.standard_normal((100 + 600, len(axes))) * np.sqrt(POWER)
    y = np.rint(y / lsb) * lsb if lsb else y
    live = Bank(axes, config, H, lsb)
    live.run(y[:100])
    found = live.run(y[100:])
    band = WhiteBand(config, H, POWER, lsb, runs=256)
    shares = []
    for k, step in ((249, 250), (599, 350)):
        white = band.advance(step)
        for values, (low, _, high) in ((found.alpha[k], white.alpha), (found.f[k], white.f)):
            shares.append(np.mean((low <= values) & (values <= high)))
    assert all(0.80 <= share <= 0.98 for share in shares), shares


def test_noise_with_an_order_leaves_it() -> None:
    """An axis that is not white has to come out, or the band says nothing."""
    config = EstimatorConfig(startup=100)
    noise = FractionalNoise(0.6, -3.0, 40.0, 1e-4, H, 3000, np.random.default_rng(3))
    samples = np.array([[noise.step()[0]] for _ in range(2100)])
    live = Bank(("x",), config, H, None)
    live.run(samples[:100])
    found = live.run(samples[100:])
    white = WhiteBand(config, H, float(np.var(samples[:100])), None).advance(2000)
    assert found.alpha[-1, 0] > white.alpha[2] + 0.1


@given(
    st.lists(st.integers(1, 60), min_size=1, max_size=4),
    st.floats(1e-6, 1e6),
    st.sampled_from([None, 1e-3, LSB, 1.0]),
)
def test_does_not_depend_on_the_size_of_the_steps(steps: list[int], power: float, lsb: float | None) -> None:
    config = quick()
    whole = WhiteBand(config, H, power, lsb, runs=8, seed=2).advance(sum(steps))
    band = WhiteBand(config, H, power, lsb, runs=8, seed=2)
    for step in steps:
        parts = band.advance(step)
    np.testing.assert_array_equal(whole.alpha, parts.alpha)
    np.testing.assert_array_equal(whole.f, parts.f)
    assert (np.diff(whole.alpha) >= 0).all()
    assert (np.diff(whole.f) >= 0).all()


def test_seeds_differ_and_the_same_seed_does_not() -> None:
    first, again, other = (WhiteBand(quick(), H, POWER, LSB, seed=seed).advance(200) for seed in (1, 1, 2))
    assert first.alpha.tolist() == again.alpha.tolist()
    assert first.alpha.tolist() != other.alpha.tolist()


def test_quantisation_keeps_the_power() -> None:
    """A quantiser adds LSB²/12; the band has the power that was asked for with it."""
    for lsb in (0.01, 0.1, 0.2):
        samples = WhiteBand(quick(), H, POWER, lsb, runs=64)._noise(2000)
        assert np.var(samples) == pytest.approx(POWER, rel=0.02)
        np.testing.assert_allclose(samples / lsb, np.rint(samples / lsb), atol=1e-9)


@pytest.mark.parametrize("power", [1e-6, LSB**2 / 12, LSB**2 / 5])
def test_noise_below_one_count_is_not_quantised_away(power: float) -> None:
    samples = WhiteBand(quick(), H, power, LSB, runs=64)._noise(500)
    assert np.var(samples) == pytest.approx(power, rel=0.1)


def test_given_R_is_used_and_matters() -> None:
    drawn = WhiteBand(quick(), H, POWER, None).advance(500)
    same = WhiteBand(quick(), H, POWER, None, R=POWER).advance(500)
    other = WhiteBand(quick(), H, POWER, None, R=30 * POWER).advance(500)
    assert drawn.alpha[1] == pytest.approx(same.alpha[1], abs=0.05)
    assert abs(drawn.f[1] - other.f[1]) > 0.05


def test_runs_take_off_the_offset_that_their_own_window_shows() -> None:
    """A known offset and one drawn from a window are not the same to the filters."""
    drawn = WhiteBand(quick(), H, POWER, None).advance(500)
    known = WhiteBand(quick(bias=0.0), H, POWER, None).advance(500)
    assert drawn.alpha.tolist() != known.alpha.tolist()


def test_without_a_start_up_window() -> None:
    config = quick(bias=0.0, R=POWER)
    assert config.startup_needed == 0
    assert np.isfinite(WhiteBand(config, H, POWER, LSB, R=POWER).advance(50).alpha).all()


def test_runs_that_run_away_are_left_out_and_begin_anew() -> None:
    """The printed algorithm diverges on an R that is far too small; the band goes on, without a warning."""
    config = quick("triple", "off")
    band = WhiteBand(config, H, POWER, None, R=POWER / 100)
    there = [np.isfinite(band.advance(5)).all() for _ in range(200)]
    assert sum(there[-50:]) > 40, "runs that are lost for ever leave nothing of the band"


def test_every_memory_has_the_same_band() -> None:
    found = WhiteBand(quick("triple", "off", memory="direct"), H, POWER, LSB).advance(100)
    usual = WhiteBand(quick("triple", "off"), H, POWER, LSB).advance(100)
    assert found.alpha.tolist() == usual.alpha.tolist()


def test_quantiles() -> None:
    assert _quantiles(np.arange(99.0)[::-1] + 1).tolist() == [5.0, 50.0, 95.0]
    assert _quantiles(np.array([2.0])).tolist() == [2.0, 2.0, 2.0]
    assert np.isnan(_quantiles(np.array([]))).all()
