"""Counts the bias steps and the motions that the records of a recording report."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import msgspec

from fltea.records.records import Record

if TYPE_CHECKING:
    from fltea.recording.scan import Messages


class StepMark(Record, frozen=True, forbid_unknown_fields=False, tag="step"):
    """Fields of a `step` record that are needed to count it. Newer versions may write more fields."""

    host_ns: int


class MotionMark(Record, frozen=True, forbid_unknown_fields=False, tag="motion"):
    """Fields of a `motion` record that are needed to count it."""

    host_ns: int
    begins: bool


CLASSES = ("step", "motion")
"""Names of the classes of the records `step` and `motion`. An MCAP topic ends with such a name, and NDJSON
has it in the field `class`.
"""

_decode = msgspec.json.Decoder(StepMark | MotionMark).decode


class Changes:
    """Counts of bias steps and of motions. They are None if the recording has no channel for such records."""

    def __init__(self) -> None:
        self.steps: int | None = None
        self.motions: int | None = None

    def expect(self) -> None:
        """Set counts that are None to 0, since the recording has a channel for steps and motions."""
        self.steps, self.motions = self.steps or 0, self.motions or 0

    def count(self, record: StepMark | MotionMark) -> None:
        """Count one record. A motion has one record when it begins and one when it ends; the first counts."""
        self.expect()
        assert self.steps is not None
        assert self.motions is not None
        if isinstance(record, StepMark):
            self.steps += 1
        else:
            self.motions += record.begins

    def count_in(self, messages: "Messages", topics: Mapping[int, str]) -> None:
        """Count the step and motion records in `messages`. `topics`: topic name of each channel.

        Damaged records are not counted.
        """
        channels = [channel for channel, topic in topics.items() if topic in CLASSES]
        if not channels:
            return
        self.expect()
        for message in messages.of_channels(channels).each():
            try:
                self.count(_decode(message.data))
            except (ValueError, RecursionError):  # the record is damaged, or nested too deeply
                continue
