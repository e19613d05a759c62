"""How often the bias stepped and the sensor moved, as the records of a recording say."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import msgspec

from fltea.records.records import Record

if TYPE_CHECKING:
    from fltea.recording.scan import Messages


class StepMark(Record, frozen=True, forbid_unknown_fields=False, tag="step"):
    """What is counted of a `step` record; its fields may be another version's."""

    host_ns: int


class MotionMark(Record, frozen=True, forbid_unknown_fields=False, tag="motion"):
    """What is counted of a `motion` record."""

    host_ns: int
    begins: bool


CLASSES = ("step", "motion")
"""Names of both classes, in NDJSON and as the last part of a topic."""

_decode = msgspec.json.Decoder(StepMark | MotionMark).decode


class Changes:
    """Counts steps, and motions by their begins; None where a recording has no room for such records."""

    def __init__(self) -> None:
        self.steps: int | None = None
        self.motions: int | None = None

    def expect(self) -> None:
        """Take note that such records would be here."""
        self.steps, self.motions = self.steps or 0, self.motions or 0

    def count(self, record: StepMark | MotionMark) -> None:
        """Count one record."""
        self.expect()
        assert self.steps is not None
        assert self.motions is not None
        if isinstance(record, StepMark):
            self.steps += 1
        else:
            self.motions += record.begins

    def count_in(self, messages: "Messages", topics: Mapping[int, str]) -> None:
        """Count the records among messages; those that are damaged are left out. topics: by channel."""
        channels = [channel for channel, topic in topics.items() if topic in CLASSES]
        if not channels:
            return
        self.expect()
        for message in messages.of_channels(channels).each():
            try:
                self.count(_decode(message.data))
            except (ValueError, RecursionError):  # msgspec's errors, and brackets in brackets
                continue
