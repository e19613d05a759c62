"""Keep the list of a device's events, as the page shows it."""

from collections import deque
from typing import Literal, NamedTuple

from fltea.records.records import EpochReason, Motion
from fltea.sinks.changes import moved, sentence

MOST = 60
"""Largest number of events that are kept."""

EPOCH_WORDS: dict[EpochReason, str] = {
    "start": "the first since the program started",
    "restart": "the device restarted",
    "sensor_restart": "the device set up its sensor again",
    "discontinuity": "sequence and time disagreed",
    "gap": "a gap too long to bridge",
    "silence": "half an hour of silence",
    "resumed": "resumed from a snapshot",
}


class Happening(NamedTuple):
    """An entry of the list of events. `host_ns`: Unix time, as in the records."""

    host_ns: int
    kind: Literal["epoch", "gap", "step", "motion", "error", "missed"]
    text: str


class Happenings(deque[Happening]):
    """The newest events, the oldest first. Successive gaps make one entry, and so do successive motions."""

    def __init__(self) -> None:
        super().__init__(maxlen=MOST)
        self._gaps = self._missing = 0
        self._motions, self._moved, self._largest = 0, 0, 0.0

    def gap(self, host_ns: int, missing: int) -> None:
        """Add a gap, or count it in the newest entry if that is about gaps, too."""
        if self and self[-1].kind == "gap":
            self.pop()
        else:
            self._gaps = self._missing = 0
        self._gaps += 1
        self._missing += missing
        what = "a gap" if self._gaps == 1 else f"{self._gaps} gaps"
        self.append(Happening(host_ns, "gap", f"{what}: {self._missing} samples lost"))

    def motion(self, record: Motion) -> None:
        """Add the beginning or end of a motion. If the newest entry is about motions too, count it there."""
        if self and self[-1].kind == "motion":
            self.pop()
        else:
            self._motions, self._moved, self._largest = 0, 0, 0.0
        text = sentence(record)
        if not record.begins:
            self._motions += 1
            self._moved += record.samples or 0
            self._largest = max(self._largest, record.largest or 0.0)
            if self._motions > 1:
                text = f"the sensor moved {self._motions} times{moved(self._moved, self._largest)}"
        elif self._motions:
            text += f"; it moved {'once' if self._motions == 1 else f'{self._motions} times'} before"
        self.append(Happening(record.host_ns, "motion", text))
