"""Tests of what the simulated sensor measures: known noise, value by value, and recordings."""

import numpy as np
import pytest
from fltea.noise.simulation import quantise
from fltea.records.errors import UsageError
from fltea.sources.synthetic import NoiseGenerator, parse_noise

from tools.due_emulator.mpu9250 import Mpu9250
from tools.due_emulator.noise import fractional_world, recorded_world

MS = 1_000_000
QUERY = "alpha=0.4&f=-1.2&seed=7&window=50&offset_dps=0.5"


def test_a_value_holds_from_half_a_period_before_to_half_a_period_after():
    world = fractional_world(QUERY)
    values = [world.at(ms * MS).rate_dps for ms in range(40)]
    changes = [ms for ms in range(1, 40) if values[ms] != values[ms - 1]]
    assert changes == [5, 15, 25, 35]


def test_seeds_differ_and_repeat():
    a, b, c = (fractional_world(f"seed={s}&window=10").at(0) for s in (1, 1, 2))
    assert a == b
    assert a.rate_dps != c.rate_dps
    assert a.accel_g != c.accel_g


def test_counts_are_those_of_the_hosts_quantisation():
    """Polling the chip at 100 Hz gives each value of the noise once, in the counts that `fltea` expects."""
    chip = Mpu9250(fractional_world(QUERY))
    chip.write_register(0x19, 0, 1, 0x18, 0, 1)
    source = NoiseGenerator(parse_noise(QUERY + "&lsb_per_dps=0"))
    source.step()  # This first value is the noise at 0 ms. The chip is read from 10 ms on.
    for k in range(1, 300):
        chip.advance(k * 10 * MS)
        counts = np.frombuffer(chip.read_block(0x43, 6), ">i2")
        assert counts.tolist() == quantise(source.step(), 16.4, 2000.0).tolist()


def test_accelerometer_feels_one_g_and_a_little_noise():
    world = fractional_world("window=10")
    accel = np.array([world.at(k * 10 * MS).accel_g for k in range(2000)])
    # The tolerance is 5 standard deviations of the mean of 2,000 samples.
    assert accel.mean(axis=0) == pytest.approx([0, 0, 1], abs=5e-4)
    assert accel.std(axis=0) == pytest.approx([0.004] * 3, rel=0.1)


def test_conversions_of_one_value_differ_in_the_accelerometer():
    world = fractional_world("window=10")
    one, same, other = world.at(6 * MS), world.at(6 * MS + 1), world.at(7 * MS)
    assert one is same
    assert one.rate_dps == other.rate_dps
    assert one.accel_g != other.accel_g


def test_time_does_not_run_backwards():
    world = fractional_world("window=10")
    world.at(20 * MS)
    with pytest.raises(ValueError, match="passed"):
        world.at(14 * MS)


@pytest.mark.parametrize(
    "query", ["alpha=x", "colour=1", "n=5", "lsb_per_dps=0", "range_dps=250", "rate_hz=1e9"]
)
def test_bad_queries_are_refused(query):
    with pytest.raises(UsageError, match=query.split("=")[0]):
        fractional_world(query)


def test_recording_goes_round(tmp_path):
    path = tmp_path / "rest.npz"
    np.savez(
        path, gyro_raw=np.array([[131, -262], [0, 13], [262, 0]], np.int16), lsb_per_dps=131.0, fs_hz=99.3
    )
    world = recorded_world(path)
    rates = [world.at(k * 10 * MS).rate_dps for k in range(7)]
    assert rates[:3] == [(1.0, -2.0, 0.0), (0.0, pytest.approx(13 / 131), 0.0), (2.0, 0.0, 0.0)]
    assert rates[3:] == rates[:3] + rates[:1]
    assert (world.rows, world.laps) == (3, 2)


def test_real_recording(recordings):
    world = recorded_world(recordings / "mpu6050_tomisuarez_100s.npz")
    assert world.at(0).rate_dps == pytest.approx((-480 / 131, 193 / 131, -83 / 131))
