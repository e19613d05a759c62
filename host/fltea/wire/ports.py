"""Reads several serial ports in one thread.

Native code waits for bytes, reads them and notes their arrival times.
"""

from collections.abc import Iterator, Sequence

from fltea._native import PortReader
from fltea.records.clock import host_ns
from fltea.records.events import Failed, Opened, Reads, Tick
from fltea.wire.openings import Openings
from fltea.wire.transport import QUEUE_BYTES, Port

TICK_S = 0.5
"""Time without bytes from a port after which a `Tick` is yielded for it [s]. Replays of recordings yield
ticks at the same interval.
"""

TICK_NS = int(TICK_S * 1e9)


class Ports:
    """Reads serial ports that have file descriptors.

    It yields the received bytes without decoding them, and the events of the ports.
    """

    def __init__(self, ports: Sequence[Port]) -> None:
        self._ports = list(ports)
        self._tick_ns = [host_ns() + TICK_NS] * len(ports)
        self._reader = PortReader(QUEUE_BYTES)
        self._openings = Openings(ports, self._reader.add, self._reader.wake)

    def poll(self, timeout_s: float) -> Iterator[tuple[int, Reads | Opened | Failed | Tick]]:
        """Wait up to `timeout_s` [s] for events; yield each event with the index of its port.

        A `Tick` means that nothing arrived from a port for half a second. The `Tick` contains the time at
        which this half second ended.
        """
        now_ns = host_ns()
        self._openings.begin(now_ns)
        next_ns = min([*self._tick_ns, self._openings.next_ns or self._tick_ns[0]])
        now_ns, changes = self._reader.take(min(timeout_s, max(0.0, (next_ns - now_ns) * 1e-9)))
        for index, data, columns, overflow_bytes, lost in changes:
            port = self._ports[index]
            port.overflow_bytes += overflow_bytes
            if data:
                port.has_worked()
                self._tick_ns[index] = int(columns[1][-1]) + TICK_NS
                yield index, Reads(data, *columns)
            if lost is not None:
                yield self._postpone_tick(index, self._openings.lost(index, *lost, worked=bool(data)))
        for index, event in self._openings.opened():
            yield self._postpone_tick(index, event)
        for index, tick_ns in enumerate(self._tick_ns):
            if now_ns >= tick_ns:
                self._tick_ns[index] = now_ns + TICK_NS
                yield index, Tick(now_ns)

    def wake(self) -> None:
        """End the wait in `poll`. This method may be called from another thread."""
        self._reader.wake()

    def close(self) -> None:
        """Close all ports."""
        self._reader.close()
        self._openings.close()

    def _postpone_tick(self, index: int, event: Opened | Failed) -> tuple[int, Opened | Failed]:
        self._tick_ns[index] = host_ns() + TICK_NS
        return index, event
