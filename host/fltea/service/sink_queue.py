"""Put a bounded queue and a writing thread before a sink: a slow or broken one loses only its own records."""

import threading
import time
from collections import deque
from collections.abc import Callable, Iterable

from fltea.records.block import Block
from fltea.records.clock import host_ns
from fltea.records.events import Reads
from fltea.records.ports import Departed, Item, Latency, Printed, Sink, SinkClosed
from fltea.records.stats import OutputStats
from fltea.service.wake_up import WakeUp

IDLE_S = 0.5

MOST_WAITING = 1_000_000
"""Most records that may wait for one thread: with many devices each queue has less room than alone."""


def weight(item: Item | Departed) -> int:
    """Return how many records an item counts as."""
    if isinstance(item, Departed):
        return 0
    if isinstance(item, Reads):
        return len(item.end)
    if isinstance(item, Printed):
        return item.records
    return item.weight if isinstance(item, Block) else 1


class SinkThread:
    """Writes to sink queues, one after the other, as long as it has any.

    `wake_up`: rung when a queue has an item. `hurry`: set when a queue closes.
    """

    def __init__(self, name: str) -> None:
        self.changed = threading.Condition()
        self.wake_up = WakeUp()
        self.hurry = threading.Event()
        self._name = name
        self._sink_queues: list[SinkQueue] = []

    def room(self, capacity: int) -> int:
        """Return the most records that may wait in one queue, which would have room for `capacity` alone."""
        return min(capacity, MOST_WAITING // max(1, len(self._sink_queues)))

    def add(self, sink_queue: "SinkQueue") -> None:
        """Begin to write to a sink queue."""
        with self.changed:
            self._sink_queues.append(sink_queue)
            first = len(self._sink_queues) == 1
        if first:
            threading.Thread(target=self._run, name=self._name, daemon=True).start()

    def _run(self) -> None:
        going, rested_s = True, 0.0
        while going:
            self.wake_up.wait(IDLE_S)
            # Rest after each writing, since a wake-up for each of many items that come together costs more.
            self.hurry.wait(max(0.0, rested_s - time.monotonic()))
            with self.changed:
                self.wake_up.clear()
                self.hurry.clear()
                sink_queues = list(self._sink_queues)
            ended = [sink_queue for sink_queue in sink_queues if not sink_queue.write()]
            rested_s = time.monotonic() + max(sink_queue.sink.rest_s for sink_queue in sink_queues)
            with self.changed:
                self._sink_queues = [
                    sink_queue for sink_queue in self._sink_queues if sink_queue not in ended
                ]
                going = bool(self._sink_queues)
            for sink_queue in ended:
                sink_queue.done.set()


class SinkQueue:
    """Feeds one sink from a queue.

    `on_end`: called once, from the writing thread, when the sink can take no more: with None if its reader
    left, else with the exception. `thread`: a thread shared by several queues; by default the queue has its
    own.
    """

    def __init__(
        self,
        sink: Sink,
        on_end: Callable[["SinkQueue", Exception | None], None],
        thread: SinkThread | None = None,
    ) -> None:
        self.sink = sink
        self.latency = Latency()
        self.closing = False
        self.done = threading.Event()
        self._on_end = on_end
        self._queue: deque[tuple[Item | Departed, int | None]] = deque()
        self._queued = self._waiting = 0  # records that were ever queued, and records that wait now
        self.thread = thread or SinkThread(f"sink {sink.name}")
        self._changed = self.thread.changed
        self._ended = self._released = False
        self._written = self._dropped = self._overflow = 0
        self._in_hand = 0
        self._idle_s = 0.0
        self._lost_before: int | None = None  # the sink's own count before the batch being written

    @property
    def name(self) -> str:
        """Key of the sink's counts in `stats.outputs`."""
        return self.sink.name

    def start(self) -> None:
        """Begin to write."""
        self.thread.add(self)

    def put(
        self,
        items: Iterable[Item | Departed],
        arrived_ns: int | None = None,
        *,
        wait: bool = False,
    ) -> None:
        """Queue items; items beyond the sink's capacity are dropped and counted.

        `wait`: wait for room if the sink is lossless.
        `arrived_ns`: monotonic arrival time of the data, for the latency; None if it has no such time.
        """
        with self._changed:
            room = self.thread.room(self.sink.capacity)
            for item in items:
                if wait and self.sink.lossless:
                    while self._waiting >= room and not (self._ended or self._released):
                        self.thread.wake_up.ring()
                        self._changed.wait(IDLE_S)
                count = weight(item)
                if self._ended or self._waiting >= room:
                    self._dropped += count
                    self._overflow += count
                else:
                    self._queue.append((item, arrived_ns))
                    self._queued += count
                    self._waiting += count
        self.thread.wake_up.ring()

    def wait_for_room(self, timeout_s: float) -> bool:
        """Wait until the queue is less than half full, or has ended; return False if it is not in time."""
        with self._changed:
            return self._changed.wait_for(
                lambda: self._waiting < self.sink.capacity // 2 or self._ended or self.closing, timeout_s
            )

    def progress(self) -> tuple[int, int]:
        """Return how many records were queued so far, and how many of these no longer wait."""
        with self._changed:
            return self._queued, self._queued - self._waiting - self._in_hand

    def stats(self) -> OutputStats:
        """Return the counts of written, lost and waiting records; records being written still wait."""
        with self._changed:
            lost = self.sink.lost if self._lost_before is None else self._lost_before
            return OutputStats(self._written - lost, self._dropped + lost, self._waiting + self._in_hand)

    def close(self) -> None:
        """Take no more items; queued ones are still written (see `join`)."""
        with self._changed:
            self.closing = self._released = True
            self.thread.hurry.set()
            self._changed.notify_all()
        self.thread.wake_up.ring()

    def release(self) -> None:
        """Make no caller wait for room any more."""
        with self._changed:
            self._released = True
            self._changed.notify_all()

    def join(self, timeout_s: float) -> bool:
        """Wait until the sink has written everything and is closed; return False if it has not in time."""
        return self.done.wait(timeout_s)

    def write(self) -> bool:
        """Write what is queued; return False once the queue is closed and empty, or the sink has ended."""
        if not (self._queue or self.closing or time.monotonic() >= self._idle_s):
            return True
        try:
            if self._write_batch():
                return True
            self.sink.close()
        except SinkClosed:
            self._end(None)
        except Exception as error:  # any exception of a library ends only this output
            self._end(error)
        return False

    def _write_batch(self) -> bool:
        with self._changed:
            batch = list(self._queue)
            self._queue.clear()
            count, self._waiting = self._waiting, 0
            overflow, self._overflow = self._overflow, 0
            closing = self.closing
            self._in_hand, self._lost_before = count, self.sink.lost
            self._changed.notify_all()
        for item, _ in batch:
            if isinstance(item, Departed):
                self.sink.depart(item)
            else:
                self.sink.write(item)
        if overflow:  # the queue was full then, so the dropped items follow all the queued ones
            self.sink.on_overflow(overflow)
        self.sink.flush()
        with self._changed:
            self._written += count
            self._in_hand, self._lost_before = 0, None
        self._idle_s = time.monotonic() + IDLE_S
        now_ns = host_ns()
        for item, arrived_ns in batch:
            if isinstance(item, Printed) and item.parts:
                for part_ns, records in item.parts:
                    self.latency.add((now_ns - part_ns) * 1e-6, records)
            elif arrived_ns is not None:
                self.latency.add((now_ns - arrived_ns) * 1e-6, weight(item))
        return bool(batch) or not closing

    def _end(self, error: Exception | None) -> None:
        with self._changed:
            self._ended = True
            self._dropped += self._waiting
            self._waiting = 0
            self._queue.clear()
            if self._lost_before is not None:  # it is unknown how much of the last batch was written
                self._dropped += max(0, self._in_hand - (self.sink.lost - self._lost_before))
                self._written += min(self._in_hand, self.sink.lost - self._lost_before)
                self._in_hand, self._lost_before = 0, None
            self._changed.notify_all()
        self._on_end(self, error)
