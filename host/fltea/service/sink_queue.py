"""Put a bounded queue and a thread before an output (sink).

Therefore a slow or broken output loses only its own records, and does not disturb the others.
"""

import threading
import time
from collections import deque
from collections.abc import Callable, Iterable

from fltea.process.wake_up import WakeUp
from fltea.records.block import Block
from fltea.records.clock import host_ns
from fltea.records.events import Reads
from fltea.records.ports import Departed, Item, Latency, Printed, Sink, SinkClosed
from fltea.records.stats import OutputStats

IDLE_S = 0.5

MOST_WAITING = 1_000_000
"""At most this number of records may wait in all queues of one thread together. The more devices there are,
the more queues share this number, and the fewer records fit into each queue.
"""


def weight(item: Item | Departed) -> int:
    """Return the number of records in an item of a queue."""
    if isinstance(item, Departed):
        return 0
    if isinstance(item, Reads):
        return len(item.end)
    if isinstance(item, Printed):
        return item.records
    return item.weight if isinstance(item, Block) else 1


class SinkThread:
    """Writes the items of several queues to their outputs, one queue after the other, until all are closed.

    `wake_up`: is rung when a queue receives an item. `hurry`: is set when a queue closes, so that the thread
    makes no more pauses.
    """

    def __init__(self, name: str) -> None:
        self.changed = threading.Condition()
        self.wake_up = WakeUp()
        self.hurry = threading.Event()
        self._name = name
        self._sink_queues: list[SinkQueue] = []

    def room(self, capacity: int) -> int:
        """Return the largest number of records that may wait in a queue.

        `capacity`: number of records that may wait if the thread serves no other queue.
        """
        return min(capacity, MOST_WAITING // max(1, len(self._sink_queues)))

    def add(self, sink_queue: "SinkQueue") -> None:
        """Add a sink queue, and start the thread if this is the first queue."""
        with self.changed:
            self._sink_queues.append(sink_queue)
            first = len(self._sink_queues) == 1
        if first:
            threading.Thread(target=self._run, name=self._name, daemon=True).start()

    def _run(self) -> None:
        going, rested_s = True, 0.0
        while going:
            self.wake_up.wait(IDLE_S)
            # Pause after each writing, so that many items that arrive together are written after one wake-up.
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


class QueueCounts:
    """Numbers of records that were passed to one output.

    `queued`: all that were ever queued. `waiting`: those that still wait in the queue. `in_hand`: those that
    are being written. `dropped`: those for which the queue had no room, or which the output can no longer
    take. `overflow`: those that were dropped since the last batch was taken from the queue.
    """

    def __init__(self, sink: Sink) -> None:
        self._sink = sink
        self.queued = self.waiting = self.in_hand = self.dropped = self.overflow = 0
        self._written = 0
        # number of records that the output had already lost when it began to write the present batch; None
        # between two batches
        self._lost_before: int | None = None

    def begin_batch(self) -> int:
        """Note that all waiting records are being written.

        Return the number of records that were dropped since the previous batch was taken from the queue.
        """
        self.in_hand, self.waiting = self.waiting, 0
        overflow, self.overflow = self.overflow, 0
        self._lost_before = self._sink.lost
        return overflow

    def end_batch(self) -> None:
        """Note that the batch was written."""
        self._written += self.in_hand
        self.in_hand, self._lost_before = 0, None

    def end(self) -> None:
        """Count the waiting records as dropped, since the output takes no more records."""
        self.dropped += self.waiting
        self.waiting = 0
        if self._lost_before is not None:  # it is unknown how much of the last batch was written
            lost = self._sink.lost - self._lost_before
            self.dropped += max(0, self.in_hand - lost)
            self._written += min(self.in_hand, lost)
            self.in_hand, self._lost_before = 0, None

    def stats(self) -> OutputStats:
        """Return the counts for the record `stats`.

        While the output writes a batch, its number of lost records from before the batch is used.
        """
        lost = self._sink.lost if self._lost_before is None else self._lost_before
        return OutputStats(self._written - lost, self.dropped + lost, self.waiting + self.in_hand)


class SinkQueue:
    """Feeds one output (sink) from a queue.

    `on_end`: function that is called once, in the writing thread, when the output can take no more records.
    Its argument is None if the program that reads the output has ended, otherwise the exception. `thread`: a
    thread that several queues share. By default the queue has its own thread.
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
        self._counts = QueueCounts(sink)
        self.thread = thread or SinkThread(f"sink {sink.name}")
        self._changed = self.thread.changed
        self._ended = self._released = False
        self._idle_s = 0.0

    @property
    def name(self) -> str:
        """Name of the output, under which the record `stats` has its counts."""
        return self.sink.name

    def start(self) -> None:
        """Let the thread write the items of this queue."""
        self.thread.add(self)

    def put(
        self,
        items: Iterable[Item | Departed],
        arrived_ns: int | None = None,
        *,
        wait: bool = False,
    ) -> None:
        """Queue items. Items for which the queue has no room are dropped and counted.

        `wait`: whether to wait for room if the sink must not lose records. `arrived_ns`: monotonic arrival
        time of the data, from which the latency is computed [ns]; None for data without an arrival time.
        """
        counts = self._counts
        with self._changed:
            room = self.thread.room(self.sink.capacity)
            for item in items:
                if wait and self.sink.lossless:
                    while counts.waiting >= room and not (self._ended or self._released):
                        self.thread.wake_up.ring()
                        self._changed.wait(IDLE_S)
                count = weight(item)
                if self._ended or counts.waiting >= room:
                    counts.dropped += count
                    counts.overflow += count
                else:
                    self._queue.append((item, arrived_ns))
                    counts.queued += count
                    counts.waiting += count
        self.thread.wake_up.ring()

    def wait_for_room(self, timeout_s: float) -> bool:
        """Wait until the queue is less than half full, or has ended. Return False if this takes too long."""
        with self._changed:
            return self._changed.wait_for(
                lambda: self._counts.waiting < self.sink.capacity // 2 or self._ended or self.closing,
                timeout_s,
            )

    def progress(self) -> tuple[int, int]:
        """Return how many records were ever queued, and how many of them were written or dropped."""
        with self._changed:
            counts = self._counts
            return counts.queued, counts.queued - counts.waiting - counts.in_hand

    def stats(self) -> OutputStats:
        """Return the numbers of written, lost and waiting records.

        A record that is being written counts as waiting.
        """
        with self._changed:
            return self._counts.stats()

    def close(self) -> None:
        """Accept no more items. Queued items are still written (see `join`)."""
        with self._changed:
            self.closing = self._released = True
            self.thread.hurry.set()
            self._changed.notify_all()
        self.thread.wake_up.ring()

    def release(self) -> None:
        """Let `put` no longer wait for room: calls that wait now go on, and later calls do not wait."""
        with self._changed:
            self._released = True
            self._changed.notify_all()

    def join(self, timeout_s: float) -> bool:
        """Wait until the sink has written everything and is closed; return False if the time runs out."""
        return self.done.wait(timeout_s)

    def write(self) -> bool:
        """Write the queued items.

        Return False once the queue is closed and empty, or the output has ended.
        """
        if not (self._queue or self.closing or time.monotonic() >= self._idle_s):
            return True
        try:
            if self._write_batch():
                return True
            self.sink.close()
        except SinkClosed:
            self._end(None)
        except Exception as error:  # an error of any kind, such as one of a library, ends only this output
            self._end(error)
        return False

    def _write_batch(self) -> bool:
        with self._changed:
            batch = list(self._queue)
            self._queue.clear()
            overflow = self._counts.begin_batch()
            closing = self.closing
            self._changed.notify_all()
        for item, _ in batch:
            if isinstance(item, Departed):
                self.sink.depart(item)
            else:
                self.sink.write(item)
        # Once the queue is full, all items are dropped until the next batch is taken. So the dropped items
        # came after the items of this batch, and are reported after them.
        if overflow:
            self.sink.on_overflow(overflow)
        self.sink.flush()
        with self._changed:
            self._counts.end_batch()
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
            self._counts.end()
            self._queue.clear()
            self._changed.notify_all()
        self._on_end(self, error)
