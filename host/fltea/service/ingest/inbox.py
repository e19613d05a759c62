"""Queue messages that devices have published, with a limit for each device and for all together."""

import threading
from collections import Counter, deque
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from fltea.records.clock import host_ns
from fltea.records.visible import visible
from fltea.service.ingest.admission import Admission, Verdict
from fltea.service.ingest.floods import MESSAGE_BYTES, Allowance
from fltea.service.ingest.kept import Kept

BATCH_BYTES = 8_000_000
"""Most bytes handed out at once: all waiting messages, so that those of a device are handled together."""

LONGEST_SHOWN = 64


class Message(NamedTuple):
    """Frames that a device has published together.

    `arrived_ns`: when the broker or stream took them, monotonic. With a stream, `mark`: the message's number
    in the stream; `partition`: the device's partition.
    """

    device: str
    data: bytes
    arrived_ns: int
    partition: int | None = None
    mark: int = 0


class Served(NamedTuple):
    """Marks the beginning of a partition's messages in the queue; they follow message `start`.

    `kept`: snapshots of the partition's devices. `done`: last message that the worker before has processed.
    """

    partition: int
    kept: dict[str, Kept]
    done: int
    start: int = 0


class Resumed(NamedTuple):
    """Marks where the messages that were left out after a partition's lease lapsed come again."""

    partition: int


class Left(NamedTuple):
    """Marks that another worker may serve a partition from now on."""

    partition: int


Item = Message | Served | Resumed | Left


class Inbox:
    """A queue between the receiver of messages and their reader, with admission control before the reader.

    The receiver waits for room before it takes more from a broker, without a time limit. So only messages of
    devices that are not admitted, or that flood, are left out, and these are counted. A message counts with
    `MESSAGE_BYTES` in addition to its size, so that empty messages are limited too.

    `queue_bytes`: most bytes that may wait. `reserved`: a name that no device may have.
    `put`, `post`, `wait_for_room`, and `wake` may be called from any thread, all other methods from the
    reader's.
    """

    def __init__(self, devices: int, queue_bytes: int, reserved: str = "") -> None:
        self.admission = Admission[Message](devices, reserved)
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
        """Queue a message. `arrived_ns`: when a stream took it, on the clock of `host_ns`; None: now."""
        now_ns = host_ns()
        # A clock that differs may make the message seem to come from the future.
        arrived_ns = now_ns if arrived_ns is None else min(arrived_ns, now_ns)
        with self._changed:
            if self._ended:
                self.overflow_bytes[device] += len(data)
                return
            self._queue.append(Message(device, data, arrived_ns, partition, mark))
            self._bytes += len(data) + MESSAGE_BYTES
            self._changed.notify_all()

    def post(self, item: Served | Resumed | Left) -> None:
        """Queue a rare item behind all messages that wait."""
        with self._changed:
            self._queue.append(item)
            self._changed.notify_all()

    def wait_for_room(self, timeout_s: float) -> bool:
        """Wait until the receiver may take more; return False if it may not in time."""
        if self._bytes < self.queue_bytes:
            return True
        with self._changed:
            return self._changed.wait_for(lambda: self._bytes < self.queue_bytes, timeout_s)

    def wake(self) -> None:
        """End the waiting in `take`."""
        with self._changed:
            self._changed.notify_all()

    @property
    def has_messages(self) -> bool:
        """Whether any item waits."""
        return bool(self._queue)

    def take(self, timeout_s: float) -> tuple[list[Message], Served | Resumed | Left | None]:
        """Return the waiting messages in order, and the rare item behind them or None.

        Waits at most `timeout_s`, or until `wake`. Between two calls the reader may admit or forget devices.
        """
        messages, size = list[Message](), 0
        behind: Served | Resumed | Left | None = None
        with self._changed:
            if not self._queue:
                self._changed.wait(timeout_s)
            while self._queue and size < BATCH_BYTES and behind is None:
                item = self._queue.popleft()
                if isinstance(item, Message):
                    messages.append(item)
                    size += len(item.data) + MESSAGE_BYTES
                else:
                    behind = item
            self._bytes -= size
            self._changed.notify_all()
        now_ns = host_ns()
        return [one for message in messages for one in self._let_in(message, now_ns)], behind

    def _let_in(self, message: Message, now_ns: int) -> Iterator[Message]:
        """Yield a message, unless its device is not admitted, or publishes more than its allowance."""
        device = message.device
        size = len(message.data) + MESSAGE_BYTES
        verdict, first, missed_bytes = self.admission.judge(device, now_ns, message, size)
        if verdict not in ("in", "new"):
            self.last_turned_away["once" if verdict == "candidate" else verdict] = visible(
                device[:LONGEST_SHOWN]
            )
            return
        if missed_bytes:
            self.overflow_bytes[device] += missed_bytes - MESSAGE_BYTES
        for each in (message,) if first is None else (first, message):
            if self._allowance.takes(device, len(each.data) + MESSAGE_BYTES, each.arrived_ns):
                yield each
            else:
                self.overflow_bytes[device] += len(each.data)

    def put_back(self, messages: Sequence[Message]) -> None:
        """Put messages that were not processed back to the front of the queue."""
        with self._changed:
            self._queue.extendleft(reversed(messages))
            self._bytes += sum(len(message.data) + MESSAGE_BYTES for message in messages)

    def end(self) -> int:
        """Count what waits and what still arrives as lost; return how many bytes waited."""
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

    def forget(self, device: str) -> None:
        """Free a device's entry for other devices."""
        self.admission.forget(device)
        self.overflow_bytes.pop(device, None)
        self._allowance.forget(device)
