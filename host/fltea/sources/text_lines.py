"""Samples as lines of text, live: `stdin:`, `stdin:FIFO` and `serial-text:PORT?baud=115200`.

CSV with or without a header, or NDJSON; the settings of `--columns` and so on say which columns are meant.
What has arrived goes on at once, as one block.
"""

import contextlib
import os
import select
import stat
from collections.abc import Iterator
from itertools import pairwise
from urllib.parse import parse_qsl

import numpy as np

from fltea.recording.files import TIME_COLUMN
from fltea.recording.session import HIGHEST_RATE_HZ, LOWEST_RATE_HZ
from fltea.records import clock
from fltea.records.errors import UsageError
from fltea.records.events import (
    SEQUENCE_WRAP,
    TIME_WRAP_US,
    Chunk,
    Event,
    Failed,
    LinkDown,
    Opened,
    RawBlock,
    Tick,
    TransportEvent,
    Trouble,
)
from fltea.records.records import Hello, LinkStats
from fltea.records.repeat import OnceAMinute
from fltea.settings.how import How
from fltea.sources.numbering import UNIT_US, ArrivalWatch, ByOrder, ByTime, Numbered, Rows
from fltea.sources.text_rows import REASONS, LineRows, wanted
from fltea.wire.ports import TICK_S
from fltea.wire.transport import Port, Reader

DEFAULT_BAUD = 115_200
"""What most boards' example programs speak."""

READ_BYTES = 1 << 16
LONGEST_BLOCK_US = TIME_WRAP_US // 4
"""Of slow samples a read may hold hours; within a block times must not wrap."""

PATIENCE_NS = 5 * 10**9
ENDINGS = {"_s": "s", "_ms": "ms", "_us": "us", "_ns": "ns"}


