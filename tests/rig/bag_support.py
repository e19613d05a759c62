"""Write ROS bags with the library `rosbags`, for tests."""

import contextlib
import json
import shutil
import sqlite3
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from mcap.writer import Writer as McapWriter
from numpy.typing import ArrayLike, NDArray
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

IMU = "sensor_msgs/msg/Imu"
START_NS = 1_700_000_000_123_456_789
KINDS = ("bag", "db3", "mcap")
ROS1_PACKED = {"lz4": Ros1Writer.CompressionFormat.LZ4, "bz2": Ros1Writer.CompressionFormat.BZ2}
ROS2_PACKED = {
    "file": CompressionMode.FILE,
    "message": CompressionMode.MESSAGE,
    "storage": CompressionMode.STORAGE,
}

PX4_FIFO = """uint64 timestamp
uint64 timestamp_sample
uint32 device_id
float32 dt
float32 scale
uint8 samples
int16[32] x
int16[32] y
int16[32] z
"""
"""The definition of the message px4_msgs/SensorGyroFifo."""

PX4_GYRO = """uint64 timestamp
uint64 timestamp_sample
uint32 device_id
{}float32 x
float32 y
float32 z
float32 temperature
uint32 error_count
uint8[3] clip_counter
uint8 samples
"""


class Messages(NamedTuple):
    """Messages of a topic of the ROS type Imu.

    `arrival_ns`: arrival times; by default shortly after the stamps. `frame`: one frame id, or several that
    messages use in turns.
    """

    stamp_ns: Sequence[int]
    gyro_rads: ArrayLike
    accel_ms2: ArrayLike | None = None
    arrival_ns: Sequence[int] | None = None
    frame: str | Sequence[str] = "imu_link"
    unknown: tuple[str, ...] = ()
    """Sensors ("gyro" or "accel") that the messages mark as not measured, by a covariance of -1."""

    def rows(self, chosen: Any) -> "Messages":
        """Return the messages at the chosen indices, some of which may occur twice."""
        columns = (None if column is None else np.asarray(column)[chosen] for column in self[:4])
        return Messages(*columns, *self[4:])  # type: ignore[arg-type]


def even(n: int, rate_hz: float = 200.0, seed: int = 1) -> Messages:
    """Return messages of a sensor at rest with evenly spaced stamps."""
    rng = np.random.default_rng(seed)
    stamps = START_NS + np.round(np.arange(n) * 1e9 / rate_hz).astype(np.int64)
    return Messages(stamps.tolist(), rng.normal(0, 1e-3, (n, 3)), rng.normal([0, 0, 9.81], 1e-2, (n, 3)))


@cache
def types(ros1: bool) -> Any:
    return get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)


def serialised(m: Messages, ros1: bool, little_endian: bool = True) -> list[tuple[int, bytes]]:
    """Return the arrival time and the serialised bytes of each message, as a bag stores them."""
    store = types(ros1)
    known = store.types
    header, time = known["std_msgs/msg/Header"], known["builtin_interfaces/msg/Time"]
    vector, quaternion = known["geometry_msgs/msg/Vector3"], known["geometry_msgs/msg/Quaternion"]
    gyro = np.asarray(m.gyro_rads, dtype=np.float64)
    accel = np.zeros_like(gyro) if m.accel_ms2 is None else np.asarray(m.accel_ms2, dtype=np.float64)
    arrivals = [t + 300_000 for t in m.stamp_ns] if m.arrival_ns is None else m.arrival_ns
    covariance = {
        name: np.array([-1.0 if name in m.unknown else 0.0] + [0.0] * 8) for name in ("gyro", "accel")
    }
    numbered = {"seq": 0} if ros1 else {}
    frames = [m.frame] if isinstance(m.frame, str) else m.frame
    out = []
    for i, (stamp_ns, arrival_ns) in enumerate(zip(m.stamp_ns, arrivals, strict=True)):
        seconds, rest = divmod(int(stamp_ns), 10**9)
        message = known[IMU](
            header(stamp=time(seconds, rest), frame_id=frames[i % len(frames)], **numbered),
            quaternion(0.0, 0.0, 0.0, 1.0),
            np.zeros(9),
            vector(*gyro[i]),
            covariance["gyro"],
            vector(*accel[i]),
            covariance["accel"],
        )
        data = (
            store.serialize_ros1(message, IMU)
            if ros1
            else store.serialize_cdr(message, IMU, little_endian=little_endian)
        )
        out.append((int(arrival_ns), bytes(data)))
    return out


