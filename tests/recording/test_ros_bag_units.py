"""Tests units, rates and clocks of ROS bags: what the bag or user states, and what the numbers show."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fltea.recording.bag_imu import ros_layout
from fltea.recording.bag_names import units_in
from fltea.recording.bag_units import AtRest, check_rates, scales
from fltea.recording.bag_units import at_rest as quietest
from fltea.recording.files import Stored
from fltea.recording.opening import open_recording
from fltea.recording.reading import NotStated
from fltea.recording.ros_bag import open_bag
from fltea.recording.sample_times import SECONDS
from fltea.recording.units import rate_unit
from fltea.records.errors import Implausible, UsageError
from fltea.records.units import STANDARD_GRAVITY_MS2
from fltea.settings.how import How, TimeUnit
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.rig.bag_support import (
    KINDS,
    START_NS,
    Messages,
    even,
    told,
    write_bag,
    write_objects,
    write_protobuf,
)

N, RATE_HZ = 1500, 200.0
STAMPS = (START_NS + np.arange(N) * 5_000_000).tolist()
N_DPS = np.array([0.6, 0.9, 1.2])
BIAS_DPS = np.array([0.5, -0.3, 0.2])


def at_rest(noise: float = 1.0, bias: float = 1.0, seed: int = 1) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Return angular rates of a sensor at rest in deg/s."""
    rng = np.random.default_rng(seed)
    sigma = noise * N_DPS / 60 * np.sqrt(RATE_HZ)
    return np.asarray(rng.normal(bias * BIAS_DPS, sigma, (N, 3)))


