"""Turns what came over a wire into events, and watches over the line.

It does not know where the bytes come from: a port (`fltea.sources.serial`) or a recording of one.
"""

from collections import Counter
from collections.abc import Iterator
from typing import NamedTuple

import msgspec
import numpy as np

from fltea.records.clock import SECOND_NS
from fltea.records.events import (
    Chunk,
    Event,
    Failed,
    Ints,
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
from fltea.wire.block_reader import BlockReader, Located, SampleColumns
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
from fltea.wire.messages import BadFrame, Frame, Refused
from fltea.wire.ports import TICK_S
from fltea.wire.sensors import NO_SENSOR, RELATIVES, SENSORS, sensor_name

SILENCE_S = 5.0
"""A device that says nothing, or nothing that can be read, for this long is reported."""

LIMIT_NS = int(SILENCE_S * 1e9)
STALL_NS = 2 * SECOND_NS
"""If the program itself was held up for this long, by whatever, silence proves nothing."""

TICK_NS = int(TICK_S * 1e9)
MOST_TICKS = 120
"""Of one silence, which in a recording may be one of days."""


class Hints(NamedTuple):
    """Advice for a device that says nothing, or nothing that can be read."""

    silent: str
    unreadable: str


OF_A_PORT = Hints(
    "Is the firmware flashed, and is this the programming port (the one beside the power socket)?",
    "The baud rate is wrong, or the device does not run the firmware of fltea.",
)


class WireEvents:
    """Turns transport events into events; every failure is a `Trouble`.

    url: what the texts call the port. hints: what to do about bytes without frames, and about none.
    `unix_offset_ns` is that of the last transport event.
    """

    def __init__(self, url: str, hints: "Hints | None" = None) -> None:
        self.url = url
        self._hints = hints or OF_A_PORT
        self._source = f"serial:{url}" if hints is None else url
        self.unix_offset_ns = 0
        self._before_ns: int | None = None
        self._last_ns: int | None = None
        self._frames = BlockReader()
        self._counts: Counter[str] = Counter()
        self._bytes = 0
        self._connected = False
        self._refused = False
        self._heard_hello = False
        self._said: tuple[wire.Hello, Hello] | None = None  # devices say the same once a second
        self._opened_ns = self._byte_ns = 0
        self._unread_since_ns: int | None = None
        self._unread_bytes = 0
        self._reported: tuple[str, int] | None = None
        self._sensor: tuple[int, int] | None = None
        self._reported_sensors = {NO_SENSOR}
        self._reported_faults = OnceAMinute()
        self._connections = 0
        self._refused_frames = 0

    def feed(self, item: TransportEvent | Reads | None, now_ns: int) -> Iterator[Event]:
        """Yield the events of one transport event, or of many reads; None says that nothing came for a while.

        What comes of many is what came of each alone, with ticks where nothing came, as of a silent line.
        now_ns: the monotonic clock as of now; in a recording, that of the event, or of its first read.
        """
        if isinstance(item, Reads) and self._is_ordinary(item, now_ns):
            return self._on_near(item)
        return self._feed(item, now_ns)

    def _is_ordinary(self, reads: Reads, now_ns: int) -> bool:
        """Return whether these reads came close together, in one second, and soon after what was before."""
        times_ns = reads.host_ns.tolist()
        first_ns, last_ns = times_ns[0], times_ns[-1]
        return (
            self._last_ns is not None
            and self._before_ns is not None
            and now_ns - self._before_ns <= STALL_NS
            and first_ns - self._last_ns <= TICK_NS
            and last_ns - first_ns <= TICK_NS
            and first_ns // SECOND_NS == last_ns // SECOND_NS
            and self._is_settled(last_ns)
        )

    def _feed(self, item: TransportEvent | Reads | None, now_ns: int) -> Iterator[Event]:
        if self._before_ns is not None and now_ns - self._before_ns > STALL_NS:
            self.forgive(now_ns)
        match item:
            case None if self._last_ns is None or now_ns - self._last_ns < TICK_NS:
                yield from self._tick(now_ns)
            case None:
                yield from self.pass_time(now_ns + 1)
            case Reads():
                yield from self._on_reads(item)
            case Chunk():
                yield from self._on_near(Reads.of(item))
            case _:
                yield from self._on_port(item)

    def pass_time(self, until_ns: int) -> Iterator[Event]:
        """Yield what a line that says nothing gives before a moment."""
        if (last_ns := self._last_ns) is not None:
            for k in range(1, min(MOST_TICKS, (until_ns - last_ns - 1) // TICK_NS) + 1):
                yield from self._tick(last_ns + k * TICK_NS)

    def forgive(self, now_ns: int) -> None:
        """Begin all waiting again: the port was just opened, or we ourselves were not listening."""
        self._opened_ns = self._byte_ns = now_ns
        self._unread_since_ns = self._last_ns = None

    def resume(self, now_ns: int) -> None:
        """Take note of when the program came back, to tell a stall of its own from a silence."""
        self._before_ns = now_ns

    def link_stats(self, overflow_bytes: int = 0) -> LinkStats:
        """Count what was handed on, and what was lost on the way."""
        counts = dict(self._counts)
        return LinkStats(
            bytes=self._bytes,
            frames=counts.pop("frames", 0),
            unknown_type=counts.pop("unknown_type", 0),
            refused=self._refused_frames,
            bad_frames={reason: n for reason, n in counts.items() if n},
            overflow_bytes=overflow_bytes,
            reconnects=max(0, self._connections - 1),
        )

    def _tick(self, now_ns: int) -> Iterator[Event]:
        self._last_ns = now_ns
        yield Tick(now_ns)
        yield from self._watch(now_ns)

    def _on_port(self, item: Opened | Failed) -> Iterator[Event]:
        host_ns = item.host_ns
        self.unix_offset_ns = item.unix_offset_ns
        if isinstance(item, Opened):
            self._connected, self._refused, self._heard_hello = True, False, False
            self._connections += 1
            self.forgive(host_ns)
            self._frames.reset()
        else:
            self._connected = False
            yield LinkDown(host_ns)
            yield from self._report(Trouble(item.kind, item.message, host_ns))
        self._last_ns = host_ns
        yield from self._watch(host_ns)

    def _on_reads(self, reads: Reads) -> Iterator[Event]:
        """Yield the events of reads: with ticks between those far apart, and all of one second at once."""
        host_ns = reads.host_ns
        breaks = (np.diff(host_ns) > TICK_NS) | (np.diff(host_ns // SECOND_NS) != 0)
        begins = [0, *(np.flatnonzero(breaks) + 1).tolist()]
        for begin, end in zip(begins, [*begins[1:], len(host_ns)], strict=True):
            yield from self.pass_time(int(host_ns[begin]))
            if self._is_settled(int(host_ns[end - 1])):
                yield from self._on_near(reads if len(begins) == 1 else reads.rows(begin, end))
            else:
                for at in range(begin, end):
                    yield from self._on_near(reads.rows(at, at + 1))

    def _is_settled(self, until_ns: int) -> bool:
        """Return whether the line is open and a device known: then no trouble is due within a second."""
        unread_since_ns = until_ns if self._unread_since_ns is None else self._unread_since_ns
        known = self._connected and self._heard_hello and not self._refused
        return known and until_ns - unread_since_ns < LIMIT_NS - SECOND_NS

    def _on_near(self, reads: Reads) -> Iterator[Event]:
        """Yield the events of one read, or of several before whose last no trouble is due."""
        first_ns, last_ns = int(reads.host_ns[0]), int(reads.host_ns[-1])
        self._heard(first_ns, len(reads.data))
        self._byte_ns = self._last_ns = last_ns
        before = self._frames.bytes_in
        for item in self._frames.feed(reads.data):
            if not isinstance(item, SampleColumns):
                yield from self._on_other(item, reads)
                self._bytes = before + item.end
            elif self._refused:
                self._refused_frames += len(item.end)
                self._count(item, reads, before)
            else:
                yield from self._blocks(item, reads)
                self._count(item, reads, before)
        self.unix_offset_ns = int(reads.unix_offset_ns[-1])
        yield from self._watch(last_ns)

    def _heard(self, host_ns: int, size_bytes: int) -> None:
        if self._unread_since_ns is None or host_ns - self._byte_ns >= LIMIT_NS:
            self._unread_since_ns, self._unread_bytes = host_ns, 0
        self._unread_bytes += size_bytes

    def _on_other(self, located: Located, reads: Reads) -> Iterator[Event]:
        """Yield the events of what is no sample. It is counted behind them, as all that is handed on."""
        item, end = located
        at = int(np.searchsorted(reads.end, end))
        self.unix_offset_ns = int(reads.unix_offset_ns[at])
        if isinstance(item, BadFrame):
            self._counts[item.reason] += 1
        else:
            yield from self._on_frame(item, int(reads.host_ns[at]))
            self._counts["frames"] += isinstance(item, Frame)
            self._readable(end, reads)

    def _blocks(self, columns: SampleColumns, reads: Reads) -> Iterator[RawBlock]:
        """Yield blocks of samples; one that does not follow on those before it may begin an epoch."""
        sequence, device_us, gyro, accel, temperature, flags, end = columns
        n, (host_ns, offset_ns) = len(end), _times(reads, end)
        raw = RawBlock(sequence, device_us, host_ns, gyro, accel, temperature, flags)
        breaks = ((sequence[1:] - sequence[:-1] != 1).nonzero()[0] + 1).tolist() if n > 1 else []
        for begin, stop in zip([0, *breaks], [*breaks, n], strict=True):
            self.unix_offset_ns = int(offset_ns[begin])
            yield raw if stop - begin == n else raw.rows(begin, stop)

    def _count(self, columns: SampleColumns, reads: Reads, before: int) -> None:
        """Count samples that were handed on, so that the counts do not depend on how the bytes were read."""
        end = int(columns.end[-1])
        self._counts["frames"] += len(columns.end)
        self._bytes = before + end
        self._readable(end, reads)

    def _readable(self, end: int, reads: Reads) -> None:
        """Take note of a good frame: what came in later reads is not read yet."""
        if len(reads.end) == 1 or end > int(reads.end[-2]):
            self._unread_since_ns = None
        else:
            last = int(reads.end.searchsorted(end))
            self._unread_since_ns = int(reads.host_ns[last + 1])
            self._unread_bytes = int(reads.end[-1] - reads.end[last])

    def _on_frame(self, frame: Frame | Refused, host_ns: int) -> Iterator[Event]:
        if isinstance(frame, Refused):
            self._refused = True
            self._refused_frames += 1
            yield LinkDown(host_ns)
            text = f"{self.url}: {frame.message}. Flash the firmware that belongs to this program."
            yield from self._report(Trouble("version", text, host_ns))
            return
        if self._refused and not isinstance(frame.message, wire.Hello):
            self._refused_frames += 1
            return
        match frame.message:
            case wire.Hello() as hello if problem := hello_problem(hello):
                self._refused = True
                yield LinkDown(host_ns)
                yield from self._report(Trouble("bad_hello", f"{self.url}: {problem}", host_ns))
            case wire.Hello() as hello:
                self._refused, self._heard_hello, self._reported = False, True, None
                if self._said is None or self._said[0] != hello:
                    self._said = hello, hello_event(hello, self._source, host_ns)
                yield msgspec.structs.replace(self._said[1], host_ns=host_ns)
                yield from self._on_sensor(hello, host_ns)
            case wire.Status() as s:
                yield status_event(s)
            case wire.Estimate() as e:
                yield axis_event(e, frame.sequence, host_ns)
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
        """Report once what is peculiar about a chip; after a new start of the sensor its faults are news."""
        sensor, who = (hello.boot_id, hello.sensor_starts), hello.who_am_i
        if sensor != self._sensor:
            self._sensor = sensor
            self._reported_faults.forget()
        if who in self._reported_sensors:
            return
        self._reported_sensors.add(who)
        if who in RELATIVES:
            text = f"the sensor is no MPU-9250 but {sensor_name(who)}, {RELATIVES[who]}"
            yield Trouble("sensor_relative", f"{self.url}: {text}", host_ns, fatal=False)
        elif who not in SENSORS:
            text = (
                f"{sensor_name(who)}: no MPU-9250, and none of its known relatives. Do not trust its scales; "
                "another sensor, or a bad contact on SDA?"
            )
            yield Trouble("sensor_unknown", f"{self.url}: {text}", host_ns, fatal=False)

    def _watch(self, now_ns: int) -> Iterator[Trouble]:
        if not self._connected:
            return
        waits_for_hello = self._unread_since_ns is None and not (self._heard_hello or self._refused)
        if now_ns - self._byte_ns >= LIMIT_NS:
            text = f"{self.url} is open but has said nothing for {SILENCE_S:g} s. {self._hints.silent}"
            yield from self._report(Trouble("silent", text, now_ns))
        elif self._unread_since_ns is not None and now_ns - self._unread_since_ns >= LIMIT_NS:
            text = (
                f"{self.url}: {self._unread_bytes} bytes in {SILENCE_S:g} s, and no valid frame among them. "
                f"{self._hints.unreadable}"
            )
            yield from self._report(Trouble("no_valid_frame", text, now_ns))
        elif waits_for_hello and now_ns - self._opened_ns >= LIMIT_NS:
            text = f"{self.url}: valid frames, but no HELLO in {SILENCE_S:g} s; samples cannot be scaled."
            yield from self._report(Trouble("no_hello", text, now_ns))

    def _report(self, trouble: Trouble) -> Iterator[Trouble]:
        """Pass a trouble on unless it is the one that was reported last."""
        last = self._reported
        news = last is None or last[0] != trouble.kind or trouble.host_ns - last[1] > REPEAT_NS
        if news:
            self._reported = (trouble.kind, trouble.host_ns)
            yield trouble


def hello_problem(hello: wire.Hello) -> str | None:
    """Return why samples after this HELLO could not be used; None if they can."""
    if not hello.sample_rate or not hello.gyro_lsb:
        return (
            f"its HELLO states a rate of {hello.sample_rate} mHz and {hello.gyro_lsb} tenths of an LSB per "
            "deg/s; neither can be 0. The firmware's settings are wrong."
        )
    return None


def _times(reads: Reads, ends: Ints) -> tuple[Ints, Ints]:
    """Return host_ns and unix_offset_ns of the reads in which each of the ends stands."""
    if (
        ends.tolist() == reads.end.tolist()
    ):  # as live, where each frame comes by itself; searching takes longer
        return reads.host_ns, reads.unix_offset_ns
    at = reads.end.searchsorted(ends)
    return reads.host_ns[at], reads.unix_offset_ns[at]
