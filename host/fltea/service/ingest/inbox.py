"""What devices have published and nobody has read yet, bounded for each of them and for all together."""

import threading
from collections import Counter, deque
from typing import NamedTuple

from fltea.records.clock import host_ns
from fltea.records.visible import visible
from fltea.service.ingest.admission import Admission, Verdict
from fltea.service.ingest.floods import MESSAGE_BYTES, Allowance
from fltea.service.ingest.kept import Kept

DEVICE_BYTES = 1 << 20
"""Of one device, as of a serial port (`wire.transport`): minutes of samples, or a second of a flood."""

BATCH = 256
"""Messages that are handed out together."""

LONGEST_SHOWN = 64


class Message(NamedTuple):
    """Frames that a device has published together. arrived_ns: when broker or stream had them, monotonic.

    Of a stream: mark: the message's number in it; partition: of its device.
    """

    device: str
    data: bytes
    arrived_ns: int
    partition: int | None = None
    mark: int = 0


class Served(NamedTuple):
    """From here on messages of a partition come, behind `start`.

    kept: its devices, as another left them after `done`.
    """

    partition: int
    kept: dict[str, Kept]
    done: int
    start: int = 0


class Resumed(NamedTuple):
    """From here on the messages of a partition come that were left out while its lease had lapsed."""

    partition: int


class Left(NamedTuple):
    """Another may serve a partition from now on."""

    partition: int


Item = Message | Served | Resumed | Left


class Inbox:
    """A queue between who receives messages and who reads them.

    `put` waits for nobody: what has no room is counted, by device. A message counts with `MESSAGE_BYTES` more
    than it has, so that empty ones have a bound too. reserved: a name that none may have.
    """

    def __init__(self, devices: int, queue_bytes: int, reserved: str = "") -> None:
        self.admission = Admission(devices, reserved)
        self.overflow_bytes: Counter[str] = Counter()
        self.last_turned_away: dict[Verdict, str] = {}
        self._queue_bytes = queue_bytes
        self._allowance = Allowance()
        self._bytes = 0
        self._waiting: Counter[str] = Counter()
        self._queue: deque[Item] = deque()
        self._changed = threading.Condition()

    def put(
        self,
        device: str,
        data: bytes,
        partition: int | None = None,
        mark: int = 0,
        arrived_ns: int | None = None,
    ) -> None:
        """Queue a message, unless its device is not believed or has no room left.

        arrived_ns: when a stream took it, on the clock of `host_ns`; None: now. A stream's messages wait
        there, so all have room here, but for those of a device that publishes more than any has to.
        """
        size = len(data) + MESSAGE_BYTES
        with self._changed:
            now_ns = host_ns()
            verdict = self.admission.judge(device, now_ns)
            if verdict not in ("in", "new"):
                self.last_turned_away["once" if verdict == "candidate" else verdict] = visible(
                    device[:LONGEST_SHOWN]
                )
                return
            if mark:
                taken_ns = now_ns if arrived_ns is None else arrived_ns
                has_room = self._allowance.takes(device, size, taken_ns)
                now_ns = min(taken_ns, now_ns)  # by a clock that differs it may seem to come from the future
            else:
                room = min(DEVICE_BYTES - self._waiting[device], self._queue_bytes - self._bytes)
                has_room = size <= room
            if not has_room:
                self.overflow_bytes[device] += len(data)
                return
            self._waiting[device] += size
            self._bytes += size
            self._queue.append(Message(device, data, now_ns, partition, mark))
            self._changed.notify()

    def post(self, item: Served | Resumed | Left) -> None:
        """Queue what is rare, behind all messages that are there."""
        with self._changed:
            self._queue.append(item)
            if isinstance(item, Served):
                for device in item.kept:
                    self.admission.admit(device)
            self._changed.notify()

    def has_room(self, most_bytes: int) -> bool:
        """Whether less than so much waits."""
        return self._bytes < most_bytes

    def take(self, timeout_s: float) -> list[Item]:
        """Messages in their order, after at most so long; none if none came or somebody woke us up."""
        with self._changed:
            if not self._queue:
                self._changed.wait(timeout_s)
            found = [self._queue.popleft() for _ in range(min(BATCH, len(self._queue)))]
            for message in found:
                if not isinstance(message, Message):
                    continue
                size = len(message.data) + MESSAGE_BYTES
                self._waiting[message.device] -= size
                self._bytes -= size
        return found

    def overflow(self) -> dict[str, int]:
        """Bytes that had no room, by device."""
        with self._changed:
            return dict(self.overflow_bytes)

    def expire(self, now_ns: int) -> None:
        """Give up names that were heard once and not again in time."""
        with self._changed:
            self.admission.expire(now_ns)

    def wake(self) -> None:
        """End the waiting of `take`."""
        with self._changed:
            self._changed.notify()

    def forget(self, device: str) -> None:
        """Give the device's place to others."""
        with self._changed:
            self.admission.forget(device)
            if not self._waiting[device]:
                del self._waiting[device]
            self.overflow_bytes.pop(device, None)
            self._allowance.forget(device)
