"""Snapshots of the devices that a worker serves, taken in turns, for whoever goes on with them.

What is walked again after a snapshot is published again; what was before it is not. So one is stored when the
outputs have written all that came before it, however late they are.
"""

from collections import deque
from collections.abc import Callable, Mapping
from typing import NamedTuple

from fltea.records.clock import host_ns
from fltea.records.ports import Report
from fltea.records.repeat import OnceAMinute
from fltea.service.ingest.devices import Line
from fltea.service.ingest.kept import Kept, pack
from fltea.service.ingest.receiver import Shared

FIRST_NS = 2 * 10**9
"""The first snapshot of a device is tried for so often, until the start-up window is full."""


MOST_TAKEN = 64
"""Snapshots that may wait to be stored."""


class _Taken(NamedTuple):
    """A snapshot of a line. is_written: whether all is that came before it."""

    name: str
    line: Line
    data: bytes
    is_written: Callable[[], bool]


class Snapshots:
    """Keeps a snapshot of each device in the store of the workers, a new one every `period_s`.

    written: as of `Hub`.
    """

    def __init__(
        self, shared: Shared, period_s: float, report: Report, written: Callable[[], Callable[[], bool]]
    ) -> None:
        self._shared, self._period_ns, self._report = shared, int(period_s * 1e9), report
        self._written = written
        self._taken: deque[_Taken] = deque()
        self._once_a_minute = OnceAMinute()

    def keep(self, name: str, line: Line, kept: Kept) -> None:
        """Take a snapshot, which is stored before long."""
        line.kept_ns = host_ns()
        data = pack(kept)
        if data is not None:
            self._taken.append(_Taken(name, line, data, self._written()))
        elif self._once_a_minute.is_due("too_large", host_ns()):
            text = f"{name}: its snapshot is too large for the store: a shorter window makes it smaller."
            self._report("snapshot_failed", text)

    def store(self, lines: Mapping[str, Line]) -> bool:
        """Store those that may be; whether none waits. One of a line that has ended or moved is dropped."""
        while self._taken and self._taken[0].is_written():
            name, line, data, _ = self._taken[0]
            mine = (
                line.partition is not None and lines.get(name) is line and self._shared.serves(line.partition)
            )
            if mine and line.partition is not None and not self._shared.keep(line.partition, name, data):
                break
            self._taken.popleft()
        return not self._taken

    def keep_due(self, lines: Mapping[str, Line], walked: Mapping[int, int], now_ns: int) -> None:
        """Take those whose turn it is. walked: how far partitions have come, with all of their devices."""
        for name, line in lines.items():
            if len(self._taken) >= MOST_TAKEN:
                return
            young = now_ns - line.kept_ns
            if line.partition is None or young < (self._period_ns if line.is_whole else FIRST_NS):
                continue
            state = line.walk.save()
            if state is None and young < self._period_ns:
                continue  # the start-up window fills: who takes over begins with its first message
            line.is_whole = True
            mark = max(line.mark, walked.get(line.partition, 0))
            unix_ns = host_ns() + self._shared.unix_offset_ns
            self.keep(name, line, Kept(mark, unix_ns, line.walk.hello, state))
