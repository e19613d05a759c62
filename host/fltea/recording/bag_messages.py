"""What every reader of bags gives: messages as they are stored, a batch at a time."""

from dataclasses import dataclass, field
from typing import NamedTuple

from fltea.recording.bag_imu import IMU_TYPES, Encoding

LONGEST_MESSAGE = 1 << 16
"""Bytes; an Imu message has 350."""


RATES = b"angular_velocity", b"gyro"
"""What a schema has of a gyroscope."""


class Topic(NamedTuple):
    """Whose messages they are. encoding: how they are written; None: in none of those that are known.

    schema: of objects, what describes them.
    """

    name: str
    type: str
    encoding: Encoding | None
    schema: bytes = b""

    @property
    def is_imu(self) -> bool:
        """Whether its messages can be read here."""
        if self.is_of_objects:
            names = f"{self.type} {self.name}".lower()
            return "imu" in names or "gyro" in names or any(word in self.schema for word in RATES)
        return self.type in IMU_TYPES and self.encoding is not None

    @property
    def is_of_objects(self) -> bool:
        """Whether each message names its numbers, as those of other programs than ROS do."""
        return self.encoding in ("json", "protobuf")


def encoding_of(name: str) -> Encoding | None:
    """How messages are written that a file calls so."""
    match name:
        case "cdr" | "ros1" | "json" | "protobuf":
            return name
    return None


@dataclass
class Batch:
    """Successive messages of one topic; only of Imu topics are they at hand.

    count: how many there are. arrival_ns, data: of each, when it was recorded, and the message.
    """

    topic: Topic
    count: int = 0
    arrival_ns: list[int] = field(default_factory=list)
    data: list[bytes] = field(default_factory=list)
