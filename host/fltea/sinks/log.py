"""Write errors, steps of the bias and motions of the sensor to stderr, at a limited rate."""

from collections.abc import Callable

from fltea.records.clock import host_ns
from fltea.records.ports import Item, Sink
from fltea.records.records import Error, Motion, Step
from fltea.records.visible import visible
from fltea.sinks.changes import sentence, time_of

BURST = 5
PERIOD_NS = 60 * 10**9
"""In this time, at most `BURST` messages of one kind are written for a device [ns]. Further messages are only
counted.
"""


class LogSink(Sink):
    """Writes `fltea: KIND: TEXT` for an error, and `fltea: TEXT` for a step or a motion.

    If there are several devices, the name of the device follows after `fltea:`.
    """

    name = "log"

    def __init__(self, write: Callable[[str], None], *, several: bool) -> None:
        self._write = write
        self._several = several
        self._lines: dict[tuple[str | None, str], tuple[int, int, int]] = {}

    def write(self, item: Item) -> None:
        """Write an error, a step or a motion, unless too many messages of the same kind came before."""
        if isinstance(item, Error):
            kind, text = item.kind, f"{item.kind}: {' '.join(item.message.split(chr(10)))}"
        elif isinstance(item, Step | Motion):
            kind, text = type(item).__name__.lower(), sentence(item, time_of(item))
        else:
            return
        key, now_ns = (item.device, kind), host_ns()
        since_ns, count, silenced = self._lines.get(key, (now_ns, 0, 0))
        if now_ns - since_ns >= PERIOD_NS:
            self._report_silenced(key, silenced)
            since_ns, count, silenced = now_ns, 0, 0
        if count < BURST:
            self._line(item.device, visible(text))
        self._lines[key] = (since_ns, count + 1, silenced + (count >= BURST))

    def flush(self) -> None:
        """Report how many messages were left out in each period that has ended."""
        now_ns = host_ns()
        for key, (since_ns, _, silenced) in list(self._lines.items()):
            if now_ns - since_ns >= PERIOD_NS:
                self._report_silenced(key, silenced)
                del self._lines[key]

    def close(self) -> None:
        """For each kind of message, report how many were left out since the last report."""
        for key, (_, _, silenced) in self._lines.items():
            self._report_silenced(key, silenced)

    def _report_silenced(self, key: tuple[str | None, str], silenced: int) -> None:
        if silenced:
            self._line(key[0], f"{key[1]}: further messages of this kind within a minute: {silenced}.")

    def _line(self, device: str | None, text: str) -> None:
        self._write(f"fltea: {device}: {text}\n" if self._several and device else f"fltea: {text}\n")
