"""Tests which units the fields of objects in bags (JSON, Protobuf) have.

The evidence is a name, a schema, a comment in the schema, another message, or gravity.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fltea.recording.bag_names import units_in
from fltea.recording.reading import NotStated
from fltea.recording.ros_bag import open_bag
from fltea.recording.units import rate_unit
from fltea.records.errors import UsageError
from fltea.records.units import STANDARD_GRAVITY_MS2
from fltea.settings.how import How
from hypothesis import given
from hypothesis import strategies as st

from tests.rig.bag_at_rest import RATE_HZ, STAMPS, N, answers, at_rest
from tests.rig.bag_support import told, write_objects, write_protobuf


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
    assert told(stored)["bag_messages"].count("1 messages do not have the layout of the other messages") == 1
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