def answers(stored: Stored) -> dict[str, tuple[str, str]]:
    return {answer.question: (answer.value, answer.evidence) for answer in stored.reading}


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
    """A robot's vibration looks like noise in a wrong unit, but it also shakes the accelerometer.

    If the robot rests at times, its recording has quiet stretches. So the unit is not doubted.
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


# --- JSON ---


def objects(gyro: Any, name: str = "angular_velocity", **more: Any) -> list[dict[str, Any]]:
    stamps = [{"sec": t // 10**9, "nanosec": t % 10**9} for t in STAMPS]
    return [
        {"stamp": stamp, name: dict(zip("xyz", row, strict=True)), **more}
        for stamp, row in zip(stamps, np.asarray(gyro).tolist(), strict=True)
    ]


PLAIN: dict[str, Any] = {"type": "object", "properties": {"angular_velocity": {"type": "object"}}}


@pytest.mark.parametrize("kind", ["Imu", "robot.Imu", "foxglove.Imu", ""])
def test_json_has_no_convention(tmp_path: Path, kind: str) -> None:
    path = write_objects(
        tmp_path / "a.mcap", objects(at_rest()), STAMPS, kind=kind, schema=PLAIN if kind else None
    )
    with pytest.raises(
        NotStated, match=r"nothing says the unit of angular_velocity\.x, \.y, \.z\. .*: --units \?\n"
    ) as asked:
        open_bag(path)
    assert "--units deg/s     N in deg/√h 0.6" in str(asked.value)
    stored = open_bag(path, How(units="deg/s"))
    assert stored.whole().gyro == pytest.approx(at_rest())
    assert stored.notes == ()


@pytest.mark.parametrize("kind", ["sensor_msgs/Imu", "sensor_msgs/msg/Imu", "ros.sensor_msgs.Imu"])
def test_ros_in_json_has_its_convention(tmp_path: Path, kind: str) -> None:
    gyro = np.radians(at_rest())
    path = write_objects(tmp_path / "a.mcap", objects(gyro), STAMPS, kind=kind, schema=PLAIN)
    stored = open_bag(path)
    assert stored.whole().gyro == pytest.approx(np.degrees(gyro))
    assert answers(stored)["unit"] == ("rad/s", "convention")


def described(**texts: str) -> dict[str, Any]:
    """Return a JSON Schema with descriptions: of the message (`root`), its rates, an axis, another field."""
    axis = {"type": "number", **({"description": texts["axis"]} if "axis" in texts else {})}
    field = {"type": "object", "properties": dict.fromkeys("xyz", axis)}
    if "field" in texts:
        field["description"] = texts["field"]
    other = {"type": "number", "description": texts.get("other", "")}
    schema = {"type": "object", "properties": {"angular_velocity": field, "max_rate": other}}
    return {**schema, "description": texts["root"]} if "root" in texts else schema


@pytest.mark.parametrize(
    ("texts", "unit"),
    [
        ({"field": "deg/s"}, "deg/s"),
        ({"field": "Angular rate (in degrees per second), bias removed."}, "deg/s"),
        ({"axis": "unit: rad/s"}, "rad/s"),
        ({"root": "One sample: rates in mrad/s, accelerations in m/s^2."}, "mrad/s"),
        ({"root": "from the robot, rad/s", "field": "deg/s"}, "deg/s"),
        ({"other": "deg/s"}, None),
        ({"field": "deg/s, formerly rad/s"}, "deg/s"),
        ({"field": "deg/s or rad/s"}, None),
        ({"field": "convert to deg/s before use"}, None),
        ({"field": "the gyroscope"}, None),
        ({"field": "Range ±2000 deg/s"}, None),
        ({"field": "full scale in deg/s"}, None),
        ({"field": "sensitivity: 131 LSB/(deg/s)"}, None),
        ({"axis": "at most 250 deg/s"}, None),
        ({"root": "Yaw rate limit: 300 deg/s. Angular velocity is in rad/s."}, "rad/s"),
        ({"root": "rates in rad/s, not deg/s"}, "rad/s"),
        ({"field": "Range ±2000 deg/s", "root": "from a driver"}, None),
    ],
)
def test_a_unit_in_the_words_of_a_schema(tmp_path: Path, texts: dict[str, str], unit: str | None) -> None:
    path = write_objects(tmp_path / "a.mcap", objects(at_rest()), STAMPS, schema=described(**texts))
    if unit is None:
        with pytest.raises(NotStated, match="nothing says the unit"):
            open_bag(path)
        return
    stored = open_bag(path)
    assert answers(stored)["unit"] == (unit, "stated")
    other = "rad/s" if unit == "deg/s" else "deg/s"
    with pytest.raises(
        UsageError, match=rf"are in {unit} by what the schema says.*--units {other} says otherwise"
    ):
        open_bag(path, How(units=other))
    assert "reading" in told(open_bag(path, How(units=other, overrule=True)))


@given(
    words=st.lists(st.sampled_from(["the", "rate", "of", "turn", "in", "x,", "(y)", "per", "s"]), max_size=8),
    unit=st.sampled_from(["deg/s", "rad/s", "degrees per second", "mrad/s", "deg/h"]),
    place=st.integers(0, 8),
)
def test_a_unit_anywhere_in_a_text(words: list[str], unit: str, place: int) -> None:
    text = " ".join([*words[:place], f"[{unit}].", *words[place:]])
    assert units_in(text, rate_unit) == {rate_unit(unit)}


@pytest.mark.parametrize(
    ("name", "unit"),
    [("gyro_dps", "deg/s"), ("gyro_rad_s", "rad/s"), ("angular_velocity_deg_per_s", "deg/s")],
)
def test_a_unit_in_the_name_of_a_field(tmp_path: Path, name: str, unit: str) -> None:
    path = write_objects(tmp_path / "a.mcap", objects(at_rest(), name), STAMPS)
    assert answers(open_bag(path))["unit"] == (unit, "stated")


def test_a_name_and_a_schema_that_differ(tmp_path: Path) -> None:
    schema = {"type": "object", "properties": {"gyro_dps": {"type": "object", "description": "in rad/s"}}}
    path = write_objects(tmp_path / "a.mcap", objects(at_rest(), "gyro_dps"), STAMPS, schema=schema)
    with pytest.raises(UsageError, match=r"in deg/s by the name gyro_dps.x, and in rad/s by what the schema"):
        open_bag(path)
    with pytest.raises(UsageError, match=r"right: --units \? --overrule"):
        open_bag(path, How(units="deg/s"))
    assert open_bag(path, How(units="deg/s", overrule=True)).whole().gyro == pytest.approx(at_rest())


@pytest.mark.parametrize(
    "beside",
    [{"unit": "deg/s"}, {"angular_velocity_unit": "deg/s"}, {"units": {"angular_velocity": "deg/s"}}],
)
def test_a_unit_in_each_message(tmp_path: Path, beside: dict[str, Any]) -> None:
    some = objects(at_rest(), **beside)
    some[40] = objects(at_rest())[40]  # one message does not state the unit
    path = write_objects(tmp_path / "a.mcap", some, STAMPS)
    stored = open_bag(path)
    assert answers(stored)["unit"] == ("deg/s", "stated")
    assert stored.whole().gyro == pytest.approx(np.delete(at_rest(), 40, axis=0))
    assert told(stored)["bag_messages"].count("1 messages do not have the layout") == 1
    with pytest.raises(UsageError, match=r"in deg/s by the unit beside .* --units rad/s says otherwise"):
        open_bag(path, How(units="rad/s"))
    in_rads = open_bag(path, How(units="rad/s", overrule=True)).whole().gyro
    assert in_rads == pytest.approx(np.degrees(np.delete(at_rest(), 40, axis=0)))


def test_a_scale_in_each_message(tmp_path: Path) -> None:
    counts = np.rint(at_rest() * 131)
    some = objects(counts, scale=1 / 131, unit="deg/s")
    path = write_objects(tmp_path / "a.mcap", some, STAMPS)
    with pytest.raises(NotStated, match=r"to which scale 0\.00763359 may .*: --units \? --overrule$"):
        open_bag(path)
    with pytest.raises(
        UsageError, match=r"changed by scale 0\.00763359, and --units deg/s does not say whether"
    ):
        open_bag(path, How(units="deg/s"))
    stored = open_bag(path, How(units="lsb:131", overrule=True))
    assert stored.whole().gyro == pytest.approx(counts)
    assert open_bag(path, How(units="deg/s", overrule=True)).whole().gyro == pytest.approx(counts)


def test_axes_of_different_units_are_refused(tmp_path: Path) -> None:
    mixed = [{"gyro_x_dps": 1.0 + k, "gyro_y_rad_s": 2.0, "gyro_z_dps": 3.0} for k in range(20)]
    path = write_objects(tmp_path / "a.mcap", mixed, STAMPS[:20])
    with pytest.raises(
        UsageError, match=r"topic /imu: the axes of one sensor are in different units: gyro_x_dps in"
    ):
        open_bag(path, How(units="dps"))


@pytest.mark.parametrize(("one", "measured"), [(STANDARD_GRAVITY_MS2, "m/s^2"), (1.0, "g"), (5.0, None)])
def test_gravity_measures_the_unit_of_an_accelerometer_in_json(
    tmp_path: Path, one: float, measured: str | None
) -> None:
    path = write_objects(
        tmp_path / "a.mcap", objects(at_rest(), "gyro_dps", accel={"x": 0, "y": 0, "z": one}), STAMPS
    )
    stored = open_bag(path)
    accel = stored.whole().accel_ms2
    if measured is None:
        assert accel is None
        assert answers(stored)["accelerometer"] == ("not read", "missing")
    else:
        assert accel is not None
        assert accel[:, 2] == pytest.approx(STANDARD_GRAVITY_MS2)
        assert answers(stored)["accelerometer"] == (f"accel.x, .y, .z in {measured}", "measured")


def test_null_is_a_missing_number(tmp_path: Path) -> None:
    some = objects(at_rest(), "gyro_dps")
    some[70]["gyro_dps"]["x"] = None
    stored = open_bag(write_objects(tmp_path / "a.mcap", some, STAMPS))
    seq = stored.whole().seq
    assert seq is not None
    assert np.setdiff1d(np.arange(N), seq).tolist() == [70]
    assert stored.whole().gyro[70] == pytest.approx(at_rest()[71])


@pytest.mark.parametrize(
    ("comments", "unit"),
    [
        ({}, None),
        ({"gyro": " rates in rad/s"}, "rad/s"),
        ({"Imu": " from a driver; deg/s"}, "deg/s"),
        ({"Imu": " deg/s", "gyro": " rad/s"}, "rad/s"),
        ({"timestamp_us": " deg/s"}, None),
    ],
)
def test_comments_of_protobuf(tmp_path: Path, comments: dict[str, str], unit: str | None) -> None:
    path = write_protobuf(tmp_path / "a.mcap", at_rest(), STAMPS, comments)
    if unit is None:
        with pytest.raises(NotStated, match=r"nothing says the unit of gyro\.x, \.y, \.z"):
            open_bag(path)
    stored = open_bag(path, How(units=unit or "deg/s"))
    assert stored.rate_hz == pytest.approx(RATE_HZ)
    factor = np.degrees(1.0) if unit == "rad/s" else 1.0
    assert stored.whole().gyro == pytest.approx(at_rest() * factor, rel=1e-5)


# --- times of objects ---


def stamped(times: Sequence[Any], name: str = "timestamp") -> list[dict[str, Any]]:
    return [{name: t, "gyro_dps": row} for t, row in zip(times, at_rest().tolist(), strict=True)]


@pytest.mark.parametrize("unit_s", [1.0, 1e-3, 1e-6, 1e-9])
def test_arrivals_tell_the_unit_of_times(tmp_path: Path, unit_s: float) -> None:
    """The board counts the time from power-up in an unknown unit. Some stamps are missing."""
    kept = np.delete(np.arange(N), [100, 101])
    times = (3.0 + kept / RATE_HZ) / unit_s
    some = [
        one for k, one in enumerate(stamped(((3.0 + np.arange(N) / RATE_HZ) / unit_s).tolist())) if k in kept
    ]
    arrivals = [STAMPS[k] + 1_000_000 for k in kept]
    stored = open_bag(write_objects(tmp_path / "a.mcap", some, arrivals))
    assert len(times) == stored.samples
    assert stored.rate_hz == pytest.approx(RATE_HZ, rel=1e-6)
    assert stored.notes == ()


def test_a_unit_of_times_that_nothing_tells(tmp_path: Path) -> None:
    some = stamped((np.arange(N) * 7.0).tolist())  # the times grow by 7 per message, in no known unit
    stored = open_bag(write_objects(tmp_path / "a.mcap", some, STAMPS))
    assert stored.rate_hz == pytest.approx(RATE_HZ)
    assert (
        "nothing says the unit of timestamp (--time-unit ?), so the times of arrival are used"
        in told(stored)["bag_stamps"]
    )
    given_ms = open_bag(write_objects(tmp_path / "b.mcap", some, STAMPS), How(time_unit="ms"))
    assert given_ms.rate_hz == pytest.approx(1000 / 7)
    named = stamped((np.arange(N) * 5000).tolist(), "timestamp_us")
    path = write_objects(tmp_path / "c.mcap", named, STAMPS)
    with pytest.raises(
        UsageError, match=r"timestamp_us is 1e-06 s by its name.*--time-unit ms says otherwise"
    ):
        open_bag(path, How(time_unit="ms"))
    assert open_bag(path, How(time_unit="ms", overrule=True)).rate_hz == pytest.approx(0.2)


@pytest.mark.parametrize(("unit", "period"), [("us", 5.0), ("s", 5.0), ("ms", 5000.0), ("ms", 0.005)])
def test_a_unit_of_times_against_the_arrivals(tmp_path: Path, unit: TimeUnit, period: float) -> None:
    path = write_objects(tmp_path / "a.mcap", stamped((np.arange(N) * period).tolist()), STAMPS)
    with pytest.raises(UsageError, match=r"by the times of arrival it is 200 Hz\. Leave --time-unit out"):
        open_bag(path, How(time_unit=unit))
    assert open_bag(path).rate_hz == pytest.approx(RATE_HZ)
    overruled = open_bag(path, How(time_unit=unit, overrule=True))
    assert overruled.rate_hz == pytest.approx(1 / (period * SECONDS[unit]))


def test_a_stated_unit_of_times_against_the_arrivals(tmp_path: Path) -> None:
    path = write_objects(tmp_path / "a.mcap", stamped((np.arange(N) * 5.0).tolist(), "timestamp_us"), STAMPS)
    with pytest.raises(UsageError, match=r"is 200000 Hz, and by .* 200 Hz\. .*: --time-unit \? --overrule"):
        open_bag(path)
    assert open_bag(path, How(time_unit="ms", overrule=True)).rate_hz == pytest.approx(RATE_HZ)
    in_minutes = stamped((np.arange(N) / RATE_HZ / 60).tolist(), "time [min]")
    assert open_bag(write_objects(tmp_path / "b.mcap", in_minutes, STAMPS)).rate_hz == pytest.approx(RATE_HZ)


def test_times_that_no_gyroscope_has_tell_no_rate(tmp_path: Path) -> None:
    """A converter that writes all messages at once stamps them with the time of writing, so the user is asked
    for the rate.
    """
    at_once = [START_NS + 40 * k for k in range(N)]
    bare = [{"gyro_dps": row} for row in at_rest().tolist()]
    path = write_objects(tmp_path / "a.mcap", bare, at_once)
    with pytest.raises(NotStated, match=r"nothing says the rate: .* 4e-08 s apart.*: --rate \?"):
        open_bag(path)
    assert open_bag(path, How(rate_hz=50.0)).rate_hz == 50.0
    bare = [{"gyro": row} for row in at_rest().tolist()]
    with pytest.raises(NotStated, match=r"the unit of gyro_x.*; and the rate.*: --units \? --rate \?\n"):
        open_bag(write_objects(tmp_path / "b.mcap", bare, at_once))
    fast = stamped((np.arange(N) * 10.0).tolist(), "timestamp_us")
    with pytest.raises(UsageError, match="is 100000 Hz, and no gyroscope has that"):
        open_bag(write_objects(tmp_path / "c.mcap", fast, at_once))


def test_dates_are_times(tmp_path: Path) -> None:
    dates = [f"2023-11-14T22:13:{k / RATE_HZ:07.4f}Z" for k in range(N)]
    stored = open_bag(write_objects(tmp_path / "a.mcap", stamped(dates), STAMPS))
    assert stored.rate_hz == pytest.approx(RATE_HZ, rel=1e-6)
    assert stored.notes == ()