class TextEvents:
    """Judges what comes as text. url: for messages. how: what the user says of the columns and times.

    Raises:
        UsageError: the settings do not say how the samples are timed, or are wrong.
    """

    def __init__(self, url: str, how: How, *, fatal: bool) -> None:
        self.url, self._fatal = url, fatal
        time = how.time_column or (None if how.rate_hz else TIME_COLUMN)
        self._wanted = wanted(how.columns, how.units, time)
        if how.rate_hz is not None and not LOWEST_RATE_HZ <= how.rate_hz <= HIGHEST_RATE_HZ:
            raise UsageError(f"--rate {how.rate_hz:g}: no gyroscope gives so many samples a second.")
        self._numbers: ByOrder | ByTime
        self._watch: ArrivalWatch | None = None
        if time is None:
            assert how.rate_hz is not None
            self._numbers, self._watch = ByOrder(how.rate_hz), ArrivalWatch(url, how.rate_hz)
        else:
            self._numbers = ByTime(_unit(time, how.time_unit), how.rate_hz)
        self.rows = LineRows(self._wanted)
        self._told = OnceAMinute()
        self._boot = int.from_bytes(os.urandom(4), "big")
        self._samples = self._bytes = self._connections = 0
        self._heard_ns: int | None = None
        self._hello_due = self._told_uneven = False
        self._lines_told = self._headers = 0

    def open(self, now_ns: int, *, within_line: bool) -> None:
        """The line is open. within_line: its first bytes may be the end of a line."""
        self._connections += 1
        self._hello_due = True
        self._heard_ns = now_ns
        self.rows.resume(within_line=within_line)
        self._numbers.begin()

    def lost(self, failed: Failed) -> Iterator[Event]:
        """The line was lost, or cannot be opened."""
        self._heard_ns = None
        yield LinkDown(failed.host_ns)
        yield from self._tell(failed.kind, failed.kind, failed.message, failed.host_ns, fatal=self._fatal)

    def feed(self, data: bytes, now_ns: int) -> Iterator[Event]:
        """Yield what bytes lead to."""
        self._bytes += len(data)
        self._heard_ns = now_ns
        yield from self._take(self.rows.feed(data), now_ns)
        yield from self._tell_lines(now_ns)

    def tick(self, now_ns: int) -> Iterator[Event]:
        """Nothing came for a while."""
        yield Tick(now_ns)
        if self._heard_ns is not None and now_ns - self._heard_ns >= PATIENCE_NS:
            text = f"{self.url}: nothing came for {PATIENCE_NS // 10**9} s; does the sender run?"
            yield from self._tell("silent", "silent", text, now_ns, fatal=self._fatal)

    def finish(self, now_ns: int) -> Iterator[Event]:
        """The sender has ended.

        Raises:
            UsageError: nothing that it sent was a sample.
        """
        yield from self._take(self.rows.finish(), now_ns)
        yield from self._block(self._numbers.finish(), now_ns)
        if not self._samples:
            raise UsageError(f"{self.url}: the input has ended, and no sample was in it. {self._why_none()}")
        yield from self._tell_lines(now_ns)

    def link_stats(self, overflow_bytes: int = 0) -> LinkStats:
        """Count what arrived; a frame is a line with a sample, a bad one a line without."""
        bad = dict(self.rows.counts)
        if self._numbers.duplicates:
            bad["duplicate_time"] = self._numbers.duplicates
        if self._numbers.unrated:
            bad["no_rate"] = self._numbers.unrated
        return LinkStats(
            bytes=self._bytes,
            frames=self._samples,
            bad_frames=bad,
            overflow_bytes=overflow_bytes,
            reconnects=max(0, self._connections - 1),
        )

    def _take(self, rows: Rows | None, now_ns: int) -> Iterator[Event]:
        if self.rows.headers > self._headers:
            self._headers = self.rows.headers
            self._numbers.begin()
        if rows is not None and len(rows.values):
            yield from self._block(self._numbers.add(rows, now_ns), now_ns)

    def _block(self, pieces: Iterator[Numbered], now_ns: int) -> Iterator[Event]:
        for piece in pieces:
            begins, sequence, device_us, gyro, host_ns = piece
            if begins:
                self._boot = (self._boot + 1) % (1 << 32)
            if begins or self._hello_due:
                self._hello_due = False
                yield self._hello(now_ns)
                if self._watch is not None:
                    self._watch.begin()
            self._samples += len(sequence)
            raw = RawBlock(sequence % SEQUENCE_WRAP, device_us % TIME_WRAP_US, host_ns, gyro)
            parts = np.flatnonzero(np.diff(device_us // LONGEST_BLOCK_US)) + 1
            for begin, end in pairwise([0, *parts.tolist(), len(sequence)]):
                yield raw.rows(begin, end)
            found = self._watch.add(int(device_us[-1]), now_ns) if self._watch is not None else None
            if found is not None:
                yield found
        if self._numbers.unrated and self._numbers.rate_hz is None:
            text = (
                f"{self.url}: {self._numbers.unrated} samples are left out: the column '{self._wanted.time}' "
                "tells no rate of a gyroscope. Is its unit right (--time-unit)? Or give the rate: --rate 100."
            )
            yield from self._tell("no_rate", "no_rate", text, now_ns, fatal=self._fatal)
        elif self._numbers.uneven and not self._told_uneven:
            self._told_uneven = True
            text = (
                f"{self.url}: the steps of the column '{self._wanted.time}' are too uneven for a device's "
                "clock, so gaps may be seen where none are. If these are times of arrival, give the rate "
                "instead: --rate 100."
            )
            yield Trouble("uneven_times", text, now_ns, fatal=False)

    def _hello(self, now_ns: int) -> Hello:
        assert self._numbers.rate_hz is not None
        return Hello(
            source=self.url,
            host_ns=now_ns,
            rate_hz=self._numbers.rate_hz,
            sampling_mode="text",
            boot_id=self._boot,
            gyro_lsb_per_dps=self._wanted.lsb,
        )

    def _tell_lines(self, now_ns: int) -> Iterator[Trouble]:
        """Tell of lines without a sample: those before the columns are known only where none follow."""
        total = self.rows.counts.total() - self.rows.counts["before_header"]
        newest = self.rows.newest
        if total > self._lines_told and newest is not None and self._told.is_due("lines", now_ns):
            self._lines_told = total
            reason, line = newest
            text = (
                f"{self.url}: {total} lines hold no sample and are left out; the newest {REASONS[reason]}: "
            )
            yield Trouble("bad_lines", text + line, now_ns, fatal=False)
        if not self.rows.knows_columns and self.rows.counts["before_header"] >= FEW_LINES:
            text = f"{self.url}: lines come, and none is a sample yet. {self._why_none()}"
            yield from self._tell("no_columns", "no_columns", text, now_ns, fatal=self._fatal)

    def _why_none(self) -> str:
        if not self._bytes:
            return "It was empty."
        if self.rows.knows_columns:
            if isinstance(self._numbers, ByTime) and not self.rows.counts:
                return f"One time in '{self._wanted.time}' tells no rate; give it: --rate 100."
            bad = ", ".join(f"{n} {REASONS[reason]}" for reason, n in self.rows.counts.items())
            return f"Lines left out: {bad or 'none; there are only the names of the columns'}."
        names = ", ".join(self._wanted.columns or ("gyro_x_dps, …",))
        time = "" if self._wanted.time is None else f" and '{self._wanted.time}' (or give --rate 100)"
        newest = f"; the newest line was {self.rows.newest[1]}" if self.rows.newest is not None else ""
        return (
            f"No line names the columns {names}{time}{newest}. Name yours with --columns gx,gy,gz, or, where "
            "there is no header, by their positions: --columns 1,2,3."
        )

    def _tell(self, kind: str, topic: str, text: str, now_ns: int, *, fatal: bool) -> Iterator[Trouble]:
        if self._told.is_due(topic, now_ns):
            yield Trouble(kind, text, now_ns, fatal)


FEW_LINES = 20
"""Messages of a sender before its header; after so many something is wrong."""


def _unit(time: str, given: str | None) -> str:
    """The unit of a column of times, by its name if it is not given."""
    if given is not None:
        return given
    for ending, unit in ENDINGS.items():
        if time.endswith(ending) and unit in UNIT_US:
            return unit
    raise UsageError(
        f"--time-column {time}: its name does not end in _s, _ms, _us or _ns; say what the times are counted "
        "in: --time-unit ms."
    )


class PipeText:
    """Lines from standard input, or from a FIFO or the like: `stdin:`, `stdin:/tmp/fifo`.

    The end of the input ends the source.

    Raises:
        UsageError: wrong settings, or no such file.
    """

    live = False
    prompt = True

    def __init__(self, rest: str, how: How) -> None:
        self._events = TextEvents(f"stdin:{rest}", how, fatal=False)
        self._owned = rest not in ("", "/dev/stdin", "-")
        self._descriptor = 0
        if self._owned:
            try:
                self._descriptor = os.open(rest, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
            except OSError as error:
                raise UsageError(f"stdin:{rest}: cannot be read ({error.strerror}).") from error
        else:
            try:
                os.fstat(0)
            except OSError as error:
                raise UsageError("stdin: this program was started without a standard input.") from error
        self._closed_read, self._closed_write = os.pipe()
        self._closed = False

    @property
    def unix_offset_ns(self) -> int:
        """Nanoseconds from the monotonic clock to Unix time, as of now."""
        return clock.unix_offset_ns()

    def events(self) -> Iterator[Event]:
        """Yield samples until the input ends or `close`."""
        ready = select.poll()
        is_file = stat.S_ISREG(os.fstat(self._descriptor).st_mode)
        ready.register(self._descriptor, select.POLLIN)
        ready.register(self._closed_read, select.POLLIN)
        self._events.open(clock.host_ns(), within_line=False)
        try:
            while not self._closed:
                found = {descriptor for descriptor, _ in ready.poll(TICK_S * 1000)}
                if self._closed:
                    return
                now_ns = clock.host_ns()
                if self._descriptor not in found and not is_file:
                    yield from self._events.tick(now_ns)
                    continue
                try:
                    data = os.read(self._descriptor, READ_BYTES)
                except BlockingIOError:
                    continue
                if not data:
                    yield from self._events.finish(now_ns)
                    return
                yield from self._events.feed(data, now_ns)
        finally:
            if self._owned:
                os.close(self._descriptor)

    def link_stats(self) -> LinkStats:
        """Count what arrived and which lines held no sample."""
        return self._events.link_stats()

    def close(self) -> None:
        """End the iteration."""
        self._closed = True
        with contextlib.suppress(OSError):
            os.write(self._closed_write, b"\0")


class SerialText:
    """Lines from a serial port; one that is lost is opened again.

    Raises:
        UsageError: wrong settings, or no serial port.
    """

    live = prompt = True

    def __init__(self, rest: str, how: How) -> None:
        url, baud = parse_serial(rest)
        self._events = TextEvents(f"serial-text:{rest}", how, fatal=True)
        self._reader = Reader(Port(url, baud))
        self._unix_offset_ns = clock.unix_offset_ns()

    @property
    def unix_offset_ns(self) -> int:
        """Nanoseconds from the monotonic clock to Unix time, as of the last event."""
        return self._unix_offset_ns

    def events(self) -> Iterator[Event]:
        """Yield samples until `close`; a thread of its own reads the port."""
        self._reader.start()
        for item in self._reader.events(TICK_S):
            if item is not None:
                self._unix_offset_ns = item.unix_offset_ns
            yield from self.take(item)

    def take(self, item: TransportEvent | None) -> Iterator[Event]:
        """Yield what something that came from the port leads to; None says that nothing came for a while."""
        match item:
            case None:
                yield from self._events.tick(clock.host_ns())
            case Opened(host_ns, _):
                self._events.open(host_ns, within_line=True)
            case Failed():
                yield from self._events.lost(item)
            case Chunk(data, host_ns, _):
                yield from self._events.feed(data, host_ns)

    def link_stats(self) -> LinkStats:
        """Count what arrived, what was lost on the way, and which lines held no sample."""
        return self._events.link_stats(self._reader.overflow_bytes)

    def close(self) -> None:
        """Stop reading and release the port."""
        self._reader.close()


def parse_serial(rest: str) -> tuple[str, int]:
    """Port and speed, from what stands behind `serial-text:`.

    Raises:
        UsageError: an unknown key, or a speed that is no number.
    """
    url, mark, query = rest.rpartition("?")
    if not mark or "=" not in query:
        return rest, DEFAULT_BAUD
    baud = DEFAULT_BAUD
    for key, value in parse_qsl(query, keep_blank_values=True):
        if key != "baud" or not (value.isascii() and value.isdigit()):
            raise UsageError(
                f"serial-text:{rest}: '{key}={value}' is not known. Give the speed as a number: "
                "'serial-text:/dev/ttyUSB0?baud=115200' (in quotes, for the shell knows '?' too)."
            )
        baud = int(value)
    return url, baud
