"""Serve all serial ports in one thread (the work is done in host/native/round.hpp)."""

import time
from collections.abc import Callable, Iterable, Sequence
from enum import IntEnum
from typing import Any

from fltea import _native
from fltea.records import clock
from fltea.records.events import Event, Reads
from fltea.records.ports import Printed
from fltea.service.device_stream import DeviceStream
from fltea.service.hub import Hub
from fltea.service.pressure import CHECK_NS, Pressure
from fltea.sources.serial import SerialSource
from fltea.stream.decode import Stop
from fltea.stream.fit_times import DEVICES_A_SECOND
from fltea.wire.openings import Openings
from fltea.wire.ports import TICK_NS
from fltea.wire.transport import QUEUE_BYTES

WAIT_S = 0.5
PATIENCE_NS = 1_000_000
"""With many devices, the samples and bytes of a device are collected, so that outputs get fewer, larger
portions. They are collected for this time, multiplied by the number of devices [ns]. So each of n devices has
a portion every n ms, and an output of all devices gets at most a thousand portions a second.
"""


class PortStop(IntEnum):
    """Events of a port that Python handles. Their numbers are those in host/native/port_stream.hpp."""

    ITEM = 1
    """A message of the wire protocol has arrived that native code does not handle."""
    STOP = 2
    """The native device (C++) has stopped, for one of the reasons in `Stop`."""
    ROWS = 3
    """Samples are ready for an output that takes samples in blocks."""
    READS = 4
    """Bytes are ready for an output that takes the received bytes."""
    LOST = 5
    """The serial port cannot be read any more."""
    FAULT = 6
    """The data from the port cannot be used, and nothing more is read from the port."""


def has_port(stream: DeviceStream) -> bool:
    """Return whether this stream's source has a port on which the operating system can wait for data."""
    return isinstance(stream.source, SerialSource) and stream.source.port.has_descriptor


