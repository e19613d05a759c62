"""Many ports in one thread: whoever has something to say is read, and nobody waits for another.

Load makes batches: the longer a round takes, the more has come in by the next one, and the less each costs.
"""

import contextlib
import os
import queue
import select
import threading
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from fltea.records.events import Failed, Opened, TransportEvent
from fltea.wire.transport import Port

TICK_S = 0.5
"""A silent line is looked at so often; a replay does the same."""


@dataclass
class _Line:
    """A port as the loop sees it. descriptor: once it is open. open_s: when to open it; None meanwhile."""

    port: Port
    tick_s: float
    descriptor: int | None = None
    open_s: float | None = 0.0


class Ports:
    """Reads ports that have descriptors. Each is opened, lost and opened again for itself."""

    def __init__(self, ports: Sequence[Port]) -> None:
        now_s = time.monotonic()
        self._lines = [_Line(port, now_s + TICK_S) for port in ports]
        self._by_descriptor: dict[int, int] = {}
        self._opened: queue.SimpleQueue[tuple[int, Opened | Failed]] = queue.SimpleQueue()
        self._ready = select.poll()
        self._wake_read, self._wake_write = os.pipe()
        os.set_blocking(self._wake_write, False)
        self._ready.register(self._wake_read, select.POLLIN)
        self._lock = threading.Lock()
        self._closed = False

    def poll(self, timeout_s: float) -> Iterator[tuple[int, TransportEvent | None]]:
        """Wait for something to happen; yield what did, with the place of its port.

        None says that nothing came from a port for half a second.
        """
        now_s = time.monotonic()
        self._open_due(now_s)
        next_s = min(min(line.tick_s, line.open_s or line.tick_s) for line in self._lines)
        wait_s = min(timeout_s, max(0.0, next_s - now_s))
        for descriptor, mask in self._ready.poll(wait_s * 1000):
            if descriptor == self._wake_read:
                os.read(descriptor, 4096)
                yield from self._take_opened()
                continue
            place = self._by_descriptor[descriptor]
            event = self._lines[place].port.read_ready(hung_up=bool(mask & ~select.POLLIN))
            if isinstance(event, Failed):
                self._lose(place)
            if event is not None:
                self._lines[place].tick_s = time.monotonic() + TICK_S
                yield place, event
        now_s = time.monotonic()
        for place, line in enumerate(self._lines):
            if now_s >= line.tick_s:
                line.tick_s = now_s + TICK_S
                yield place, None

    def wake(self) -> None:
        """End the waiting, from another thread."""
        with self._lock:
            if not self._closed:
                self._wake()

    def close(self) -> None:
        """Release all ports; one that is being opened is released as soon as it is open."""
        with self._lock:
            self._closed = True
            os.close(self._wake_read)
            os.close(self._wake_write)
        while not self._opened.empty():  # open, and the loop has not taken note of it
            self._lines[self._opened.get()[0]].port.close()
        for line in self._lines:
            if line.open_s is not None or line.descriptor is not None:
                line.port.close()

    def _open_due(self, now_s: float) -> None:
        """Let ports be opened that are due, each in a thread: a network may take its time."""
        for place, line in enumerate(self._lines):
            if line.open_s is not None and line.descriptor is None and now_s >= line.open_s:
                line.open_s = None
                name = f"open {line.port.url}"
                threading.Thread(target=self._open, args=(place,), name=name, daemon=True).start()

    def _open(self, place: int) -> None:
        event = self._lines[place].port.open()
        with self._lock:
            if self._closed:
                self._lines[place].port.close()
                return
            self._opened.put((place, event))
            self._wake()

    def _wake(self) -> None:
        with contextlib.suppress(BlockingIOError):  # full: it wakes up anyway
            os.write(self._wake_write, b"\0")

    def _take_opened(self) -> Iterator[tuple[int, TransportEvent]]:
        while not self._opened.empty():
            place, event = self._opened.get()
            line = self._lines[place]
            if isinstance(event, Opened):
                line.descriptor = line.port.fileno()
                self._by_descriptor[line.descriptor] = place
                self._ready.register(line.descriptor, select.POLLIN)
            else:
                line.open_s = time.monotonic() + line.port.backoff_s()
            yield place, event

    def _lose(self, place: int) -> None:
        """Note that a port was lost, and try it again later."""
        line = self._lines[place]
        assert line.descriptor is not None
        self._ready.unregister(line.descriptor)
        del self._by_descriptor[line.descriptor]
        line.descriptor = None
        line.open_s = time.monotonic() + line.port.backoff_s()
