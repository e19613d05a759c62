"""Take snapshots of a worker's devices in turn, for the worker that continues with them.

Messages after a snapshot are processed and published again; those before it are not. So a snapshot is stored
only once the outputs have written all that came before it, however late they are.
"""

from collections import deque
from collections.abc import Callable, Mapping
from typing import NamedTuple

from fltea.records.clock import host_ns
from fltea.records.ports import Report
from fltea.records.repeat import OnceAMinute
from fltea.service.ingest.devices import OpenDevice
from fltea.service.ingest.kept import Kept, pack
from fltea.service.ingest.receiver import Shared

FIRST_NS = 2 * 10**9
"""Time between two attempts at a device's first snapshot, until its start-up window is full [ns]."""


MOST_TAKEN = 64
"""Most snapshots that may wait to be stored."""


class _Taken(NamedTuple):
    """A snapshot of a device. `is_written`: returns whether all that came before it is written."""

    name: str
    device: OpenDevice
    data: bytes
    is_written: Callable[[], bool]


class Snapshots:
    """Keeps a snapshot of each device in the store of the workers, renewed every `period_s`.

    `written`: as `Hub.written`.
    """

    def __init__(
        self, shared: Shared, period_s: float, report: Report, written: Callable[[], Callable[[], bool]]
    ) -> None:
        self._shared, self._period_ns, self._report = shared, int(period_s * 1e9), report
        self._written = written
        self._taken: deque[_Taken] = deque()
        self._once_a_minute = OnceAMinute()

    def keep(self, name: str, device: OpenDevice, kept: Kept) -> None:
        """Take a snapshot, which is stored soon."""
        device.kept_ns = host_ns()
        data = pack(kept)
        if data is not None:
            self._taken.append(_Taken(name, device, data, self._written()))
        elif self._once_a_minute.is_due("too_large", host_ns()):
            text = f"{name}: its snapshot is too large for the store: a shorter window makes it smaller."
            self._report("snapshot_failed", text)

    def store(self, opened: Mapping[str, OpenDevice]) -> bool:
        """Store the snapshots that may be stored; return whether none waits.

        A snapshot of a device stream that has ended or moved is dropped.
        """
        while self._taken and self._taken[0].is_written():
            name, device, data, _ = self._taken[0]
            mine = (
                device.partition is not None
                and opened.get(name) is device
                and self._shared.serves(device.partition)
            )
            if mine and device.partition is not None and not self._shared.keep(device.partition, name, data):
                break
            self._taken.popleft()
        return not self._taken

    def keep_due(self, opened: Mapping[str, OpenDevice], walked: Mapping[int, int], now_ns: int) -> None:
        """Take the snapshots that are due. `walked`: for each partition, the last message processed."""
        for name, device in opened.items():
            if len(self._taken) >= MOST_TAKEN:
                return
            young = now_ns - device.kept_ns
            if device.partition is None or young < (self._period_ns if device.is_whole else FIRST_NS):
                continue
            state = device.stream.save()
            if state is None and young < self._period_ns:
                continue  # the start-up window fills: another worker would begin with the first message of it
            device.is_whole = True
            mark = max(device.mark, walked.get(device.partition, 0))
            unix_ns = host_ns() + self._shared.unix_offset_ns
            self.keep(name, device, Kept(mark, unix_ns, device.stream.hello, state))
