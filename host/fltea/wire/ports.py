"""Ports in one thread: a native reader waits for them, reads them and stamps what comes."""

from collections.abc import Iterator, Sequence

from fltea._native import PortReader
from fltea.records.clock import host_ns
from fltea.records.events import Failed, Opened, Reads, Tick
from fltea.wire.openings import Openings
from fltea.wire.transport import QUEUE_BYTES, Port

TICK_S = 0.5
"""A silent line is looked at so often; a replay does the same."""

TICK_NS = int(TICK_S * 1e9)


class Ports:
    """Reads ports that have descriptors; for whoever interprets what came himself."""

    def __init__(self, ports: Sequence[Port]) -> None:
        self._ports = list(ports)
        self._tick_ns = [host_ns() + TICK_NS] * len(ports)
        self._reader = PortReader(QUEUE_BYTES)
        self._openings = Openings(ports, self._reader.add, self._reader.wake)

    def poll(self, timeout_s: float) -> Iterator[tuple[int, Reads | Opened | Failed | Tick]]:
        """Wait for something to happen; yield what did, with the place of its port.

        A tick says that nothing came from a port for half a second, until its time.
        """
        now_ns = host_ns()
        self._openings.begin(now_ns)
        next_ns = min([*self._tick_ns, self._openings.next_ns or self._tick_ns[0]])
        now_ns, news = self._reader.take(min(timeout_s, max(0.0, (next_ns - now_ns) * 1e-9)))
        for place, data, columns, overflow_bytes, lost in news:
            port = self._ports[place]
            port.overflow_bytes += overflow_bytes
            if data:
                port.has_worked()
                self._tick_ns[place] = int(columns[1][-1]) + TICK_NS
                yield place, Reads(data, *columns)
            if lost is not None:
                yield self._touched(place, self._openings.lost(place, *lost, worked=bool(data)))
        for place, event in self._openings.opened():
            yield self._touched(place, event)
        for place, tick_ns in enumerate(self._tick_ns):
            if now_ns >= tick_ns:
                self._tick_ns[place] = now_ns + TICK_NS
                yield place, Tick(now_ns)

    def wake(self) -> None:
        """End the waiting, from another thread."""
        self._reader.wake()

    def close(self) -> None:
        """Release all ports."""
        self._reader.close()
        self._openings.close()

    def _touched(self, place: int, event: Opened | Failed) -> tuple[int, Opened | Failed]:
        self._tick_ns[place] = host_ns() + TICK_NS
        return place, event
