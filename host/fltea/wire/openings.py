"""Opens serial ports, each in its own thread, and opens a port again if it was lost.

This module does not read the opened ports.
"""

import os
import queue
import threading
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from fltea.records.clock import host_ns
from fltea.records.events import Failed, Opened
from fltea.wire.transport import Port


@dataclass
class _PortState:
    """State of a port.

    `open_ns`: time at which the port has to be opened [ns]; None while the port is open or being opened.
    """

    port: Port
    open_ns: int | None = 0
    is_open: bool = False


class Openings:
    """Opens serial ports that have a file descriptor.

    `read`: function that starts to read an opened port. Its arguments are the port's index, its file
    descriptor, whether the other side can close the port, and the port's `latency_s`, converted to
    nanoseconds. It raises OSError if the port cannot be read.
    `wake`: function that is called from another thread after each attempt to open a port, whether successful
    or not.
    """

    def __init__(
        self,
        ports: Sequence[Port],
        read: Callable[[int, int, bool, int], None],
        wake: Callable[[], None],
    ) -> None:
        self._states = [_PortState(port) for port in ports]
        self._read, self._wake = read, wake
        self._opened: queue.SimpleQueue[tuple[int, Opened | Failed]] = queue.SimpleQueue()
        self._lock = threading.Lock()
        self._closed = False

    def begin(self, now_ns: int) -> None:
        """Start to open the ports that have to be opened by now.

        Each is opened in its own thread, since opening a port on a network may be slow.
        """
        for index, state in enumerate(self._states):
            if state.open_ns is not None and now_ns >= state.open_ns:
                state.open_ns = None
                name = f"open {state.port.url}"
                threading.Thread(target=self._open, args=(index,), name=name, daemon=True).start()

    @property
    def next_ns(self) -> int | None:
        """Earliest time at which a port has to be opened [ns]; None if no port waits to be opened."""
        return min((state.open_ns for state in self._states if state.open_ns is not None), default=None)

    def opened(self) -> Iterator[tuple[int, Opened | Failed]]:
        """Yield the results of all attempts to open a port that have ended since the last call.

        Each result comes with the index of its port.
        """
        while not self._opened.empty():
            index, event = self._opened.get()
            state = self._states[index]
            if isinstance(event, Opened):
                port = state.port
                try:
                    self._read(index, port.fileno(), port.is_socket, round(port.latency_s * 1e9))
                except OSError as error:
                    event = port.lost(error)
            yield index, self._updated(state, event)

    def lost(self, index: int, number: int, *at: int, worked: bool) -> Failed:
        """Close a port that was lost, schedule its next opening, and return the event of the loss.

        `number`: error code (errno) of the failed system call that showed the loss.
        `at`: host time of the loss, and Unix time minus host time at that moment, both in ns.
        `worked`: whether bytes had arrived from the port since it was opened. If so, the port is opened again
        soon.
        """
        state = self._states[index]
        if worked:
            state.port.has_worked()
        failed = state.port.lost(OSError(number, os.strerror(number)), *at)
        self._updated(state, failed)
        return failed

    def close(self) -> None:
        """Close all ports. The caller must have stopped reading them.

        A port that is just being opened is closed as soon as it is open.
        """
        with self._lock:
            self._closed = True
        # close ports that are already open, but that `opened` has not yielded yet
        while not self._opened.empty():
            self._states[self._opened.get()[0]].port.close()
        for state in self._states:
            if state.is_open:
                state.port.close()

    def _open(self, index: int) -> None:
        event = self._states[index].port.open()
        with self._lock:
            if self._closed:
                self._states[index].port.close()
                return
            self._opened.put((index, event))
        self._wake()

    def _updated(self, state: _PortState, event: Opened | Failed) -> Opened | Failed:
        """Record whether the port is open, as `event` says.

        If the port is not open, schedule its next opening. Return the event.
        """
        state.is_open = isinstance(event, Opened)
        state.open_ns = None if state.is_open else host_ns() + round(state.port.backoff_s() * 1e9)
        return event
