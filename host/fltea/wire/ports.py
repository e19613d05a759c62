"""Many ports in one thread: a native reader waits for them, reads them and stamps what comes."""

import os
import queue
import threading
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from fltea._native import Bell, PortReader
from fltea.records.clock import host_ns
from fltea.records.events import Failed, Opened, Reads, Tick
from fltea.wire.transport import QUEUE_BYTES, Port

TICK_S = 0.5
"""A silent line is looked at so often; a replay does the same."""

TICK_NS = int(TICK_S * 1e9)


@dataclass
class _Line:
    """A port as the loop sees it. open_ns: when to open it; None while it is open, or being opened."""

    port: Port
    tick_ns: int
    open_ns: int | None = 0
    is_open: bool = False


class Ports:
    """Reads ports that have descriptors. Each is opened, lost and opened again for itself."""

    def __init__(self, ports: Sequence[Port]) -> None:
        tick_ns = host_ns() + TICK_NS
        self._lines = [_Line(port, tick_ns) for port in ports]
        self._opened: queue.SimpleQueue[tuple[int, Opened | Failed]] = queue.SimpleQueue()
        self._reader = PortReader(QUEUE_BYTES)
        self._lock = threading.Lock()
        self._closed = False

    def poll(
        self, timeout_s: float, bells: Sequence[Bell] = ()
    ) -> Iterator[tuple[int, Reads | Opened | Failed | Tick]]:
        """Ring the bells, and wait for something to happen; yield what did, with the place of its port.

        A tick says that nothing came from a port for half a second, until its time.
        """
        now_ns = host_ns()
        self._open_due(now_ns)
        next_ns = min(min(line.tick_ns, line.open_ns or line.tick_ns) for line in self._lines)
        now_ns, news = self._reader.take(min(timeout_s, max(0.0, (next_ns - now_ns) * 1e-9)), bells)
        for place, data, columns, overflow_bytes, lost in news:
            line = self._lines[place]
            line.port.overflow_bytes += overflow_bytes
            if data:
                line.port.has_worked()
                line.tick_ns = int(columns[1][-1]) + TICK_NS
                yield place, Reads(data, *columns)
            if lost is not None:
                error, *at = lost
                yield place, self._noted(line, line.port.lost(OSError(error, os.strerror(error)), *at))
        while not self._opened.empty():
            place, event = self._opened.get()
            yield place, self._on_opened(place, event)
        for place, line in enumerate(self._lines):
            if now_ns >= line.tick_ns:
                line.tick_ns = now_ns + TICK_NS
                yield place, Tick(now_ns)

    def wake(self) -> None:
        """End the waiting, from another thread."""
        self._reader.wake()

    def close(self) -> None:
        """Release all ports; one that is being opened is released as soon as it is open."""
        with self._lock:
            self._closed = True
        self._reader.close()
        while not self._opened.empty():  # open, and the loop has not taken note of it
            self._lines[self._opened.get()[0]].port.close()
        for line in self._lines:
            if line.is_open:
                line.port.close()

    def _open_due(self, now_ns: int) -> None:
        """Let ports be opened that are due, each in a thread: a network may take its time."""
        for place, line in enumerate(self._lines):
            if line.open_ns is not None and now_ns >= line.open_ns:
                line.open_ns = None
                name = f"open {line.port.url}"
                threading.Thread(target=self._open, args=(place,), name=name, daemon=True).start()

    def _open(self, place: int) -> None:
        event = self._lines[place].port.open()
        with self._lock:
            if self._closed:
                self._lines[place].port.close()
                return
            self._opened.put((place, event))
        self._reader.wake()

    def _on_opened(self, place: int, event: Opened | Failed) -> Opened | Failed:
        line = self._lines[place]
        if isinstance(event, Opened):
            try:
                latency_ns = round(line.port.latency_s * 1e9)
                self._reader.add(place, line.port.fileno(), line.port.is_socket, latency_ns)
            except OSError as error:
                event = line.port.lost(error)
        return self._noted(line, event)

    def _noted(self, line: _Line, event: Opened | Failed) -> Opened | Failed:
        """Take note of whether a port is open; one that is not is tried again later."""
        now_ns = host_ns()
        line.is_open = isinstance(event, Opened)
        line.open_ns = None if line.is_open else now_ns + round(line.port.backoff_s() * 1e9)
        line.tick_ns = now_ns + TICK_NS
        return event
