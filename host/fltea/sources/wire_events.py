"""Turns the bytes that a device sent into events.

This module also watches whether the device falls silent or reports faults.

The bytes may come from a port (`fltea.sources.serial`), from messages of a broker, or from a recording. Bytes
from each of these are treated in the same way.
"""

from collections.abc import Iterator
from typing import Any, NamedTuple

import msgspec

from fltea._native import PortDecoder
from fltea.records.events import (
    Chunk,
    Event,
    Failed,
    LinkDown,
    Opened,
    RawBlock,
    Reads,
    Tick,
    TransportEvent,
    Trouble,
)
from fltea.records.records import Hello
from fltea.records.repeat import REPEAT_NS, OnceAMinute
from fltea.records.stats import LinkStats
from fltea.wire import layout as wire
from fltea.wire.faults import fault_text
from fltea.wire.message_events import (
    axis_event,
    bins_event,
    estimator_event,
    fit_event,
    hello_event,
    name_of,
    status_event,
)
from fltea.wire.messages import VERSION, Refused
from fltea.wire.ports import TICK_NS
from fltea.wire.sensors import NO_SENSOR, SENSORS, relative_text, sensor_name

SILENCE_S = 5.0
"""If no bytes, no valid frames or no HELLO came for this time, a trouble is reported [s]."""

LIMIT_NS = int(SILENCE_S * 1e9)


class Hints(NamedTuple):
    """Advice for the user.

    `silent`: advice if a device sends nothing. `unreadable`: advice if nothing that it sends can be read.
    `nothing`: says of the source that nothing came for a while, which the text after it names.
    """

    silent: str
    unreadable: str
    nothing: str = "is open but has said nothing for"


OF_A_PORT = Hints(
    "Is the firmware flashed, and is this the programming port (the one beside the power socket)?",
    "The baud rate is wrong, or the device does not run the firmware of fltea.",
)