class PortLoop:
    """Reads all serial ports, and hands the data of each port to the device stream of that port.

    `on_end`: function that is called in the loop's thread when a device stream has ended. Its arguments are
    the stream, and the exception that ended the stream or None. `pressure`: receives the times for which
    samples wait.
    """

    def __init__(
        self,
        streams: Sequence[DeviceStream],
        on_end: Callable[[DeviceStream, Exception | None], None],
        hub: Hub,
        pressure: Pressure,
    ) -> None:
        self.streams = list(streams)
        self._on_end, self._hub, self._pressure = on_end, hub, pressure
        self._going = set(range(len(streams)))
        self._checked_ns = 0
        self._changes = -1
        self._closed = False
        self._sources = [stream.source for stream in streams if isinstance(stream.source, SerialSource)]
        self._texts = list(hub.printing(""))
        self._round = _native.Round(QUEUE_BYTES, TICK_NS, len(self._texts))
        for stream, source in zip(self.streams, self._sources, strict=True):
            self._round.add(source.decoder, stream.device, round(source.port.latency_s * 1e9))
        ports = [source.port for source in self._sources]
        self._openings = Openings(ports, self._round.open, self._round.wake)

    def run(self) -> None:
        """Run until `close`, or until every device stream has failed."""
        try:
            while self._going and not self._closed:
                self._take_round()
            self._hand_on(self._going)
            for index in list(self._going):
                self._finish(index)
        except Exception as error:  # an error of the loop itself ends all streams
            for index in self._going:
                self._on_end(self.streams[index], error)
            raise
        finally:
            self._round.close()
            self._openings.close()

    def close(self) -> None:
        """End the loop, from another thread."""
        self._closed = True
        self._round.wake()

    def _take_round(self) -> None:
        now_ns = clock.host_ns()
        self._openings.begin(now_ns)
        if self._hub.changes != self._changes or now_ns - self._checked_ns >= CHECK_NS:
            self._check(now_ns)
        next_ns = self._openings.next_ns
        self._run(WAIT_S if next_ns is None else min(WAIT_S, max(0.0, (next_ns - now_ns) * 1e-9)))
        for index, event in self._openings.opened():
            self._round.touch(index, event.host_ns)
            self._happened(index, PortLoop._on_port, event)
        failed = {index for index in self._going if self.streams[index].failure is not None}
        if failed:
            self._hand_on(failed)
            for index in failed & self._going:
                self._finish(index)

    def _run(self, wait_s: float) -> None:
        """Wait up to `wait_s` for data, and handle all events of the ports."""
        printed, happened = self._round.run(wait_s)
        for text, (data, parts) in zip(self._texts, printed, strict=True):
            if data:
                self._hub.print(text, Printed(data, sum(records for _, records in parts), parts))
        for index, kind, details in happened:
            self._happened(index, HANDLERS[kind], details)

    def _hand_on(self, indices: Iterable[int]) -> None:
        """Process all data that these ports have received, before their device streams end."""
        waiting = set(indices)
        for index in waiting:
            self._round.wants(index, *self.streams[index].wants(), 0)
        while waiting := {index for index in waiting & self._going if self._round.is_waiting(index)}:
            self._run(0.0)

    def _check(self, now_ns: int) -> None:
        """Do the regular work of the loop.

        This work is to find out in which forms the outputs take samples, to save snapshots that are due, and
        to check whether this machine is fast enough.
        """
        self._changes = self._hub.changes
        many = len(self.streams) if len(self.streams) > DEVICES_A_SECOND else 0
        for index in self._going:
            stream = self.streams[index]
            self._round.wants(index, *stream.wants(), many * PATIENCE_NS)
            self._sources[index].port.overflow_bytes = self._round.overflow_bytes(index)
            stream.check()
            stream.moved_s = time.monotonic()
        if now_ns - self._checked_ns >= CHECK_NS:
            self._checked_ns = now_ns
            self._pressure.waited(self._round.waited_ns())
            self._pressure.check(now_ns)

    def _happened(self, index: int, handle: "Callable[[PortLoop, int, Any], None]", details: Any) -> None:
        """Handle an event of one port. An exception ends only the device stream of this port."""
        if index not in self._going:
            return
        stream = self.streams[index]
        try:
            handle(self, index, details)
        except Exception as error:
            self._end(index)
            self._on_end(stream, error)

    def _on_item(self, index: int, item: Any) -> None:
        self._take(index, self._sources[index].events_of(item))

    def _on_stop(self, index: int, details: Any) -> None:
        stop, now_ns, of_stop = details
        self.streams[index].stopped(Stop(stop), now_ns, of_stop)

    def _on_rows(self, index: int, details: Any) -> None:
        unprinted, (arrived_ns, rows) = details
        self.streams[index].took(arrived_ns, rows, unprinted=unprinted)

    def _on_reads(self, index: int, reads: Any) -> None:
        tap = self._sources[index].tap
        if tap is not None:
            tap(Reads._make(reads))

    def _on_lost(self, index: int, details: Any) -> None:
        number, host_ns, offset_ns, worked = details
        failed = self._openings.lost(index, number, host_ns, offset_ns, worked=worked)
        self._round.touch(index, failed.host_ns)
        self._on_port(index, failed)

    def _on_fault(self, index: int, text: str) -> None:
        raise ValueError(text)

    def _on_port(self, index: int, event: Any) -> None:
        self._take(index, self._sources[index].take(event))

    def _take(self, index: int, events: "Sequence[Event] | Any") -> None:
        stream = self.streams[index]
        for event in events:
            stream.take(event)
            if stream.failure is not None:
                break

    def _end(self, index: int) -> None:
        self._going.discard(index)
        self._round.end(index)

    def _finish(self, index: int) -> None:
        stream = self.streams[index]
        now_ns = self._round.now_ns(index)
        self._sources[index].port.overflow_bytes = self._round.overflow_bytes(index)
        self._end(index)
        try:
            stream.finish(now_ns=now_ns)
        except Exception as error:
            self._on_end(stream, error)
        else:
            self._on_end(stream, None)


HANDLERS: dict[int, Callable[[PortLoop, int, Any], None]] = {
    PortStop.ITEM: PortLoop._on_item,
    PortStop.STOP: PortLoop._on_stop,
    PortStop.ROWS: PortLoop._on_rows,
    PortStop.READS: PortLoop._on_reads,
    PortStop.LOST: PortLoop._on_lost,
    PortStop.FAULT: PortLoop._on_fault,
}
"""Methods that handle the events of ports, by the kind of the event."""
