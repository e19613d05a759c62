"""Tests units, rates and clocks of ROS bags: what the bag or user states, and what the numbers show."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fltea.recording.bag_imu import ros_layout
from fltea.recording.bag_units import AtRest, check_rates, scales
from fltea.recording.bag_units import at_rest as quietest
from fltea.recording.opening import open_recording
from fltea.recording.reading import NotStated
from fltea.recording.ros_bag import open_bag
from fltea.records.errors import Implausible, UsageError
from fltea.records.units import STANDARD_GRAVITY_MS2
from fltea.settings.how import How
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.rig.bag_at_rest import BIAS_DPS, RATE_HZ, STAMPS, N, answers, at_rest
from tests.rig.bag_support import (
    KINDS,
    START_NS,
    Messages,
    even,
    told,
    write_bag,
)


def imu(gyro: Any, g_in_unit: float = STANDARD_GRAVITY_MS2, shake: float = 0.002) -> Messages:
    rng = np.random.default_rng(7)
    accel = g_in_unit * rng.normal([0.1, 0, 0.995], shake, (N, 3))
    return Messages(STAMPS, gyro, accel)


# --- conventions ---


@pytest.mark.parametrize("kind", KINDS)
def test_the_reading_of_a_bag(tmp_path: Path, kind: str) -> None:
    stored = open_bag(write_bag(tmp_path / f"a.{kind}", {"/imu": imu(np.radians(at_rest()))}))
    assert answers(stored) == {
        "sensor": ("topic /imu", "stated"),
        "columns": ("angular_velocity.x, .y, .z", "convention"),
        "unit": ("rad/s", "convention"),
        "clock": ("200 Hz", "measured"),
        "accelerometer": ("linear_acceleration.x, .y, .z in m/s^2", "convention"),
    }
    assert stored.notes == ()
    path = write_bag(tmp_path / f"b.{kind}", {"/imu": even(90), "/b": even(90)})
    assert answers(open_bag(path, How(topic="/b")))["sensor"] == ("topic /b", "given")


@pytest.mark.parametrize("noise", [0.17, 1.0, 2.0])
def test_a_bag_in_degrees_is_asked_for_with_what_both_would_mean(tmp_path: Path, noise: float) -> None:
    gyro = at_rest(noise)
    path = write_bag(tmp_path / "a.bag", {"/imu": imu(gyro)})
    with pytest.raises(NotStated, match=r"drivers break this convention.*: --units \?\n") as asked:
        open_bag(path)
    assert "--units rad/s " in str(asked.value)
    assert "--units deg/s " in str(asked.value)
    stored = open_bag(path, How(units="dps"))
    assert stored.whole().gyro == pytest.approx(gyro, rel=1e-12)
    assert answers(stored)["unit"] == ("dps", "given")
    assert "by sensor_msgs/Imu (REP 103) they are in rad/s" in told(stored)["reading"]
    in_rads = open_bag(path, How(units="rad/s"))
    assert in_rads.whole().gyro == pytest.approx(np.degrees(gyro), rel=1e-12)
    assert in_rads.notes == ()


@given(noise=st.floats(0.05, 2.0), bias=st.floats(-20, 20), seed=st.integers(0, 999))
@settings(max_examples=100)
def test_a_bag_in_radians_is_not_doubted(noise: float, bias: float, seed: int) -> None:
    layout = ros_layout("sensor_msgs/Imu", "ros1", b"")
    assert layout is not None
    rate, _, _ = scales("a.bag", layout, How())
    assert rate is not None
    rest = quietest([[np.radians(at_rest(noise, bias, seed))]], RATE_HZ, STANDARD_GRAVITY_MS2)
    assert rest is not None
    check_rates("a.bag", layout, rate, rest, AtRest(None), lambda: "", [])
    in_degrees = quietest([[at_rest(max(noise, 0.3), bias, seed)]], RATE_HZ, STANDARD_GRAVITY_MS2)
    assert in_degrees is not None
    with pytest.raises(NotStated):
        check_rates("a.bag", layout, rate, in_degrees, AtRest(None), lambda: "", [])


@pytest.mark.parametrize(("unit", "one"), [("lsb:131", 131.0), ("mrad/s", np.radians(1000.0)), ("mdps", 1e3)])
def test_other_units_than_the_conventions_are_asked_for(tmp_path: Path, unit: str, one: float) -> None:
    """If the rates in a bag cannot be in rad/s, the user is asked for the unit, even if another would fit.

    The convention of ROS is rad/s, but no gyroscope at rest gives such figures in rad/s.
    """
    gyro = at_rest() * one
    gyro = np.rint(gyro) if unit.startswith("lsb:") else gyro
    path = write_bag(tmp_path / "a.bag", {"/imu": imu(gyro)})
    with pytest.raises(NotStated, match=r"drivers break this convention.*: --units \?\n") as asked:
        open_bag(path)
    assert f"--units {unit} " in str(asked.value)
    stored = open_bag(path, How(units=unit))
    whole = stored.whole().gyro / (stored.lsb_per_dps or 1.0)
    assert whole == pytest.approx(gyro / one)


def test_rates_that_no_gyroscope_has_are_refused_by_whomever_their_unit_is(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "a.bag", {"/imu": imu(np.rint(at_rest() * 131) + 100)})
    with pytest.raises(Implausible, match=r"beyond 4000 deg/s in 1500 of 1500 rows"):
        open_bag(path, How(units="rad/s"))


@pytest.mark.parametrize("rests", [False, True])
def test_a_robot_that_moves_is_not_doubted(tmp_path: Path, rests: bool) -> None:
    """Rates of a moving robot are as large as noise in a wrong unit. The unit is not doubted if the
    accelerometer shakes, too, or if the robot rests at times, so that some stretches are quiet.
    """
    rng = np.random.default_rng(5)
    moving = rng.normal(0, 0.2, (N, 3))
    shake = 0.2
    if rests:
        moving[300:900] = np.radians(at_rest())[300:900]
        shake = 0.002
    stored = open_bag(write_bag(tmp_path / "a.bag", {"/imu": imu(moving, shake=shake)}))
    assert answers(stored)["unit"] == ("rad/s", "convention")


@pytest.mark.parametrize(("unit", "one"), [("g", 1.0), ("mg", 1000.0), ("mm/s^2", 9806.65)])
def test_gravity_tells_the_unit_of_an_accelerometer(tmp_path: Path, unit: str, one: float) -> None:
    path = write_bag(tmp_path / "a.db3", {"/imu": imu(np.radians(at_rest()), one)})
    with pytest.raises(
        UsageError, match=rf"which is gravity in {unit.replace('^', '.')}( or cm/s.2)?; in m/s\^2, as"
    ) as doubt:
        open_bag(path)
    which = "?" if unit == "mg" else unit
    assert f"add --accel-units {which};" in str(doubt.value)
    stored = open_bag(path, How(accel_units=unit))
    accel = stored.whole().accel_ms2
    assert accel is not None
    assert np.linalg.norm(accel, axis=1).mean() == pytest.approx(STANDARD_GRAVITY_MS2, rel=0.01)
    assert answers(stored)["accelerometer"] == (f"linear_acceleration.x, .y, .z in {unit}", "given")
    assert "as --accel-units says" in told(stored)["reading"]
    as_it_stands = open_bag(path, How(accel_units="m/s^2", overrule=True)).whole().accel_ms2
    assert as_it_stands is not None
    assert as_it_stands[:, 2].mean() == pytest.approx(0.995 * one, rel=1e-3)


def test_both_units_are_asked_for_at_once(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "a.bag", {"/imu": imu(at_rest(), 1.0), "/b": even(20)})
    with pytest.raises(NotStated, match=r": --sensor /imu --units \? --accel-units g\n"):
        open_bag(path, How(topic="/imu"))
    whole = open_bag(path, How(topic="/imu", accel_units="g", units="deg/s")).whole()
    assert whole.gyro.mean(axis=0) == pytest.approx(BIAS_DPS, abs=0.05)


def test_gravity_against_what_the_user_says(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "a.bag", {"/imu": imu(np.radians(at_rest()))})
    with pytest.raises(UsageError, match=r"gravity in m/s\^2; in g, as --accel-units has it"):
        open_bag(path, How(accel_units="g"))


def test_accelerations_without_gravity_are_not_doubted(tmp_path: Path) -> None:
    rng = np.random.default_rng(8)
    free = Messages(STAMPS, np.radians(at_rest()), rng.normal(0, 0.6, (N, 3)))
    stored = open_bag(write_bag(tmp_path / "a.bag", {"/imu": free}))
    assert answers(stored)["accelerometer"][1] == "convention"
    still = free._replace(gyro_rads=at_rest(), accel_ms2=rng.normal(0, 0.03, (N, 3)))
    with pytest.raises(NotStated, match="drivers break this convention"):
        open_bag(write_bag(tmp_path / "b.bag", {"/imu": still}))


# --- rate and options ---


def test_a_rate_is_held_against_the_stamps(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "a.mcap", {"/imu": imu(np.radians(at_rest()))})
    assert answers(open_bag(path, How(rate_hz=199.0)))["clock"] == ("200 Hz", "measured")
    with pytest.raises(UsageError, match=r"are those of 200 Hz, and --rate 100 says otherwise"):
        open_bag(path, How(rate_hz=100.0))
    stored = open_bag(path, How(rate_hz=100.0, overrule=True))
    assert (stored.rate_hz, answers(stored)["clock"]) == (100.0, ("100 Hz", "given"))


def test_a_rate_where_no_stamps_tell_it(tmp_path: Path) -> None:
    messages = imu(np.radians(at_rest()))._replace(stamp_ns=[0] * N, arrival_ns=[START_NS] * N)
    path = write_bag(tmp_path / "a.bag", {"/imu": messages})
    with pytest.raises(
        NotStated, match=r"neither header stamps nor arrivals tell it .*: --units rad/s --rate \?"
    ):
        open_bag(path, How(units="rad/s"))
    stored = open_bag(path, How(rate_hz=250.0))
    assert (stored.samples, stored.rate_hz) == (N, 250.0)
    assert stored.whole().device_s[-1] == pytest.approx((N - 1) / 250)
    assert answers(stored)["clock"] == ("250 Hz", "given")


@pytest.mark.parametrize(
    ("how", "why"),
    [
        (How(columns=["1", "2", "3"]), r"--columns is not for a bag of ROS"),
        (How(time_column="t"), r"--time-column is not for a bag of ROS"),
        (How(time_unit="ms"), r"--time-unit is given, and the times are seconds and parts of them"),
        (How(units="furlong"), r"furlong: not a unit"),
        (How(accel_units="furlong"), r"furlong: not a unit"),
    ],
)
def test_options_that_cannot_hold_are_refused_with_a_reason(tmp_path: Path, how: How, why: str) -> None:
    with pytest.raises(UsageError, match=why):
        open_recording(write_bag(tmp_path / "a.bag", {"/imu": even(90)}), how)


def test_counts_by_the_user(tmp_path: Path) -> None:
    counts = np.rint(at_rest() * 131)
    path = write_bag(tmp_path / "a.bag", {"/imu": imu(counts)})
    stored = open_bag(path, How(units="lsb:131"))
    assert stored.lsb_per_dps == 131
    assert stored.whole().gyro.tolist() == counts.tolist()
    fractions = open_bag(write_bag(tmp_path / "b.bag", {"/imu": imu(at_rest())}), How(units="lsb:2"))
    assert fractions.lsb_per_dps is None
    assert fractions.whole().gyro == pytest.approx(at_rest() / 2)


def test_stamps_that_repeat_and_none_missing(tmp_path: Path) -> None:
    n = 24_000
    rest = even(n)
    stamps = np.array(rest.stamp_ns)
    again = np.random.default_rng(2).choice(np.arange(2, n - 2, 3), 48, replace=False)
    stamps[again] = stamps[again - 1]
    stored = open_bag(write_bag(tmp_path / "a.bag", {"/imu": rest._replace(stamp_ns=stamps.tolist())}))
    seq = stored.whole().seq
    assert seq is not None
    assert seq.tolist() == list(range(n))
    assert "48 stamps are the same as the one before" in told(stored)["bag_stamps"]