class WireEvents:
    """Turns transport events into events.

    Transport events are bytes, and notes that the port was opened or failed.

    Each failure of the port or the device becomes a `Trouble`.

    `url`: name of the port in messages. `hints`: advice for the user if no bytes or no valid frames arrive.
    """

    def __init__(self, url: str, hints: "Hints | None" = None) -> None:
        self.url = url
        self._hints = hints or OF_A_PORT
        self._source = f"serial:{url}" if hints is None else url
        self.decoder = PortDecoder(LIMIT_NS, TICK_NS, REPEAT_NS)
        # the last accepted HELLO, which is yielded again when the device repeats it
        self._said: Hello | None = None
        self._sensor: tuple[int, int] | None = None
        self._reported_sensors = {NO_SENSOR}
        self._reported_faults = OnceAMinute()

    @property
    def unix_offset_ns(self) -> int:
        """Offset from the monotonic clock to Unix time at the last transport event [ns]."""
        return self.decoder.unix_offset_ns

    @unix_offset_ns.setter
    def unix_offset_ns(self, offset_ns: int) -> None:
        self.decoder.unix_offset_ns = offset_ns

    def feed(self, item: TransportEvent | Reads | None, now_ns: int) -> Iterator[Event]:
        """Yield the events (such as a HELLO or samples) that follow from what came from the port.

        `item` is one of the following:
            one event of the transport: bytes, or a note that the port was opened or failed
            `Reads`, the bytes of many reads: they give the same events as if they were passed one by one,
                with a
                `Tick` for each pause between them
            None: nothing came for a while

        `now_ns`: present time of the monotonic clock [ns]. For a recording, it is the recorded time of the
        event or of the first read.
        """
        match item:
            case Reads():
                self.decoder.feed(*item, now_ns)
            case Chunk():
                self.decoder.feed_one(*item, now_ns)
            case None:
                self.decoder.silent(now_ns)
            case Opened():
                self.decoder.opened(*item)
            case Failed(kind, message, host_ns, offset_ns):
                is_news = self.decoder.failed(kind, host_ns, offset_ns)
                yield LinkDown(host_ns)
                if is_news:
                    yield Trouble(kind, message, host_ns)
        yield from self._items()

    def pass_time(self, until_ns: int) -> Iterator[Event]:
        """Yield the events that are due up to `until_ns` if the port has been silent until then."""
        self.decoder.pass_time(until_ns)
        yield from self._items()

    def forgive(self, now_ns: int) -> None:
        """Restart all timeouts, since the program could not listen to the device for a while."""
        self.decoder.forgive(now_ns)

    def resume(self, now_ns: int) -> None:
        """Note that the program continues now. Its own pause must not be taken for a silent device."""
        self.decoder.resume(now_ns)

    def link_stats(self, overflow_bytes: int = 0) -> LinkStats:
        """Return the counts of bytes and frames that arrived, and that were lost on the way."""
        size_bytes, frames, refused, connections, bad = self.decoder.counts()
        return LinkStats(
            bytes=size_bytes,
            frames=frames,
            unknown_type=bad.pop("unknown_type", 0),
            refused=refused,
            bad_frames=bad,
            overflow_bytes=overflow_bytes,
            reconnects=max(0, connections - 1),
        )

    def _items(self) -> Iterator[Event]:
        """Yield the events of all items that wait in the native decoder."""
        while (item := self.decoder.next()) is not None:
            yield from self.events_of(item)

    def events_of(self, item: tuple[Any, ...]) -> Iterator[Event]:
        """Yield the events of one item from `decoder`.

        Consume the events before you ask the decoder for the next item.
        """
        match item:
            case "samples", columns:
                yield RawBlock._make(columns)
            case "same_hello", host_ns if self._said is not None:
                yield msgspec.structs.replace(self._said, host_ns=host_ns)
            case "frame", host_ns, type, sequence, _, payload:
                yield from self._on_message(wire.MESSAGES[type].unpack(payload), sequence, host_ns)
            case "refused_version", host_ns, payload, is_news:
                yield LinkDown(host_ns)
                if is_news:
                    said = Refused(*VERSION.unpack_from(payload)).message
                    text = f"{self.url}: {said}. Flash the firmware that belongs to this program."
                    yield Trouble("version", text, host_ns)
            case "tick", host_ns:
                yield Tick(host_ns)
            case "trouble", host_ns, kind, unread_bytes:
                yield Trouble(*self._explain(kind, unread_bytes), host_ns)

    def _on_message(self, message: wire.Message, sequence: int, host_ns: int) -> Iterator[Event]:
        match message:
            case wire.Hello() as hello if problem := hello_problem(hello):
                is_news = self.decoder.refuse_hello()
                yield LinkDown(host_ns)
                if is_news:
                    yield Trouble("bad_hello", f"{self.url}: {problem}", host_ns)
            case wire.Hello() as hello:
                self.decoder.accept_hello()
                self._said = hello_event(hello, self._source, host_ns)
                yield self._said
                yield from self._on_sensor(hello, host_ns)
            case wire.Status() as s:
                yield status_event(s)
            case wire.Estimate() as e:
                yield axis_event(e, sequence, host_ns)
            case wire.Estimator() as e:
                yield estimator_event(e, host_ns)
            case wire.Fit() as fit:
                yield fit_event(fit, host_ns)
            case wire.Spectrum() as spectrum:
                yield bins_event(spectrum, host_ns)
            case wire.Fault(code, detail):
                if self._reported_faults.is_due(code, host_ns):
                    text = f"the device reports {name_of(wire.FaultCode, code)}: {fault_text(code, detail)}"
                    yield Trouble("device_fault", f"{self.url}: {text}", host_ns, fatal=False)

    def _on_sensor(self, hello: wire.Hello, host_ns: int) -> Iterator[Trouble]:
        """Report an unusual chip once.

        After a restart of the sensor, let the sensor's faults be reported again.
        """
        sensor, who = (hello.boot_id, hello.sensor_starts), hello.who_am_i
        if sensor != self._sensor:
            self._sensor = sensor
            self._reported_faults.forget()
        if who in self._reported_sensors:
            return
        self._reported_sensors.add(who)
        if text := relative_text(who):
            yield Trouble("sensor_relative", f"{self.url}: {text}", host_ns, fatal=False)
        elif who not in SENSORS:
            text = (
                f"{sensor_name(who)}: no MPU-9250, and none of its known relatives. Do not trust its scales; "
                "another sensor, or a bad contact on SDA?"
            )
            yield Trouble("sensor_unknown", f"{self.url}: {text}", host_ns, fatal=False)

    def _explain(self, kind: str, unread_bytes: int) -> tuple[str, str]:
        """Return kind and text of the trouble that the bytes of the last few seconds show."""
        if kind == "silent":
            text = f"{self.url} {self._hints.nothing} {SILENCE_S:g} s. {self._hints.silent}"
            return "silent", text
        if kind == "no_valid_frame":
            said = f"{unread_bytes} bytes in {SILENCE_S:g} s, and no valid frame among them."
            return "no_valid_frame", f"{self.url}: {said} {self._hints.unreadable}"
        text = f"{self.url}: valid frames, but no HELLO in {SILENCE_S:g} s; samples cannot be scaled."
        return "no_hello", text


def hello_problem(hello: wire.Hello) -> str | None:
    """Return the reason why samples after this HELLO cannot be used. Return None if they can be used."""
    if not hello.sample_rate or not hello.gyro_lsb:
        return (
            f"its HELLO states a rate of {hello.sample_rate} mHz and {hello.gyro_lsb} tenths of an LSB per "
            "deg/s; neither can be 0. The firmware's settings are wrong."
        )
    return None
