"""Snapshots of the devices that a worker serves, taken in turns, for whoever goes on with them."""

from collections.abc import Mapping

from fltea.records.clock import host_ns
from fltea.records.ports import Report
from fltea.records.repeat import OnceAMinute
from fltea.service.ingest.devices import Line
from fltea.service.ingest.kept import Kept, pack
from fltea.service.ingest.receiver import Shared

FIRST_NS = 2 * 10**9
"""The first snapshot of a device is tried for so often, until the start-up window is full."""


class Snapshots:
    """Keeps a snapshot of each device in the store of the workers, a new one every `period_s`."""

    def __init__(self, shared: Shared, period_s: float, report: Report) -> None:
        self._shared, self._period_ns, self._report = shared, int(period_s * 1e9), report
        self._once_a_minute = OnceAMinute()

    def keep(self, name: str, line: Line, kept: Kept) -> bool:
        """Store a snapshot; False if there is no room for any now."""
        assert line.partition is not None
        data = pack(kept)
        if data is None:
            if self._once_a_minute.is_due("too_large", host_ns()):
                text = f"{name}: its snapshot is too large for the store: a shorter window makes it smaller."
                self._report("snapshot_failed", text)
            return True
        stored = self._shared.keep(line.partition, name, data)
        if stored:
            line.kept_ns = host_ns()
        return stored

    def keep_due(self, lines: Mapping[str, Line], walked: Mapping[int, int], now_ns: int) -> None:
        """Store those whose turn it is. walked: how far partitions have come, with all of their devices."""
        for name, line in lines.items():
            young = now_ns - line.kept_ns
            if line.partition is None or young < (self._period_ns if line.is_whole else FIRST_NS):
                continue
            state = line.walk.save()
            if state is None and young < self._period_ns:
                continue  # the start-up window fills: who takes over begins with its first message
            line.is_whole = True
            mark = max(line.mark, walked.get(line.partition, 0))
            unix_ns = host_ns() + self._shared.unix_offset_ns
            if not self.keep(name, line, Kept(mark, unix_ns, line.walk.hello, state)):
                return
