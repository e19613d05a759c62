"""What every reader of bags gives: messages as they are stored, a batch at a time."""

from dataclasses import dataclass, field
from typing import NamedTuple

from fltea.recording.bag_imu import IMU_TYPES, Encoding

LONGEST_MESSAGE = 1 << 16
"""Bytes; an Imu message has 350."""


class Topic(NamedTuple):
    """Whose messages they are. encoding: how they are written; None: in none of those that are known."""

    name: str
    type: str
    encoding: Encoding | None

    @property
    def is_imu(self) -> bool:
        """Whether its messages can be read here."""
        return self.type in IMU_TYPES and self.encoding is not None


def encoding_of(name: str) -> Encoding | None:
    """How messages are written that a file calls so."""
    match name:
        case "cdr" | "ros1":
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
