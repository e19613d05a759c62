"""Take snapshots of a worker's devices, so that another worker can continue with these devices.

A worker that takes over begins at the snapshot of a device. It processes the device's messages after the
snapshot again, and publishes their records again. It does not process the messages before the snapshot. So a
snapshot is stored only after the outputs have written all records of the messages before it.
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
"""Time between two attempts to take a device's first snapshot, while its start-up window fills [ns]."""


MOST_TAKEN = 64
"""Largest number of snapshots that may wait to be stored."""


class _Taken(NamedTuple):
    """A snapshot of a device that waits to be stored.

    `is_written`: function that returns whether the outputs have written all records that were made before the
    snapshot was taken.
    """

    name: str
    device: OpenDevice
    data: bytes
    is_written: Callable[[], bool]


class Snapshots:
    """Stores a snapshot of each device, every `period_s`, where all workers can read it.

    `written`: the method `Hub.written`. It returns a function that says whether the outputs have written all
    records that were queued at the call.
    """

    def __init__(
        self, shared: Shared, period_s: float, report: Report, written: Callable[[], Callable[[], bool]]
    ) -> None:
        self._shared, self._period_ns, self._report = shared, int(period_s * 1e9), report
        self._written = written
        self._taken: deque[_Taken] = deque()
        self._once_a_minute = OnceAMinute()

    def keep(self, name: str, device: OpenDevice, kept: Kept) -> None:
        """Queue a snapshot. It is stored as soon as the outputs have written all earlier records."""
        device.kept_ns = host_ns()
        data = pack(kept)
        if data is not None:
            self._taken.append(_Taken(name, device, data, self._written()))
        elif self._once_a_minute.is_due("too_large", host_ns()):
            text = f"{name}: its snapshot is too large for the store: a shorter window makes it smaller."
            self._report("snapshot_failed", text)

    def store(self, opened: Mapping[str, OpenDevice]) -> bool:
        """Store the snapshots that may be stored now. Return True if no snapshot waits any longer.

        A snapshot is dropped if the stream of its device has ended, or another worker serves the device now.
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
        """Take the snapshots of those devices for which one is due.

        `walked`: for each partition, the number of the last processed message.
        """
        for name, device in opened.items():
            if len(self._taken) >= MOST_TAKEN:
                return
            young = now_ns - device.kept_ns
            if device.partition is None or young < (self._period_ns if device.is_whole else FIRST_NS):
                continue
            state = device.stream.save()
            if state is None and young < self._period_ns:
                # There is no state to save while the start-up window fills. A snapshot without a state is
                # only stored after the whole period between two snapshots.
                continue
            device.is_whole = True
            mark = max(device.mark, walked.get(device.partition, 0))
            unix_ns = host_ns() + self._shared.unix_offset_ns
            self.keep(name, device, Kept(mark, unix_ns, device.stream.hello, state))