def write_bag(
    path: Path,
    topics: dict[str, Messages],
    *,
    packed: str | None = None,
    words: Sequence[str] = (),
    chunk_bytes: int | None = None,
) -> Path:
    """Write a bag: NAME.bag, or a folder NAME.db3 or NAME.mcap as `ros2 bag record` makes it.

    `words`: names of additional topics with one text message each. `packed`: for ROS 1 the compression
    method, for ROS 2 what is compressed (each message, or the whole file).
    """
    ros1 = path.suffix == ".bag"
    store = types(ros1)
    if ros1:
        path.unlink(missing_ok=True)
        writer: Any = Ros1Writer(path)
        if packed:
            writer.set_compression(ROS1_PACKED[packed])
        if chunk_bytes:
            writer.chunk_threshold = chunk_bytes
    else:
        shutil.rmtree(path, ignore_errors=True)
        plugin = StoragePlugin.SQLITE3 if path.suffix == ".db3" else StoragePlugin.MCAP
        writer = Ros2Writer(path, version=9, storage_plugin=plugin)
        if packed:
            writer.set_compression(ROS2_PACKED[packed], CompressionFormat.ZSTD)
    with writer:
        entries = []
        for word in words:
            text = "std_msgs/msg/String"
            connection = writer.add_connection(word, text, typestore=store)
            value = store.types[text]("a word")
            data = store.serialize_ros1(value, text) if ros1 else store.serialize_cdr(value, text)
            entries.append((START_NS, connection, bytes(data)))
        for name, messages in topics.items():
            connection = writer.add_connection(name, IMU, typestore=store)
            entries += [(arrival, connection, data) for arrival, data in serialised(messages, ros1)]
        for arrival, connection, data in sorted(entries, key=lambda entry: entry[0]):
            writer.write(connection, arrival, data)
    return path


def write_publishers(path: Path, publishers: dict[str, Messages]) -> Path:
    """Write a bag of ROS 1 or an MCAP file in which several programs publish the topic /imu."""
    known, ros1 = (
        {name: serialised(one, ros1=True) for name, one in publishers.items()},
        path.suffix == ".bag",
    )
    with contextlib.ExitStack() as stack:
        if ros1:
            writer: Any = stack.enter_context(Ros1Writer(path))
            by = {n: writer.add_connection("/imu", IMU, typestore=types(True), callerid=n) for n in known}
        else:
            writer = McapWriter(stack.enter_context(path.open("wb")))
            writer.start("ros1")
            schema = writer.register_schema("sensor_msgs/Imu", "ros1msg", b"")
            by = {n: writer.register_channel("/imu", "ros1", schema, {"callerid": n}) for n in known}
        rows = sorted((arrival, name, data) for name, one in known.items() for arrival, data in one)
        for arrival, name, data in rows:
            if ros1:
                writer.write(by[name], arrival, data)
            else:
                writer.add_message(by[name], arrival, data, arrival)
        if not ros1:
            writer.finish()
    return path


def write_mcap(path: Path, messages: Messages, *, profile: str = "ros2", **how: Any) -> Path:
    """Write the topic /imu with the library `mcap`.

    `how`: options of the library's writer.
    """
    ros1 = profile == "ros1"
    with path.open("wb") as file:
        writer = McapWriter(file, **how)
        writer.start(profile)
        name = "sensor_msgs/Imu" if ros1 else IMU
        schema = writer.register_schema(name, "ros1msg" if ros1 else "ros2msg", b"")
        channel = writer.register_channel("/imu", "ros1" if ros1 else "cdr", schema)
        for arrival, data in serialised(messages, ros1):
            writer.add_message(channel, arrival, data, arrival)
        writer.finish()
    return path


def write_objects(
    path: Path,
    objects: Sequence[dict[str, Any]],
    arrival_ns: Sequence[int],
    *,
    kind: str = "Imu",
    schema: dict[str, Any] | None = None,
) -> Path:
    """Write the topic /imu as JSON messages in MCAP.

    `schema`: the JSON Schema; None writes no schema.
    """
    with path.open("wb") as file:
        writer = McapWriter(file)
        writer.start()
        number = 0
        if schema is not None:
            number = writer.register_schema(kind, "jsonschema", json.dumps(schema).encode())
        channel = writer.register_channel("/imu", "json", number)
        for arrival, one in zip(arrival_ns, objects, strict=True):
            writer.add_message(channel, int(arrival), json.dumps(one).encode(), int(arrival))
        writer.finish()
    return path


