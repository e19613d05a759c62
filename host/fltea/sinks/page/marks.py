"""Keep past steps and motions, as marks in the figures over time."""

from collections import deque
from typing import Any

from fltea.records.records import Motion, Step
from fltea.sinks.changes import short_size

KEPT = 240
"""Most remembered steps of an axis, and motions: with one every six minutes, those of a day."""

MOST_STEPS = 40
"""Most steps that a figure shows: the largest ones."""

MOST_SPANS = 60
"""Most motions that a figure shows: motions closer than this fraction of the window are merged."""


class Marks:
    """Takes steps, which are detected some time later, and motions. `moving`: the present motion, if any."""

    def __init__(self) -> None:
        self.steps: dict[str, deque[Step]] = {}
        self.moving: Motion | None = None
        self._spans: deque[tuple[int, int]] = deque(maxlen=KEPT)

    def step(self, record: Step) -> None:
        """Take a step."""
        self.steps.setdefault(record.axis, deque(maxlen=KEPT)).append(record)

    def motion(self, record: Motion, rate_hz: float) -> None:
        """Take the begin or end of a motion; if its begin was missed, it follows from the motion's length."""
        if record.begins:
            self.end(record.host_ns)
            self.moving = record
            return
        if self.moving is None and record.samples:
            self._spans.append((record.host_ns - int(record.samples / rate_hz * 1e9), record.host_ns))
        self.end(record.host_ns)

    def end(self, host_ns: int) -> None:
        """End the present motion, if any."""
        if self.moving is not None:
            self._spans.append((self.moving.host_ns, host_ns))
        self.moving = None

    def begin(self, host_ns: int) -> None:
        """Begin an epoch, and drop later marks, which a change of the date leaves."""
        self.end(host_ns)
        self._spans = deque((span for span in self._spans if span[0] <= host_ns), maxlen=KEPT)
        for axis, steps in self.steps.items():
            self.steps[axis] = deque((one for one in steps if one.host_ns <= host_ns), maxlen=KEPT)

    def within(self, axis: str, begin_ns: int, end_ns: int) -> dict[str, Any]:
        """Return the marks of an axis between two times, in ms; a motion that still lasts ends with None."""
        steps = [one for one in self.steps.get(axis, ()) if one.host_ns >= begin_ns]
        largest = sorted(steps, key=lambda one: -abs(one.size))[:MOST_STEPS]
        return {
            "steps": sorted((one.host_ns // 1_000_000, short_size(one)) for one in largest),
            "motion": self._joined(begin_ns, (end_ns - begin_ns) // MOST_SPANS),
        }

    def _joined(self, begin_ns: int, least_ns: int) -> list[list[int | None]]:
        """Return motions that end after a time; merge those closer than `least_ns`."""
        found: list[list[int | None]] = []
        last_ns = begin_ns - least_ns
        lasts = [] if self.moving is None else [(self.moving.host_ns, None)]
        for first_ns, end_ns in [*self._spans, *lasts]:
            if end_ns is not None and end_ns < begin_ns:
                continue
            end_ms = None if end_ns is None else end_ns // 1_000_000
            if found and first_ns - last_ns < least_ns:
                found[-1][1] = end_ms
            else:
                found.append([first_ns // 1_000_000, end_ms])
            last_ns = end_ns or first_ns
        return found
