"""A sink behind a bounded queue and in a thread of its own: slow or broken, it loses only its own records."""

import threading
import time
from collections import deque
from collections.abc import Callable, Iterable

from fltea.records.block import Block
from fltea.records.clock import host_ns
from fltea.records.events import Reads
from fltea.records.ports import Departed, Item, Latency, Sink, SinkClosed
from fltea.records.records import OutputStats

IDLE_S = 0.5


def weight(item: Item | Departed) -> int:
    """How many records an item stands for."""
    if isinstance(item, Departed):
        return 0
    if isinstance(item, Reads):
        return len(item.end)
    return item.weight if isinstance(item, Block) else 1


class Outlet:
    """Feeds one sink.

    on_end: called once, from the outlet's thread, when the sink can take no more: with None if its reader
    left, else with the exception.
    """

    def __init__(self, sink: Sink, on_end: Callable[["Outlet", Exception | None], None]) -> None:
        self.sink = sink
        self.latency = Latency()
        self._on_end = on_end
        self._queue: deque[tuple[Item | Departed, int | None]] = deque()
        self._waiting = 0  # records in the queue
        self._changed = threading.Condition()
        self._closing = self._ended = False
        self._written = self._dropped = self._overflow = 0
        self._in_hand = 0
        self._rested_s = 0.0
        self._lost_before: int | None = None  # the sink's own count, while a batch is in hand
        self._thread = threading.Thread(target=self._run, name=f"sink {sink.name}", daemon=True)

    @property
    def name(self) -> str:
        """Key of its counts in `stats.outputs`."""
        return self.sink.name

    def start(self) -> None:
        """Begin to write."""
        self._thread.start()

    def put(
        self, items: Iterable[Item | Departed], arrived_ns: int | None = None, *, wait: bool = False
    ) -> None:
        """Queue items; those beyond the sink's capacity are dropped and counted, unless `wait` is set.

        arrived_ns: monotonic time at which what they report arrived, for the latency; None where it has none.
        """
        with self._changed:
            for item in items:
                if wait:
                    while self._waiting >= self.sink.capacity and not (self._ended or self._closing):
                        self._changed.notify_all()
                        self._changed.wait(IDLE_S)
                count = weight(item)
                if self._ended or self._waiting >= self.sink.capacity:
                    self._dropped += count
                    self._overflow += count
                else:
                    self._queue.append((item, arrived_ns))
                    self._waiting += count
            self._changed.notify_all()

    def wait_for_room(self, timeout_s: float) -> bool:
        """Wait until the queue is less than half full, or has ended; False if it is not in time."""
        with self._changed:
            return self._changed.wait_for(
                lambda: self._waiting < self.sink.capacity // 2 or self._ended or self._closing, timeout_s
            )

    def stats(self) -> OutputStats:
        """Count what was written and what was lost; what is being written still waits."""
        with self._changed:
            lost = self.sink.lost if self._lost_before is None else self._lost_before
            return OutputStats(self._written - lost, self._dropped + lost, self._waiting + self._in_hand)

    def close(self) -> None:
        """Take nothing more; what is queued still goes out (see `join`)."""
        with self._changed:
            self._closing = True
            self._changed.notify_all()

    def join(self, timeout_s: float) -> bool:
        """Wait until the sink has written everything and is closed; False if it did not manage."""
        self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def _run(self) -> None:
        try:
            while self._write_batch():
                pass
            self.sink.close()
        except SinkClosed:
            self._end(None)
        except Exception as error:  # whatever a library raises ends this output alone
            self._end(error)

    def _write_batch(self) -> bool:
        """Write what is queued; False when closed and empty."""
        with self._changed:
            if not self._queue and not self._closing:
                self._changed.wait(IDLE_S)
        # Only who has just written rests: to wake up twice for what comes now and then costs as much again.
        left_s = self._rested_s - time.monotonic()
        if left_s > 0 and not self._closing:
            time.sleep(left_s)
        with self._changed:
            batch = list(self._queue)
            self._queue.clear()
            count, self._waiting = self._waiting, 0
            overflow, self._overflow = self._overflow, 0
            closing = self._closing
            self._in_hand, self._lost_before = count, self.sink.lost
            self._changed.notify_all()
        for item, _ in batch:
            if isinstance(item, Departed):
                self.sink.depart(item)
            else:
                self.sink.write(item)
        if overflow:  # the queue was full then, so what was dropped comes behind all that was in it
            self.sink.on_overflow(overflow)
        self.sink.flush()
        with self._changed:
            self._written += count
            self._in_hand, self._lost_before = 0, None
        self._rested_s = time.monotonic() + self.sink.rest_s
        now_ns = host_ns()
        for item, arrived_ns in batch:
            if arrived_ns is not None:
                self.latency.add((now_ns - arrived_ns) * 1e-6, weight(item))
        return bool(batch) or not closing

    def _end(self, error: Exception | None) -> None:
        with self._changed:
            self._ended = True
            self._dropped += self._waiting
            self._waiting = 0
            self._queue.clear()
            if self._lost_before is not None:  # how much of the last batch went out nobody knows
                self._dropped += max(0, self._in_hand - (self.sink.lost - self._lost_before))
                self._written += min(self._in_hand, self.sink.lost - self._lost_before)
                self._in_hand, self._lost_before = 0, None
            self._changed.notify_all()
        self._on_end(self, error)
