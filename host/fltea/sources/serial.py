"""Reads a device on a serial port, which is named by a URL."""

from collections.abc import Callable, Iterator
from typing import Any

from fltea._native import PortDecoder
from fltea.records import clock
from fltea.records.events import Event, Reads, TransportEvent
from fltea.records.stats import LinkStats
from fltea.settings.config import Config
from fltea.sources.opening import Named, port_here
from fltea.sources.wire_events import WireEvents
from fltea.wire.ports import TICK_S
from fltea.wire.reader import Reader
from fltea.wire.transport import Port


class SerialSource:
    """Turns frames from a serial port into events. Each failure becomes a `Trouble`, and reading continues.

    The port is read in one of two ways. Either this object reads it (`events`), or native code reads `port`,
    and what the native code has read is passed to `take` or decoded by `decoder`.

    `latency_s`: longest time for which received bytes wait before they are passed on [s]. `tap`: function
    that is called with everything that comes from the port, before it is decoded; set it before reading
    begins.

    Raises:
        UsageError: the kind of URL is unknown, or the speed is 1200 baud, which would erase an Arduino Due.
    """

    live = prompt = has_clock = True

    def __init__(self, url: str, baud: int, latency_s: float = 0.0) -> None:
        self.url = url
        self.port = Port(url, baud, latency_s)
        self._reader: Reader | None = None
        self._wire = WireEvents(url)
        self.tap: Callable[[TransportEvent | Reads], None] | None = None

    @property
    def unix_offset_ns(self) -> int:
        """Offset from the monotonic clock to Unix time at the last event [ns]."""
        return self._wire.unix_offset_ns

    def events(self) -> Iterator[Event]:
        """Yield the device's events until `close` is called. A separate thread reads the port."""
        self._reader = Reader(self.port)
        self._reader.start()
        self._wire.resume(clock.host_ns())
        for item in self._reader.events(TICK_S):
            yield from self.take(item)

    @property
    def decoder(self) -> PortDecoder:
        """The native decoder of the port's bytes, for callers that read the port in native code.

        The caller passes each item that the decoder gives to `events_of`.
        """
        return self._wire.decoder

    def events_of(self, item: tuple[Any, ...]) -> Iterator[Event]:
        """Yield the events that follow from `item`, which `decoder` gave.

        Consume the events before you ask the decoder for its next item.
        """
        return self._wire.events_of(item)

    def take(self, item: TransportEvent | None) -> Iterator[Event]:
        """Yield the events of what came from the port.

        An `item` of None says that nothing came for a while.
        """
        now_ns = clock.host_ns()
        if item is not None and self.tap is not None:
            self.tap(item)
        yield from self._wire.feed(item, now_ns)
        self._wire.resume(now_ns)

    def link_stats(self) -> LinkStats:
        """Return the counts of bytes and frames that arrived, and that were lost on the way."""
        return self._wire.link_stats(self.port.overflow_bytes)

    def close(self) -> None:
        """Stop reading and release the port.

        If native code reads the port, do nothing, since the native code also closes the port.
        """
        if self._reader is not None:
            self._reader.close()


def open_named(named: Named, config: Config) -> SerialSource:
    """Return the source that reads the board at a port."""
    return SerialSource(named.place, config.link.baud, config.link.latency_s)


def only_reader_of(named: Named) -> str:
    """Return the port, if it is one of this machine."""
    return port_here(named.place)