def write_protobuf(path: Path, gyro: ArrayLike, arrival_ns: Sequence[int], comments: dict[str, str]) -> Path:
    """Write the message robot.Imu in MCAP, with its rates in a field `rate`.

    `comments`: comments in the schema, on the message (`Imu`) and on its fields.
    """
    field = descriptor_pb2.FieldDescriptorProto
    files = descriptor_pb2.FileDescriptorSet()
    file = files.file.add(name="imu.proto", package="robot", syntax="proto3")
    vector, imu = file.message_type.add(name="Vector3"), file.message_type.add(name="Imu")
    one = {"label": field.LABEL_OPTIONAL}
    for number, axis in enumerate("xyz", 1):
        vector.field.add(name=axis, number=number, type=field.TYPE_FLOAT, **one)
    imu.field.add(name="timestamp_us", number=1, type=field.TYPE_UINT64, **one)
    imu.field.add(name="gyro", number=2, type=field.TYPE_MESSAGE, type_name=".robot.Vector3", **one)
    places = {"Imu": [4, 1], "timestamp_us": [4, 1, 2, 0], "gyro": [4, 1, 2, 1]}
    for name, comment in comments.items():
        file.source_code_info.location.add(path=places[name], span=[0, 0, 0], trailing_comments=comment)
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    message = message_factory.GetMessageClass(pool.FindMessageTypeByName("robot.Imu"))
    with path.open("wb") as out:
        writer = McapWriter(out)
        writer.start()
        schema = writer.register_schema("robot.Imu", "protobuf", files.SerializeToString())
        channel = writer.register_channel("/imu", "protobuf", schema)
        for arrival, row in zip(arrival_ns, np.asarray(gyro).tolist(), strict=True):
            axes = dict(zip("xyz", row, strict=True))
            data = message(timestamp_us=arrival // 1000, gyro=axes).SerializeToString()
            writer.add_message(channel, int(arrival), data, int(arrival))
        writer.finish()
    return path


def write_types(
    path: Path, topics: dict[str, tuple[str, str, Sequence[dict[str, Any]]]], arrival_ns: Sequence[int]
) -> Path:
    """Write a bag of message types that ROS does not define.

    `topics`: for each topic's name, type, definition and messages.
    """
    ros1 = path.suffix == ".bag"
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    rows = {}
    for name, (kind, definition, messages) in topics.items():
        store.register(get_types_from_msg(definition, kind))
        serialise = store.serialize_ros1 if ros1 else store.serialize_cdr
        rows[name] = [bytes(serialise(made(store, kind, fields), kind)) for fields in messages]
    if path.suffix == ".mcap":
        with path.open("wb") as file:
            writer: Any = McapWriter(file)
            writer.start("ros2")
            for name, (kind, definition, _) in topics.items():
                schema = writer.register_schema(kind, "ros2msg", definition.encode())
                channel = writer.register_channel(name, "cdr", schema)
                for arrival, data in zip(arrival_ns, rows[name], strict=True):
                    writer.add_message(channel, int(arrival), data, int(arrival))
            writer.finish()
        return path
    writer = Ros1Writer(path) if ros1 else Ros2Writer(path, version=9, storage_plugin=StoragePlugin.SQLITE3)
    with writer:
        for name, (kind, _, _) in topics.items():
            connection = writer.add_connection(name, kind, typestore=store)
            for arrival, data in zip(arrival_ns, rows[name], strict=True):
                writer.write(connection, int(arrival), data)
    # The library rosbags drops the comments of a definition, so they are inserted again.
    for store_file in path.glob("*.db3"):
        with contextlib.closing(sqlite3.connect(store_file)) as database, database:
            for kind, definition, _ in topics.values():
                database.execute(
                    "UPDATE message_definitions SET encoded_message_definition = ? WHERE topic_type = ?",
                    (definition, kind),
                )
    return path


def made(store: Any, kind: str, fields: dict[str, Any]) -> Any:
    """Make a message from the values of its fields; a nested message is given as a dict."""
    types = {name: node[1] for name, node in store.fielddefs[kind][1]}
    values = {}
    for name, value in fields.items():
        values[name] = made(store, types[name], value) if isinstance(value, dict) else value
    return store.types[kind](**values)


def gathered(stored: Any) -> NDArray[np.float64]:
    """Return all angular rates of a recording [rad/s], of shape (n, 3)."""
    return np.radians(stored.whole().gyro)


def told(stored: Any) -> dict[str, str]:
    """Return the text of each warning (note) about a recording, by the kind of the warning."""
    return {note.kind: note.text for note in stored.notes}
