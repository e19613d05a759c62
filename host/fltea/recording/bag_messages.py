"""What every reader of bags gives: messages as they are stored, a batch at a time."""

from dataclasses import dataclass, field
from typing import NamedTuple

from fltea.recording.bag_imu import Encoding, Imu, read_ros, ros_layout
from fltea.recording.bag_names import Layout
from fltea.recording.quota import Quota

LONGEST_MESSAGE = 1 << 16
"""Bytes; an Imu message has 350."""

RATES = b"angular_velocity", b"gyro"
"""What a schema has of a gyroscope."""

DEFINITIONS = "ros1msg", "ros2msg", "jsonschema", "protobuf"
"""Encodings of schemas that are read."""


class Topic(NamedTuple):
    """Whose messages they are. encoding: how they are written; None: in none of those that are known.

    schema: what describes them, in one of DEFINITIONS.
    """

    name: str
    type: str
    encoding: Encoding | None
    schema: bytes = b""

    @property
    def is_imu(self) -> bool:
        """Whether its messages may hold a gyroscope's numbers; of objects only one of them tells it."""
        if self.is_of_objects:
            names = f"{self.type} {self.name}".lower()
            return "imu" in names or "gyro" in names or any(word in self.schema for word in RATES)
        return self.encoding is not None and ros_layout(self.type, self.encoding, self.schema) is not None

    @property
    def is_of_objects(self) -> bool:
        """Whether each message names its numbers, as those of other programs than ROS do."""
        return self.encoding in ("json", "protobuf")

    def layout(self, messages: list[bytes], sensor: str | None, quota: Quota) -> Layout | None:
        """Return what its messages hold, by the first of them; None: no gyroscope's numbers.

        sensor: which of several gyroscopes in a message is meant.

        Raises:
            TooManyFields: they have more than are looked at.
            UsageError: the axes of one sensor state different units, or looking took too much time.
        """
        assert self.encoding is not None
        if not self.is_of_objects:
            return ros_layout(self.type, self.encoding, self.schema, sensor)
        from fltea.recording.bag_objects import layout_of

        return layout_of(messages, self.encoding, self.type, self.schema, sensor, quota)

    def read(self, messages: list[bytes], layout: Layout, quota: Quota) -> Imu:
        """Read messages as they are in the file, in their order; what is none is left out.

        Raises:
            UsageError: they take too much time.
        """
        if not self.is_of_objects:
            return read_ros(messages, layout, is_ros1=self.encoding == "ros1", check=quota.check)
        from fltea.recording.bag_objects import read_objects

        return read_objects(messages, layout, str(self.encoding), self.type, self.schema, quota)


def encoding_of(name: str) -> Encoding | None:
    """How messages are written that a file calls so."""
    match name:
        case "cdr" | "ros1" | "json" | "protobuf":
            return name
    return None


@dataclass
class Batch:
    """Successive messages of one topic; only of Imu topics are they at hand.

    count: how many there are. arrival_ns, data: of each, when it was recorded, and the message. publisher:
    who wrote them, of a topic that may have several, "" if that is not known.
    """

    topic: Topic
    count: int = 0
    arrival_ns: list[int] = field(default_factory=list)
    data: list[bytes] = field(default_factory=list)
    publisher: str = ""
