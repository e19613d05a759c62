"""Types that all readers of bags share: topics, and batches of stored messages."""

import contextlib
from dataclasses import dataclass, field
from itertools import repeat
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fltea.recording.bag_imu import Encoding, Imu, read_ros, ros_layout
from fltea.recording.bag_names import Layout
from fltea.recording.decompress import decompressed_zstd
from fltea.recording.files import Note
from fltea.recording.quota import Quota
from fltea.recording.sample_times import Ints
from fltea.settings.extras import load

LONGEST_MESSAGE = 1 << 16
"""Longest message that is read [bytes]; an Imu message has 350."""

ZSTD = b"\x28\xb5\x2f\xfd"
"""First bytes of a message that was compressed on its own, with zstd."""

RATES = b"angular_velocity", b"gyro"
"""Words in a schema (the description of a message type) that point to a gyroscope."""

DEFINITIONS = "ros1msg", "ros2msg", "jsonschema", "protobuf"
"""Encodings in which a schema, the description of a message type, can be read."""


class Topic(NamedTuple):
    """A topic of a bag, which is a named sequence of messages.

    `encoding`: encoding of its messages, None if it is unknown.

    `schema`: description of its messages, in an encoding of DEFINITIONS.
    """

    name: str
    type: str
    encoding: Encoding | None
    schema: bytes = b""

    @property
    def is_imu(self) -> bool:
        """Whether the topic's messages may hold angular rates.

        For JSON and protobuf, this is guessed from the name of the topic, the name of the type, and the names
        in the schema.
        """
        if self.is_of_objects:
            names = f"{self.type} {self.name}".lower()
            return "imu" in names or "gyro" in names or any(word in self.schema for word in RATES)
        return self.encoding is not None and ros_layout(self.type, self.encoding, self.schema) is not None

    @property
    def is_of_objects(self) -> bool:
        """Whether the messages are objects, in JSON or protobuf, whose fields are found by their names."""
        return self.encoding in ("json", "protobuf")

    def layout(self, messages: list[bytes], sensor: str | None, quota: Quota) -> Layout | None:
        """Return the layout of the first message that holds angular rates; None if there is no such message.

        `sensor`: the gyroscope to read if a message holds several.

        Raises:
            TooManyFields: the messages have more fields than are examined.
            UsageError: the axes of one sensor state different units, or decoding took too much time.
        """
        assert self.encoding is not None
        if not self.is_of_objects:
            return ros_layout(self.type, self.encoding, self.schema, sensor)
        from fltea.recording.bag_objects import layout_of

        return layout_of(messages, self.encoding, self.type, self.schema, sensor, quota)

    def read(self, messages: list[bytes], layout: Layout, quota: Quota) -> Imu:
        """Read messages in the file's order. Messages that do not fit the layout are left out.

        Raises:
            UsageError: reading takes too much time.
        """
        if not self.is_of_objects:
            return read_ros(messages, layout, is_ros1=self.encoding == "ros1", check=quota.check)
        from fltea.recording.bag_objects import read_objects

        return read_objects(messages, layout, str(self.encoding), self.type, self.schema, quota)


def undescribed(path: Path, messages: int) -> Note:
    """Return the note on messages whose topic is not described in the parts of a bag that can be read."""
    many = f"{messages} messages are" if messages > 1 else "one message is"
    text = f"{path}: {many} left out: the description of the topic was in a damaged part."
    return Note("recording_gap", text)


def encoding_of(name: str) -> Encoding | None:
    """Return the encoding that a file calls `name`; None if it is unknown."""
    match name:
        case "cdr" | "ros1" | "json" | "protobuf":
            return name
    return None


@dataclass
class Batch:
    """Successive messages of one topic.

    If the topic can hold no angular rates, the messages are only counted.

    `count`: number of messages. `arrival_ns`: time at which each message was recorded [ns]. `data`: their
    bytes.
    `publisher`: publisher of these messages if a topic may have several, "" if unknown.
    """

    topic: Topic
    count: int = 0
    arrival_ns: list[int] = field(default_factory=list)
    data: list[bytes] = field(default_factory=list)
    publisher: str = ""


class Undecoded:
    """Messages of one topic that wait, since many are decoded faster at once than one by one.

    `quota`: limits of time and memory for decoding the messages.
    """

    def __init__(self, quota: Quota) -> None:
        self._quota = quota
        self._waiting: list[tuple[int, bytes, str]] = []

    def __len__(self) -> int:
        return len(self._waiting)

    def add(self, batch: Batch) -> None:
        """Add a batch of messages."""
        self._waiting.extend(zip(batch.arrival_ns, batch.data, repeat(batch.publisher)))

    def decode(self, topic: Topic, layout: Layout) -> tuple[Imu, Ints, NDArray[np.str_]]:
        """Decode all messages; return their numbers, and the arrival time and publisher of each message."""
        arrivals, data, by = zip(*self._waiting, strict=True)
        self._waiting.clear()
        imu = topic.read(list(map(_unpacked, data)), layout, self._quota)
        return imu, np.array(arrivals, np.int64), np.array(by, np.str_)


def _unpacked(message: bytes) -> bytes:
    if not message.startswith(ZSTD):
        return message
    zstandard = load("zstandard", "zstandard", "ros", "Bags that are compressed by zstd need")
    with contextlib.suppress(zstandard.ZstdError):
        return decompressed_zstd(message, LONGEST_MESSAGE)
    return b""
