"""Ports that are opened, lost and opened again, each for itself; somebody else reads them."""

import os
import queue
import threading
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from fltea.records.clock import host_ns
from fltea.records.events import Failed, Opened
from fltea.wire.transport import Port


@dataclass
class _Line:
    """A port as the loop sees it. open_ns: when to open it; None while it is open, or being opened."""

    port: Port
    open_ns: int | None = 0
    is_open: bool = False


class Openings:
    """Opens ports that have descriptors.

    read: called with the place of a port that is open, its descriptor, whether its other side can close it,
    and its latency in ns; OSError if it cannot be read. wake: called from another thread when a port is open,
    or has failed.
    """

    def __init__(
        self,
        ports: Sequence[Port],
        read: Callable[[int, int, bool, int], None],
        wake: Callable[[], None],
    ) -> None:
        self._lines = [_Line(port) for port in ports]
        self._read, self._wake = read, wake
        self._opened: queue.SimpleQueue[tuple[int, Opened | Failed]] = queue.SimpleQueue()
        self._lock = threading.Lock()
        self._closed = False

    def begin(self, now_ns: int) -> None:
        """Let ports be opened that are due, each in a thread: a network may take its time."""
        for place, line in enumerate(self._lines):
            if line.open_ns is not None and now_ns >= line.open_ns:
                line.open_ns = None
                name = f"open {line.port.url}"
                threading.Thread(target=self._open, args=(place,), name=name, daemon=True).start()

    @property
    def next_ns(self) -> int | None:
        """When the next port is to be opened; None if none is."""
        return min((line.open_ns for line in self._lines if line.open_ns is not None), default=None)

    def opened(self) -> Iterator[tuple[int, Opened | Failed]]:
        """Yield which ports have been opened, or have failed, since this was asked last."""
        while not self._opened.empty():
            place, event = self._opened.get()
            line = self._lines[place]
            if isinstance(event, Opened):
                port = line.port
                try:
                    self._read(place, port.fileno(), port.is_socket, round(port.latency_s * 1e9))
                except OSError as error:
                    event = port.lost(error)
            yield place, self._noted(line, event)

    def lost(self, place: int, number: int, *at: int, worked: bool) -> Failed:
        """Take note that a port was lost, with this errno; at: time and offset to Unix time.

        worked: it gave bytes, so it is tried again soon.
        """
        line = self._lines[place]
        if worked:
            line.port.has_worked()
        failed = line.port.lost(OSError(number, os.strerror(number)), *at)
        self._noted(line, failed)
        return failed

    def close(self) -> None:
        """Release all ports, which nobody reads any more; one that is being opened as soon as it is open."""
        with self._lock:
            self._closed = True
        while not self._opened.empty():  # open, and nobody has taken note of it
            self._lines[self._opened.get()[0]].port.close()
        for line in self._lines:
            if line.is_open:
                line.port.close()

    def _open(self, place: int) -> None:
        event = self._lines[place].port.open()
        with self._lock:
            if self._closed:
                self._lines[place].port.close()
                return
            self._opened.put((place, event))
        self._wake()

    def _noted(self, line: _Line, event: Opened | Failed) -> Opened | Failed:
        """Take note of whether a port is open; one that is not is tried again later."""
        line.is_open = isinstance(event, Opened)
        line.open_ns = None if line.is_open else host_ns() + round(line.port.backoff_s() * 1e9)
        return event
