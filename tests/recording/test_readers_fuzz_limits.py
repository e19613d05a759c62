"""Files that refer to other files, messages with many fields, and sessions with few resources lead to an
error with a reason.
"""

import contextlib
import json
import os
import resource
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np
import pytest
from fltea.recording import process_limits
from fltea.recording.readers import hdf5
from fltea.recording.ros_bag import open_bag
from fltea.records.errors import FlteaError
from fltea.settings.limits import Limits
from fltea.sources.replay import ReplaySource
from google.protobuf import descriptor_pb2
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.writer import Writer

from tests.rig.corpus_files import HERE

MB = 1_000_000
START_NS = 1_700_000_000_000_000_000


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("fuzz")
    os.mkfifo(folder / "pipe")
    (folder / "other").write_bytes(np.zeros(3000).tobytes())
    return folder


ELSEWHERE = st.sampled_from(["storage", "virtual", "link", "soft", "here"])
TARGETS = st.sampled_from(["pipe", "other", "gone", "a.h5", "/dev/zero", ".", "../x", "part%b.h5", "é"])
PLACES = st.sampled_from(
    ["gyro_dps", "imu/gyro_dps", "time_s", "imu/axis1", "imu/block0_values", "imu/table", "x"]
)


@pytest.mark.slow
@given(st.lists(st.tuples(PLACES, ELSEWHERE, TARGETS), min_size=1, max_size=4), st.booleans())
@settings(max_examples=60)
def test_hdf5_never_reads_another_file(
    folder: Path, places: list[tuple[str, str, str]], is_pandas: bool
) -> None:
    """A pipe would make the reader wait, and /dev/zero never ends, so the reader must open neither."""
    path = folder / "a.h5"
    with h5py.File(path, "w") as file:
        if is_pandas:
            file.create_group("imu").attrs.update({"pandas_type": "frame", "nblocks": 1})
            file["imu/block0_items"] = [b"gyro_x_dps"]
        for place, kind, target in places:
            # if two places have the same name, the second link raises one of these errors
            with contextlib.suppress(ValueError, OSError, RuntimeError):
                _put(file, place, kind, target)
    before = os.getcwd()
    os.chdir(folder)
    try:
        # `by_library` turns the errors that a library raises into messages
        with contextlib.suppress(FlteaError, KeyError, ValueError):
            sheet = hdf5.read(path, "")
            for block in sheet.blocks(range(len(sheet.names))):
                # No value of the file is 0. The values in the other file are 0, and so are those that HDF5
                # puts in for missing data: neither may be read.
                assert not (block == 0).any()
    finally:
        os.chdir(before)


def _put(file: Any, place: str, kind: str, target: str) -> None:
    match kind:
        case "storage":
            file.create_dataset(place, (1000, 3), "f8", external=[(target, 0, h5py.h5f.UNLIMITED)])
        case "virtual":
            layout = h5py.VirtualLayout((1000, 3), "f8")
            layout[:] = h5py.VirtualSource(target, "x", (1000, 3))
            file.create_virtual_dataset(place, layout)
        case "link":
            file[place] = h5py.ExternalLink(target, "/")
        case "soft":
            file[place] = h5py.SoftLink(target)
        case _:
            file[place] = np.random.default_rng(1).normal(size=(1000, 3))


def _wide(fields: int, depth: int, lists: int, value: Any) -> dict[str, Any]:
    found: dict[str, Any] = {f"f{k}": value for k in range(fields)}
    found |= {f"l{k}": [value] * 3 for k in range(lists)}
    for _ in range(depth):
        found = {"inner": found}
    return {"gyro_x_dps": 0.1, "gyro_y_dps": 0.2, "gyro_z_dps": 0.3} | found


@pytest.mark.slow
@given(
    fields=st.sampled_from([0, 10, 990, 1001, 5000]),
    depth=st.integers(0, 8),
    lists=st.sampled_from([0, 3, 400]),
    value=st.sampled_from([0, 10**400, -(10**400), 1e308, "x", None, {}, [], True]),
    topics=st.integers(1, 4),
)
@settings(max_examples=25)
def test_messages_of_any_width(
    folder: Path, fields: int, depth: int, lists: int, value: Any, topics: int
) -> None:
    path = folder / "a.mcap"
    data = json.dumps(_wide(fields, depth, lists, value)).encode()
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        for topic in range(topics):
            channel = writer.register_channel(f"/imu{topic}", "json", 0)
            for k in range(20):
                at_ns = START_NS + k * 10_000_000
                writer.add_message(channel, at_ns, data, at_ns)
        writer.finish()
    with contextlib.suppress(FlteaError):
        open_bag(path, limits=Limits(max_chunk_mb=1, max_mb=1, seconds=60.0))


class Wide(NamedTuple):
    """A schema with message types T0, T1 …, each of which has fields that hold the next type.

    `names`: names of the first fields of each type, which hold numbers. `fields`: how many more fields with
    numbers each type has. `types`: number of types.

    `parts`: number of fields that hold the next type. `many`: None if such a field holds one message;
    otherwise it holds an array of this length, where 0 means any length. `is_circle`: whether the last type
    holds T0.
    """

    names: list[str]
    fields: int
    types: int
    parts: int
    many: int | None
    is_circle: bool

    def parts_of(self, number: int) -> list[tuple[str, int]]:
        """Return the fields of the message type T`number` that hold messages. For each, return its name and
        the number of the type that it holds.
        """
        following = (number + 1) % self.types if self.is_circle else number + 1
        return [(f"p{k}", following) for k in range(self.parts)] if following < self.types else []


