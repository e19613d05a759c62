"""Reads one serial port in a separate thread."""

import queue
import threading
from collections.abc import Iterator

from fltea.records.events import Chunk, Opened, Reads, Tick, TransportEvent
from fltea.wire.ports import Ports
from fltea.wire.transport import QUEUE_BYTES, READ_TIMEOUT_S, Port


class Reader:
    """Reads one serial port in a separate thread until `close`, and queues the events.

    This class is for ports without a file descriptor, and for callers that have only one port.
    """

    def __init__(self, port: Port) -> None:
        self.port = port
        self._queue: queue.SimpleQueue[TransportEvent | None] = queue.SimpleQueue()
        self._queued_bytes = 0
        self._lock = threading.Lock()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name=f"reader {port.url}", daemon=True)

    def start(self) -> None:
        """Start the reading thread."""
        self._thread.start()

    def events(self, timeout_s: float) -> Iterator[TransportEvent | None]:
        """Yield events until `close`, and then those that have already come.

        Yield None whenever no event has come for `timeout_s` [s].
        """
        while True:
            try:
                event = self._queue.get(timeout=timeout_s)
            except queue.Empty:
                yield None
                continue
            if event is None:
                return
            if isinstance(event, Chunk):
                with self._lock:
                    self._queued_bytes -= len(event.data)
            yield event

    def close(self) -> None:
        """Stop reading the port and close it."""
        self._stop.set()
        self._queue.put(None)  # wakes a caller that waits in `events`
        if self._thread.is_alive():
            self._thread.join(timeout=5 * READ_TIMEOUT_S + 1.0)

    def _run(self) -> None:
        if not self.port.has_descriptor:
            self._run_without_descriptor()
            return
        ports = Ports([self.port])
        while not self._stop.is_set():
            for _, item in ports.poll(READ_TIMEOUT_S):
                if isinstance(item, Reads):
                    for chunk in item.chunks():
                        self._put(chunk)
                elif not isinstance(item, Tick):
                    self._put(item)
        ports.close()

    def _run_without_descriptor(self) -> None:
        port = self.port
        while not self._stop.is_set():
            event: TransportEvent | None = port.open()
            while isinstance(event, Opened | Chunk | None) and not self._stop.is_set():
                if event is not None:
                    self._put(event)
                event = port.read_waiting()
            if event is not None:
                self._put(event)
            self._stop.wait(port.backoff_s())
        port.close()

    def _put(self, event: TransportEvent) -> None:
        """Queue an event without waiting.

        If the consumer of the queue is too slow, drop received bytes and count them.
        """
        if isinstance(event, Chunk):
            with self._lock:
                if self._queued_bytes + len(event.data) > QUEUE_BYTES:
                    self.port.overflow_bytes += len(event.data)
                    return
                self._queued_bytes += len(event.data)
        self._queue.put(event)
