"""Counts the bias steps and the motions that the records of a recording report."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import msgspec

from fltea.records.records import Record

if TYPE_CHECKING:
    from fltea.recording.scan import Messages


class StepMark(Record, frozen=True, forbid_unknown_fields=False, tag="step"):
    """The fields of a `step` record that are needed to count it; a newer version may write others."""

    host_ns: int


class MotionMark(Record, frozen=True, forbid_unknown_fields=False, tag="motion"):
    """The fields of a `motion` record that are needed to count it."""

    host_ns: int
    begins: bool


CLASSES = ("step", "motion")
"""Names of both record types, in NDJSON and as the last part of a topic."""

_decode = msgspec.json.Decoder(StepMark | MotionMark).decode


class Changes:
    """Counts of steps and of beginnings of motions; None if a recording has no channel for such records."""

    def __init__(self) -> None:
        self.steps: int | None = None
        self.motions: int | None = None

    def expect(self) -> None:
        """Note that the recording has a channel for such records, so that the counts begin at 0."""
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
        """Count the records among `messages`, except damaged ones. `topics`: topic name of each channel."""
        channels = [channel for channel, topic in topics.items() if topic in CLASSES]
        if not channels:
            return
        self.expect()
        for message in messages.of_channels(channels).each():
            try:
                self.count(_decode(message.data))
            except (ValueError, RecursionError):  # damaged, or nested too deeply
                continue
