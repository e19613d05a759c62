"""What devices have published and nobody has read yet, bounded for each of them and for all together."""

import threading
from collections import Counter, deque
from collections.abc import Sequence
from typing import NamedTuple

from fltea.records.clock import host_ns
from fltea.records.visible import visible
from fltea.service.ingest.admission import Admission, Verdict
from fltea.service.ingest.floods import MESSAGE_BYTES, Allowance
from fltea.service.ingest.kept import Kept

BATCH_BYTES = 8_000_000
"""Messages that are handed out together: all that wait, so that those of a device are walked together."""

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

    Who receives waits for room before it takes more from a broker, however long that is; so nothing but what
    a device floods is left out, and counted. A message counts with `MESSAGE_BYTES` more than it has, so that
    empty ones have a bound too. queue_bytes: as much may wait. reserved: a name that none may have.
    """

    def __init__(self, devices: int, queue_bytes: int, reserved: str = "") -> None:
        self.admission = Admission[tuple[Message, int]](devices, reserved)
        self.overflow_bytes: Counter[str] = Counter()
        self.last_turned_away: dict[Verdict, str] = {}
        self.queue_bytes = queue_bytes
        self._allowance = Allowance()
        self._bytes = 0
        self._ended = False
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
        """Queue a message, unless its device is not believed, or publishes more than any has to.

        arrived_ns: when a stream took it, on the clock of `host_ns`; None: now.
        """
        with self._changed:
            now_ns = host_ns()
            # By a clock that differs it may seem to come from the future.
            taken_ns = now_ns if arrived_ns is None else arrived_ns
            message = Message(device, data, min(taken_ns, now_ns), partition, mark)
            size = len(data) + MESSAGE_BYTES
            verdict, first, missed_bytes = self.admission.judge(device, now_ns, (message, taken_ns), size)
            if verdict not in ("in", "new"):
                self.last_turned_away["once" if verdict == "candidate" else verdict] = visible(
                    device[:LONGEST_SHOWN]
                )
                return
            if missed_bytes:
                self.overflow_bytes[device] += missed_bytes - MESSAGE_BYTES
            if first is not None:
                self._put(*first)
            self._put(message, taken_ns)
            self._changed.notify_all()

    def _put(self, message: Message, taken_ns: int) -> None:
        size = len(message.data) + MESSAGE_BYTES
        if self._ended or not self._allowance.takes(message.device, size, taken_ns):
            self.overflow_bytes[message.device] += len(message.data)
            return
        self._bytes += size
        self._queue.append(message)

    def post(self, item: Served | Resumed | Left) -> None:
        """Queue what is rare, behind all messages that are there."""
        with self._changed:
            self._queue.append(item)
            if isinstance(item, Served):
                for device in item.kept:
                    self.admission.admit(device)
            self._changed.notify_all()

    @property
    def has_messages(self) -> bool:
        """Whether anything waits."""
        return bool(self._queue)

    def wait_for_room(self, timeout_s: float) -> bool:
        """Wait until who receives may take more; False if it may not in time."""
        if self._bytes < self.queue_bytes:
            return True
        with self._changed:
            return self._changed.wait_for(lambda: self._bytes < self.queue_bytes, timeout_s)

    def take(self, timeout_s: float) -> list[Item]:
        """Messages in their order, after at most so long; none if none came or somebody woke us up."""
        found: list[Item] = []
        size = 0
        with self._changed:
            if not self._queue:
                self._changed.wait(timeout_s)
            while self._queue and size < BATCH_BYTES:
                item = self._queue.popleft()
                size += len(item.data) + MESSAGE_BYTES if isinstance(item, Message) else 0
                found.append(item)
            self._bytes -= size
            self._changed.notify_all()
        return found

    def put_back(self, messages: Sequence[Message]) -> None:
        """Take back what was not walked."""
        with self._changed:
            self._queue.extendleft(reversed(messages))
            self._bytes += sum(len(message.data) + MESSAGE_BYTES for message in messages)

    def end(self) -> int:
        """Count what waits, and what still comes, as lost; return how many bytes waited."""
        with self._changed:
            self._ended = True
            left = Counter[str]()
            for item in self._queue:
                if isinstance(item, Message):
                    left[item.device] += len(item.data)
            self._queue.clear()
            self._bytes = 0
            self.overflow_bytes.update(left)
        return left.total()

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
            self._changed.notify_all()

    def forget(self, device: str) -> None:
        """Give the device's place to others."""
        with self._changed:
            self.admission.forget(device)
            self.overflow_bytes.pop(device, None)
            self._allowance.forget(device)
