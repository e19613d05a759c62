"""Keep past steps of the bias and motions of the sensor, which the diagrams over time mark."""

from collections import deque
from typing import Any

from fltea.records.records import Motion, Step
from fltea.sinks.changes import short_size

KEPT = 240
"""At most this many steps are kept for each axis, and at most this many motions. If there is one every six
minutes, this is enough for a day.
"""

MOST_STEPS = 40
"""Largest number of steps that a diagram shows. If there are more, it shows the largest steps."""

MOST_SPANS = 60
"""Largest number of motions that a diagram shows. Two motions are merged if the pause between them is shorter
than the diagram's time window divided by this number.
"""


class Marks:
    """Keeps past steps and motions. `moving`: the present motion, or None.

    The record of a step arrives some time after the step occurred, since a step is only recognised later.
    """

    def __init__(self) -> None:
        self.steps: dict[str, deque[Step]] = {}
        self.moving: Motion | None = None
        self._spans: deque[tuple[int, int]] = deque(maxlen=KEPT)

    def step(self, record: Step) -> None:
        """Remember a step."""
        self.steps.setdefault(record.axis, deque(maxlen=KEPT)).append(record)

    def motion(self, record: Motion, rate_hz: float) -> None:
        """Remember the beginning or end of a motion.

        If the record of the beginning was lost, compute the time of the beginning from the end and the
        duration.
        """
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
        """Begin an epoch, which ends the present motion.

        If the clock was set back, drop steps and motions with later times.
        """
        self.end(host_ns)
        self._spans = deque((span for span in self._spans if span[0] <= host_ns), maxlen=KEPT)
        for axis, steps in self.steps.items():
            self.steps[axis] = deque((one for one in steps if one.host_ns <= host_ns), maxlen=KEPT)

    def within(self, axis: str, begin_ns: int, end_ns: int) -> dict[str, Any]:
        """Return the steps of an axis and the motions that lie between two times.

        The returned times are in ms.

        A motion that still lasts has None for its end.
        """
        steps = [one for one in self.steps.get(axis, ()) if one.host_ns >= begin_ns]
        largest = sorted(steps, key=lambda one: -abs(one.size))[:MOST_STEPS]
        return {
            "steps": sorted((one.host_ns // 1_000_000, short_size(one)) for one in largest),
            "motion": self._joined(begin_ns, (end_ns - begin_ns) // MOST_SPANS),
        }

    def _joined(self, begin_ns: int, least_ns: int) -> list[list[int | None]]:
        """Return the beginning and end [ms] of each motion that ends after `begin_ns`.

        Motions closer to each other than `least_ns` are merged.
        """
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
