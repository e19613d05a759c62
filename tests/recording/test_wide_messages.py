"""Tests messages with thousands of fields, which a small schema can describe, and huge whole numbers."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fltea.recording import bag_objects, quota
from fltea.recording.bag_definition import parse_definition
from fltea.recording.files import Stored
from fltea.recording.quota import MOST_FIELDS, Quota
from fltea.recording.ros_bag import open_bag
from fltea.records.errors import UsageError
from fltea.settings.limits import Limits
from google.protobuf import descriptor_pb2
from mcap.writer import Writer

from tests.rig.bag_support import START_NS, gathered, write_objects

N = 60
STAMPS = [START_NS + k * 10_000_000 for k in range(N)]
GYRO = np.random.default_rng(1).normal(size=(N, 3)).round(4)
NAMES = ["time_s", "gyro_x_dps", "gyro_y_dps", "gyro_z_dps"]
FIELD = descriptor_pb2.FieldDescriptorProto


def objects(more: int = 0) -> list[dict[str, Any]]:
    others = {f"f{k}": 0 for k in range(more)}
    return [dict(zip(NAMES, (k / 100, *row), strict=True)) | others for k, row in enumerate(GYRO.tolist())]


def schema_of(fields: int, parts: int = 0) -> bytes:
    """Return the Protobuf schema of a message with `fields` fields of type double. The first of these fields
    have the names NAMES.

    The message also has a list of messages of another type. `parts`: number of fields of that type.
    """
    found = descriptor_pb2.FileDescriptorSet()
    file = found.file.add(name="imu.proto", package="robot", syntax="proto3")
    imu, part = file.message_type.add(name="Imu"), file.message_type.add(name="Part")
    one: dict[str, Any] = {"label": FIELD.LABEL_OPTIONAL, "type": FIELD.TYPE_DOUBLE}
    names = [*NAMES, *(f"f{k}" for k in range(fields - len(NAMES)))]
    for number, name in enumerate(names, 2):
        imu.field.add(name=name, number=number, **one)
    for number in range(1, parts + 1):
        part.field.add(name=f"p{number}", number=number, **one)
    imu.field.add(
        name="parts", number=1, label=FIELD.LABEL_REPEATED, type=FIELD.TYPE_MESSAGE, type_name=".robot.Part"
    )
    return found.SerializeToString()


def doubles(values: Sequence[float], first: int = 2) -> bytes:
    return b"".join(bytes([8 * k + 1]) + np.float64(v).tobytes() for k, v in enumerate(values, first))


def write_protobuf(path: Path, schema: bytes, tail: bytes = b"") -> Path:
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel(
            "/imu", "protobuf", writer.register_schema("robot.Imu", "protobuf", schema)
        )
        for k, stamp in enumerate(STAMPS):
            writer.add_message(channel, stamp, doubles([k / 100, *GYRO[k]]) + tail, stamp)
        writer.finish()
    return path


def check_read(path: Path) -> Stored:
    found = open_bag(path)
    np.testing.assert_allclose(np.rad2deg(gathered(found)), GYRO)
    return found


def refusal(path: Path) -> str:
    with pytest.raises(UsageError) as caught:
        open_bag(path)
    return str(caught.value)


def test_a_schema_of_many_fields(tmp_path: Path) -> None:
    path = write_protobuf(tmp_path / "a.mcap", schema_of(MOST_FIELDS - 1))
    check_read(path)
    # the message type has one more field than is allowed
    path = write_protobuf(tmp_path / "a.mcap", schema_of(MOST_FIELDS))
    assert f"/imu: a message has more than {MOST_FIELDS} fields" in refusal(path)


def test_a_list_of_parts_that_have_many_fields(tmp_path: Path) -> None:
    """Each empty message in a list takes two bytes of the file, but becomes 900 numbers in memory."""
    schema = schema_of(4, parts=900)
    check_read(write_protobuf(tmp_path / "a.mcap", schema, b"\x0a\x00"))
    path = write_protobuf(tmp_path / "a.mcap", schema, b"\x0a\x00" * 20_000)
    assert "a message has more than" in refusal(path)


def test_an_object_of_many_keys(tmp_path: Path) -> None:
    path = write_objects(tmp_path / "a.mcap", objects(MOST_FIELDS - 4), STAMPS)
    check_read(path)
    path = write_objects(tmp_path / "a.mcap", objects(MOST_FIELDS - 3), STAMPS)
    assert f"/imu: a message has more than {MOST_FIELDS} fields" in refusal(path)


def test_a_topic_of_many_fields_does_not_hide_another(tmp_path: Path) -> None:
    with (tmp_path / "a.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start()
        wide, plain = (writer.register_channel(name, "json", 0) for name in ("/state/imu", "/imu"))
        for stamp, one, other in zip(STAMPS, objects(MOST_FIELDS), objects(), strict=True):
            writer.add_message(wide, stamp, json.dumps(one).encode(), stamp)
            writer.add_message(plain, stamp, json.dumps(other).encode(), stamp)
        writer.finish()
    found = check_read(tmp_path / "a.mcap")
    assert any("/state/imu: a message has more than" in note.text for note in found.notes)


def test_decoding_has_a_quota(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Decoding has a quota of processor time that grows with each message. Here each message takes ten
    seconds, which exceeds the quota.
    """
    path = write_objects(tmp_path / "a.mcap", objects(), STAMPS)
    clock_s = [0.0]

    def slow(data: bytes) -> dict[str, Any]:
        clock_s[0] += 10.0
        return decode(data)

    decode = bag_objects.decode_object
    monkeypatch.setattr(bag_objects, "decode_object", slow)
    monkeypatch.setattr(quota.time, "thread_time", lambda: clock_s[0])
    assert "took more than 5 s of processor time" in refusal(path)
    assert clock_s == [10.0]


def test_definitions_of_ros_have_a_quota(tmp_path: Path) -> None:
    used = Quota(tmp_path, Limits(seconds=-1.0), 0)
    with pytest.raises(UsageError, match="of processor time"):
        next(used.messages([b""]))
    with pytest.raises(ValueError, match="of too many parts"):
        parse_definition("Nothing[1000000000] x\nfloat64 y\n===\nMSG: a/Nothing\n")
    assert len(parse_definition("P[40] x\nfloat64 y\n===\nMSG: a/P\nfloat64 z\n").fields) == 41


HUGE = int("9" * 400)


@pytest.mark.parametrize("key", [*NAMES[:2], "device_id", "accel_x_g"])
@pytest.mark.parametrize("row", [0, 7])
def test_a_whole_number_that_no_float_holds(key: str, row: int, tmp_path: Path) -> None:
    """A whole number that is too large for a float cannot be a sensor's value.

    If one message contains such a number, the number counts as damage or as a sensor's name, and causes no
    internal error.
    """
    items = [
        one | {"device_id": 7, "accel_x_g": 0.0, "accel_y_g": 0.0, "accel_z_g": 1.0 + one["gyro_x_dps"] / 99}
        for one in objects()
    ]
    items[row][key] = HUGE
    path = write_objects(tmp_path / "a.mcap", items, STAMPS)
    if key == "device_id":
        assert "device_id tells several apart" in refusal(path)
        return
    found = open_bag(path)
    assert found.samples == N - (key != "time_s")
    if key == "gyro_x_dps":
        assert any("1 messages hold a value that is not a number" in note.text for note in found.notes)
