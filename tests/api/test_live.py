"""Tests of `fltea.Live`: biases, steps and motion of samples that come in any pieces."""

import math

import fltea
import numpy as np
import pytest

from tests.rig.api_support import NOISE


def test_live_takes_arrays_of_any_length() -> None:
    whole, parts = (fltea.Live(100.0, ["a", "b"], unit="deg/s") for _ in range(2))
    y = np.random.default_rng(1).standard_normal((2000, 2))
    whole.add(y)
    for begin, end in ((0, 1), (1, 1), (1, 700), (700, 2000)):
        parts.add(y[begin:end])
    assert parts.samples == whole.samples == 2000
    found, same = whole.fit(last=True), parts.fit(last=True)
    assert list(found) == ["a", "b"]
    assert dict(found) == dict(same)
    assert found["a"].verdict == "white"
    assert found["a"].allan.tau_s[0] == pytest.approx(0.01)
    assert 49 < found["a"].spectrum.hz[-1] <= 50
    parts.skip(500)
    parts.add(y)
    assert parts.fit(curves=False)["a"].breaks["gaps"] == 1


def test_rates_less_their_bias_integrate_to_a_heading_that_is_as_far_off_as_is_said() -> None:
    axes, rest, turn = 24, 6000, 3000
    rng = np.random.default_rng(1)
    walk = np.cumsum(rng.normal(0, 0.0005, (rest + turn, axes)), axis=0)
    y = 0.5 + walk + rng.normal(0, 0.14, walk.shape)
    rate = 20 * np.sin(np.arange(turn) / 100)[:, None]
    live = fltea.Live(100.0, [str(axis) for axis in range(axes)], unit="deg/s")
    still = live.add(y[:rest])
    np.testing.assert_allclose(still.rate, y[:rest] - still.bias)
    assert not still.moving.any()
    assert all(math.isnan(std) for std in live.heading_std(30.0).values())
    live.fit(curves=False)
    moved = live.add(y[rest:] + rate, at_rest=False)
    assert moved.moving.mean() > 0.95
    assert (np.diff(moved.bias_std[100:], axis=0) >= 0).all(), "of a prediction"
    off = (moved.rate - rate).sum(axis=0) / 100
    said = np.array([*live.heading_std(30.0).values()])
    # in 99.8 % of cases, the root mean square of error / σ over 24 axes is within the limits below
    assert 0.6 < np.sqrt(np.mean((off / said) ** 2)) < 1.4
    assert (moved.bias_std[-1] > moved.bias_std[100]).all()
    assert (live.samples, live.fit(curves=False)["0"].left_out["lost"]) == (rest, turn)


def test_samples_of_one_axis_come_back_in_their_shape() -> None:
    live = fltea.Live(100.0, "a", unit="rad/s")
    whole, parts = live.add(NOISE[:700]), fltea.Live(100.0, "a", unit="rad/s")
    assert all(column.shape == (700,) for column in whole)
    cut = [parts.add(NOISE[begin:end]) for begin, end in ((0, 0), (0, 1), (1, 700))]
    np.testing.assert_array_equal(np.concatenate([one.bias_std for one in cut]), whole.bias_std)
    for t_s in (0, math.inf, math.nan):
        with pytest.raises(ValueError, match="t_s must be a time"):
            live.heading_std(t_s)


def test_steps_and_motion_are_found_by_samples_and_by_the_accelerometer() -> None:
    rng = np.random.default_rng(2)
    y, accel = rng.normal(0, 0.1, (20_000, 3)), rng.normal(0, 0.02, (20_000, 3))
    accel[:, 2] += 9.8
    y[12_000:, 1] += 0.2
    accel[15_000:16_000, 0] += np.linspace(0, 2, 1000)
    accel[16_000:, 0] += 2
    live = fltea.Live(100.0, unit="deg/s")
    live.add(y[:6000])
    live.fit(curves=False)
    found = live.add(y[6000:], accel_ms2=accel[6000:])
    (step,) = live.steps
    assert step.axis == "gyro_y"
    assert abs(step.sample - 12_000) < 10
    assert abs(step.size - 0.2) < 3 * step.size_std
    moving = found.moving[:, 0]
    assert moving[9200:9900].all()
    assert not moving[:9000].any()
    assert not moving[10_100:].any()
    assert (found.moving == moving[:, None]).all()
    assert abs(found.bias[-1, 1] - 0.2) < 3 * found.bias_std[-1, 1]
    with pytest.raises(ValueError, match="row for each row of y"):
        live.add(y[:10], accel_ms2=accel[:9])


def test_a_far_offset_is_believed_of_who_says_that_the_sensor_is_at_rest() -> None:
    y = np.random.default_rng(3).normal(0, 0.1, (9000, 1))
    y[6000:] += 10
    found = {}
    for at_rest in (None, True):
        live = fltea.Live(100.0, "x", unit="deg/s")
        live.add(y[:6000])
        live.fit(curves=False)
        found[at_rest] = live.add(y[6000:], at_rest=at_rest)
    assert found[None].moving[32:].all()
    assert abs(found[None].bias[-1, 0]) < 0.1
    assert not found[True].moving[-1000:].any()
    assert abs(found[True].bias[-1, 0] - 10) < 0.1


def test_misuse_of_live_is_told_and_takes_nothing() -> None:
    live = fltea.Live(100.0, "a", unit="deg/s")
    for y, told in (([[1.0, 2.0]], "for each axis"), ([1.0, np.nan], "skip"), (1.0, "for each axis")):
        with pytest.raises(ValueError, match=told):
            live.add(y)
    with pytest.raises(ValueError, match="1 or more"):
        live.skip(0)
    for axes in ([], ["a", "a"]):
        with pytest.raises(ValueError, match="different names"):
            fltea.Live(100.0, axes, unit="deg/s")
    with pytest.raises(ValueError, match="memory must be a time"):
        fltea.Live(100.0, unit="deg/s", memory="soon")
    assert live.samples == 0
    assert live.fit()["a"].verdict == "too few samples"
