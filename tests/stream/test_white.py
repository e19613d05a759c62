"""What white noise would give in step with one axis, however its samples come."""

import numpy as np
import pytest
from fltea.estimator.white_band import WhiteBand
from fltea.settings.config import EstimatorConfig
from fltea.stream.white import STEP, AxisBand, Sensor, StartPower, WhiteRuns
from hypothesis import given, settings
from hypothesis import strategies as st

H, POWER, LSB = 0.01, 0.02, 1 / 16.4
QUICK = EstimatorConfig(startup=50, window=60)
SENSOR = Sensor(QUICK, H, LSB)


@settings(max_examples=15)
@given(st.lists(st.integers(0, 60), min_size=1, max_size=6))
def test_any_cut_of_the_samples_gives_the_same_band(blocks: list[int]) -> None:
    cut, whole = WhiteRuns(SENSOR, None, 3), WhiteRuns(SENSOR, None, 3)
    for samples in blocks:
        cut.advance(samples, POWER)
    whole.advance(sum(blocks), POWER)
    assert cut.samples == whole.samples == sum(blocks) // STEP * STEP
    np.testing.assert_array_equal(cut.quantiles, whole.quantiles)


def test_runs_are_those_of_the_band() -> None:
    runs = WhiteRuns(SENSOR, 0.01, 7)
    runs.advance(3 * STEP + 4, POWER)
    expected = WhiteBand(QUICK, H, POWER, LSB, 0.01, seed=7).advance(3 * STEP)
    assert runs.quantiles.alpha.tolist() == expected.alpha.tolist()


@pytest.mark.parametrize("power", [None, 0.0, float("nan"), float("inf")])
def test_without_a_power_the_samples_wait(power: float | None) -> None:
    runs = WhiteRuns(SENSOR, None, 1)
    runs.advance(2 * STEP, power)
    assert np.isnan(runs.quantiles.alpha).all()
    runs.advance(STEP, POWER)
    assert runs.samples == 3 * STEP


def test_an_axis_that_begins_again_has_its_runs_begin_again() -> None:
    runs, other = WhiteRuns(SENSOR, None, 1), WhiteRuns(SENSOR, None, 1)
    runs.advance(2 * STEP - 1, POWER)
    runs.begin()
    assert np.isnan(runs.quantiles.alpha).all()
    for one in (runs, other):
        one.advance(STEP, POWER)
    assert runs.quantiles.alpha.tolist() == other.quantiles.alpha.tolist()


@given(st.lists(st.floats(-1e3, 1e3), min_size=2, max_size=40), st.integers(2, 20), st.integers(0, 40))
def test_power_is_that_of_the_first_samples(samples: list[float], startup: int, cut: int) -> None:
    start = StartPower(startup)
    after = [start.add(np.array(part)) for part in (samples[:cut], samples[cut:])]
    assert sum(after) == max(0, len(samples) - startup)
    if len(samples) < startup:
        assert start.power is None
    else:
        assert start.power == pytest.approx(np.var(samples[:startup], ddof=1), rel=1e-9, abs=1e-9)


@given(st.lists(st.booleans(), max_size=200))
def test_runs_of_an_axis_follow_its_valid_estimates_since_it_last_began(valid: list[bool]) -> None:
    band = AxisBand(SENSOR, None, 2)
    band.on_samples(np.random.default_rng(1).normal(0.5, 0.1, QUICK.startup))
    band.on_estimates(np.array(valid, dtype=bool))
    whole = "".join("x" if one else " " for one in valid).split()
    latest = len(whole[-1]) if whole else 0
    stats = band.stats()
    assert (stats.samples if stats else 0) == latest // STEP * STEP


def test_an_axis_says_nothing_while_no_run_is_known() -> None:
    band = AxisBand(SENSOR, None, 2)
    band.on_estimates(np.ones(3 * STEP, dtype=bool))
    assert band.stats() is None, "its power is not known"
    band.on_samples(np.random.default_rng(1).normal(0.5, 0.1, QUICK.startup))
    assert band.stats() is None
    band.on_estimates(np.ones(0, dtype=bool))
    band.on_count(0, valid=True)
    stats = band.stats()
    assert stats is not None
    assert stats.samples == 3 * STEP
    assert stats.alpha == tuple(sorted(stats.alpha))
