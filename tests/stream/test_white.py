"""What white noise would give beside an axis: at the same counts whoever asks, however the samples come."""

import numpy as np
import pytest
from fltea.estimator.white_band import WhiteBand
from fltea.settings.config import AccelConfig, EstimatorConfig
from fltea.stream.white import STEP, Sensor, StartPower, WhiteFollower, WhiteRuns, follow
from host_support import hello
from hypothesis import given, settings
from hypothesis import strategies as st

H, POWER, LSB = 0.01, 0.02, 1 / 16.4
QUICK = EstimatorConfig(startup=50, window=60)
SENSOR = Sensor(QUICK, H, LSB)


@settings(max_examples=15)
@given(st.lists(st.integers(0, 60), min_size=1, max_size=6))
def test_any_cut_of_the_samples_gives_the_same_band_at_the_same_counts(blocks: list[int]) -> None:
    cut = WhiteRuns(SENSOR, None, 3)
    found, before = {}, 0
    for samples in blocks:
        for at in cut.advance(samples, POWER):
            found[before + at.samples] = at.quantiles
        before += samples
    whole = WhiteRuns(SENSOR, None, 3).advance(sum(blocks), POWER)
    assert list(found) == [at.samples for at in whole] == list(range(STEP, sum(blocks) + 1, STEP))
    for at in whole:
        np.testing.assert_array_equal(found[at.samples].alpha, at.quantiles.alpha)
        np.testing.assert_array_equal(found[at.samples].f, at.quantiles.f)


def test_runs_are_those_of_the_band() -> None:
    runs = WhiteRuns(SENSOR, 0.01, 7)
    runs.advance(3 * STEP + 4, POWER)
    expected = WhiteBand(QUICK, H, POWER, LSB, 0.01, seed=7).advance(3 * STEP)
    assert runs.quantiles.alpha.tolist() == expected.alpha.tolist()


@pytest.mark.parametrize("power", [None, 0.0, float("nan"), float("inf")])
def test_without_a_power_the_samples_wait(power: float | None) -> None:
    runs = WhiteRuns(SENSOR, None, 1)
    assert runs.advance(2 * STEP, power) == []
    assert np.isnan(runs.quantiles.alpha).all()
    assert [at.samples for at in runs.advance(STEP, POWER)] == [0, 0, STEP]


def test_an_axis_that_begins_anew_has_its_runs_begin_anew() -> None:
    runs = WhiteRuns(SENSOR, None, 1)
    first = runs.advance(STEP, POWER)[0]
    runs.advance(STEP - 1, POWER)
    runs.begin()
    assert np.isnan(runs.quantiles.alpha).all()
    (again,) = runs.advance(STEP, POWER)
    assert again.quantiles.alpha.tolist() == first.quantiles.alpha.tolist()


@given(st.lists(st.floats(-1e3, 1e3), min_size=2, max_size=40), st.integers(2, 20))
def test_power_is_that_of_the_first_samples(samples: list[float], startup: int) -> None:
    start = StartPower(startup)
    for y in samples:
        start.add(y)
    used = samples[:startup]
    assert start.mean == pytest.approx(np.mean(used), abs=1e-9)
    if len(samples) < startup:
        assert start.power is None
    else:
        assert start.power == pytest.approx(np.var(used, ddof=1), rel=1e-9, abs=1e-9)


def test_a_follower_is_both() -> None:
    follower = WhiteFollower(SENSOR, None, 2)
    rng = np.random.default_rng(1)
    samples = 0.5 + rng.standard_normal(QUICK.startup) * 0.1
    for y in samples:
        follower.on_sample(y)
    for valid in [True] * 30 + [False] * 10 + [True] * (STEP + 3):
        follower.on_estimate(valid)
    expected = WhiteRuns(SENSOR, None, 2)
    expected.advance(STEP, follower.power)
    assert follower.power == pytest.approx(np.var(samples, ddof=1))
    assert follower.quantiles.alpha.tolist() == expected.quantiles.alpha.tolist()


def test_axes_of_an_epoch_have_the_settings_and_the_scale_of_their_sensor() -> None:
    gyro = EstimatorConfig(R=[0.1, 0.2])
    found = follow(("gyro_x", "gyro_z", "accel_y"), hello(), gyro, AccelConfig())
    x, z, y = (found[axis] for axis in ("gyro_x", "gyro_z", "accel_y"))
    assert x is not None
    assert z is not None
    assert y is not None
    assert (x._runs._R, z._runs._R, y._runs._R) == (0.1, 0.2, None)
    assert (x._runs._seed, z._runs._seed, y._runs._seed) == (0, 1, 2)
    assert x._runs._sensor.resolution == pytest.approx(1 / 16.4)
    assert y._runs._sensor.resolution == pytest.approx(9.80665 / 16384, rel=1e-3)
    assert follow(("gyro_x", "accel_y"), hello(), gyro, None)["accel_y"] is None
    assert follow(("gyro_x",), None, gyro, None) == {"gyro_x": None}
