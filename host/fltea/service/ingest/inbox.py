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
"""One call of `Inbox.take` stops taking messages as soon as they have this size in all [bytes].

It takes many waiting messages at once, so that all messages of one device can be processed together.
"""

LONGEST_SHOWN = 64


class Message(NamedTuple):
    """A message from a device: one or more frames of the wire protocol that were published together.

    `arrived_ns`: monotonic time at which the broker received the message. If the broker keeps messages in a
    stream, `mark` is the number of the message in this stream, and `partition` is the number of the device's
    partition.
    """

    device: str
    data: bytes
    arrived_ns: int
    partition: int | None = None
    mark: int = 0


class Served(NamedTuple):
    """Item of the queue that says that this worker serves a partition from now on.

    The messages of the partition follow after this item in the queue. They are those with numbers above
    `start`.

    `kept`: snapshots of the partition's devices. `done`: number of the last message that the previous worker
    has processed.
    """

    partition: int
    kept: dict[str, Kept]
    done: int
    start: int = 0


class Resumed(NamedTuple):
    """Item of the queue that says that the messages of a partition that were left out now arrive again.

    They were left out because this worker had not renewed its lease of the partition in time. No other worker
    has taken the lease since.
    """

    partition: int


class Left(NamedTuple):
    """Item of the queue that says that this worker no longer serves a partition. Another one may serve it."""

    partition: int


Item = Message | Served | Resumed | Left


class Inbox:
    """A queue between the receiver of messages and their reader.

    The reader gets only messages of devices that were admitted (see `Admission`).

    Before it takes more messages from a broker, the receiver waits until the queue has room, without a time
    limit. So the queue drops no messages for lack of room. Messages are left out, and counted, only if their
    device is not admitted or publishes too much. Each message counts as `MESSAGE_BYTES` more than its size,
    so that empty messages are limited too.

    `queue_bytes`: number of waiting bytes above which the receiver waits. `reserved`: a name that no device
    may have. `put`, `post`, `wait_for_room`, and `wake` may be called from any thread, all other methods from
    the reader's thread only.
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
        """Queue a message.

        `arrived_ns`: time, on the clock of `host_ns`, at which a stream received the message; None if it
        arrives now.
        """
        now_ns = host_ns()
        # If the broker's clock is ahead of this machine's, a message may seem to come from the future.
        arrived_ns = now_ns if arrived_ns is None else min(arrived_ns, now_ns)
        with self._changed:
            if self._ended:
                self.overflow_bytes[device] += len(data)
                return
            self._queue.append(Message(device, data, arrived_ns, partition, mark))
            self._bytes += len(data) + MESSAGE_BYTES
            self._changed.notify_all()

    def post(self, item: Served | Resumed | Left) -> None:
        """Queue an item that is no message. The reader gets it after all messages that wait now."""
        with self._changed:
            self._queue.append(item)
            self._changed.notify_all()

    def wait_for_room(self, timeout_s: float) -> bool:
        """Wait until the queue has room for the receiver's next messages.

        Return False if the time runs out.
        """
        if self._bytes < self.queue_bytes:
            return True
        with self._changed:
            return self._changed.wait_for(lambda: self._bytes < self.queue_bytes, timeout_s)

    def wake(self) -> None:
        """End the waiting in `take`, from any thread."""
        with self._changed:
            self._changed.notify_all()

    @property
    def has_messages(self) -> bool:
        """Whether any item waits."""
        return bool(self._queue)

    def take(self, timeout_s: float) -> tuple[list[Message], Served | Resumed | Left | None]:
        """Return the waiting messages in order, and the item that follows them in the queue.

        This item is the first that is no message; None if messages alone are taken.

        If nothing waits, wait until an item comes, `wake` is called, or `timeout_s` has passed. Devices that
        the reader admits or forgets between two calls of `take` count as such from the next call on.
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
        """Put messages that were not processed back into the queue, in front of all waiting messages."""
        with self._changed:
            self._queue.extendleft(reversed(messages))
            self._bytes += sum(len(message.data) + MESSAGE_BYTES for message in messages)

    def end(self) -> int:
        """Count all waiting messages, and all later ones, as lost. Return how many bytes waited."""
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
        """Forget a device, so that another one can be admitted in its stead."""
        self.admission.forget(device)
        self.overflow_bytes.pop(device, None)
        self._allowance.forget(device)
