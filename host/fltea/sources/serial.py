"""Reads a device on a serial URL."""

from collections.abc import Callable, Iterator
from typing import Any

from fltea._native import WireLine
from fltea.records import clock
from fltea.records.events import Event, Reads, TransportEvent
from fltea.records.stats import LinkStats
from fltea.sources.wire_events import WireEvents
from fltea.wire.ports import TICK_S
from fltea.wire.reader import Reader
from fltea.wire.transport import Port


class SerialSource:
    """Turns frames from a serial port into events; every failure is a `Trouble`, and reading goes on.

    It reads by itself (`events`), or somebody reads `port` natively and gives it what happened (`take`).

    latency_s: as of `Port`. tap: is given whatever comes from the port before anything interprets it; to be
    set before that.

    Raises:
        UsageError: an unknown kind of URL, or 1200 baud.
    """

    live = prompt = True

    def __init__(self, url: str, baud: int, latency_s: float = 0.0) -> None:
        self.url = url
        self.port = Port(url, baud, latency_s)
        self._reader: Reader | None = None
        self._wire = WireEvents(url)
        self.tap: Callable[[TransportEvent | Reads], None] | None = None

    @property
    def unix_offset_ns(self) -> int:
        """The difference from the monotonic clock to Unix time in ns, as of the last event."""
        return self._wire.unix_offset_ns

    def events(self) -> Iterator[Event]:
        """Yield the events of the device until `close`; a thread of its own reads the port."""
        self._reader = Reader(self.port)
        self._reader.start()
        self._wire.resume(clock.host_ns())
        for item in self._reader.events(TICK_S):
            yield from self.take(item)

    @property
    def line(self) -> WireLine:
        """The native line, for who reads the port natively, and tells what is to be told by `events_of`."""
        return self._wire.line

    def events_of(self, item: tuple[Any, ...]) -> Iterator[Event]:
        """Yield the events of one item of the line, before the next is asked for."""
        return self._wire.events_of(item)

    def take(self, item: TransportEvent | None) -> Iterator[Event]:
        """Yield the events of what came from the port; None: nothing for a while."""
        now_ns = clock.host_ns()
        if item is not None and self.tap is not None:
            self.tap(item)
        yield from self._wire.feed(item, now_ns)
        self._wire.resume(now_ns)

    def link_stats(self) -> LinkStats:
        """Count what arrived and what was lost on the way."""
        return self._wire.link_stats(self.port.overflow_bytes)

    def close(self) -> None:
        """Stop reading and release the port; one that somebody else reads is theirs to close."""
        if self._reader is not None:
            self._reader.close()