def _ros(wide: Wide) -> bytes:
    many = "" if wide.many is None else f"[{wide.many or ''}]"
    blocks = []
    for number in range(wide.types):
        lines = [f"float64 {name}" for name in (*wide.names, *(f"f{k}" for k in range(wide.fields)))]
        lines += [f"T{inner}{many} {name}" for name, inner in wide.parts_of(number)]
        blocks.append("\n".join([f"MSG: robot/T{number}"] * (number > 0) + lines) + "\n")
    return f"\n{'=' * 80}\n".join(blocks).encode()


def _protobuf(wide: Wide) -> bytes:
    field = descriptor_pb2.FieldDescriptorProto
    found = descriptor_pb2.FileDescriptorSet()
    file = found.file.add(name="imu.proto", package="robot", syntax="proto3")
    label = field.LABEL_OPTIONAL if wide.many is None else field.LABEL_REPEATED
    for number in range(wide.types):
        message = file.message_type.add(name=f"T{number}")
        # Fields that hold messages get the numbers 1, 2, …, since MESSAGES (below) has bytes that put
        # messages into the field 1.
        for place, (name, inner) in enumerate(wide.parts_of(number), 1):
            message.field.add(
                name=name, number=place, label=label, type=field.TYPE_MESSAGE, type_name=f".robot.T{inner}"
            )
        names = [*wide.names, *(f"f{k}" for k in range(wide.fields))]
        for place, name in enumerate(names, len(message.field) + 1):
            message.field.add(name=name, number=place, label=field.LABEL_OPTIONAL, type=field.TYPE_DOUBLE)
    return found.SerializeToString()


def _json_schema(wide: Wide) -> bytes:
    definitions = {}
    for number in range(wide.types):
        fields: dict[str, Any] = {
            name: {"type": "number", "description": "deg/s"}
            for name in (*wide.names, *(f"f{k}" for k in range(wide.fields)))
        }
        for name, inner in wide.parts_of(number):
            one = {"$ref": f"#/$defs/T{inner}"}
            fields[name] = one if wide.many is None else {"type": "array", "items": one}
        definitions[f"T{number}"] = {"title": "a part", "properties": fields}
    return json.dumps({"$ref": "#/$defs/T0", "$defs": definitions}).encode()


SCHEMAS = {
    "ros1msg": ("ros1", _ros),
    "ros2msg": ("cdr", _ros),
    "protobuf": ("protobuf", _protobuf),
    "jsonschema": ("json", _json_schema),
}
"""For each encoding of a schema, the encoding of its messages, and a function that writes the schema."""

WIDE = st.builds(
    Wide,
    st.sampled_from([["gyro_x_dps", "gyro_y_dps", "gyro_z_dps"], ["x", "y", "z"], []]),
    st.sampled_from([0, 3, 990, 1001, 5000]),
    st.integers(1, 12),
    st.sampled_from([1, 2, 50]),
    st.sampled_from([None, 0, 3, 5000]),
    st.booleans(),
)
MESSAGES = (
    st.binary(max_size=200)
    | st.integers(0, 60_000).map(bytes)
    # Protobuf messages in the field 1: many empty ones in a row, or each one inside the one before
    | st.integers(0, 30_000).map(lambda n: b"\x0a\x00" * n)
    | st.integers(0, 60).map(lambda n: b"".join(bytes([10, 2 * k]) for k in range(n, -1, -1)))
    | st.integers(0, 5000).map(lambda n: json.dumps(_wide(n, 1, 3, 0.5)).encode())
)


@pytest.mark.slow
@given(
    kind=st.sampled_from(sorted(SCHEMAS)),
    wide=WIDE,
    messages=st.lists(MESSAGES, min_size=1, max_size=4),
    cut=st.none() | st.integers(0, 2000),
)
@settings(max_examples=60)
def test_schemas_of_any_width(
    folder: Path, kind: str, wide: Wide, messages: list[bytes], cut: int | None
) -> None:
    """`cut`: length to which the schema is cut, or None."""
    path = folder / "a.mcap"
    encoding, write = SCHEMAS[kind]
    name = "robot.T0" if kind == "protobuf" else "robot/msg/T0"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema(name, kind, write(wide)[:cut])
        channel = writer.register_channel("/imu", encoding, schema)
        for k in range(20):
            at_ns = START_NS + k * 10_000_000
            head = b"\0\1\0\0" if encoding == "cdr" else b""
            writer.add_message(channel, at_ns, head + messages[k % len(messages)], at_ns)
        writer.finish()
    with contextlib.suppress(FlteaError):
        open_bag(path, limits=Limits(max_chunk_mb=1, max_mb=1, seconds=60.0))


@pytest.mark.slow
@given(
    name=st.sampled_from(["pandas.parquet", "phyphox.xlsx", "h5py.h5"]),
    addresses=st.integers(20 * MB, 600 * MB),
    seconds=st.sampled_from([1, 2, 60]),
)
@settings(max_examples=6)
def test_a_session_with_little_of_anything(name: str, addresses: int, seconds: int) -> None:
    """In a login session with little address space and processor time, a file is read, or refused with a
    message that blames the session's limits and not the file.
    """
    session = {resource.RLIMIT_AS: addresses, resource.RLIMIT_CPU: seconds}
    said: FlteaError | None = None
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(process_limits, "least_of", lambda what, ours: min(ours, session[what]))
        try:
            ReplaySource(HERE / name)
        except FlteaError as error:
            said = error
    assert said is None or (said.exit_code == 1 and ("ulimit -v" in str(said) or "ulimit -t" in str(said)))
