"""`fltea record`: writes the data of a source to MCAP files without estimating anything."""

import sys
from collections.abc import Iterator
from pathlib import Path

import msgspec

from fltea.process.date_watch import DateWatch
from fltea.process.stop_on_signal import StopOnSignal
from fltea.records import clock
from fltea.records.block import Block
from fltea.records.errors import FlteaError
from fltea.records.events import Event, Trouble
from fltea.records.ports import Source
from fltea.records.records import AnyRecord, Error, Gap, Hello
from fltea.records.visible import visible_lines
from fltea.settings.config import Config
from fltea.settings.sources import is_shared
from fltea.sinks.record import RecordSink
from fltea.sources.as_wire import AsWire
from fltea.sources.open_source import check_recordable, check_shared, open_source
from fltea.sources.serial import SerialSource
from fltea.stream.decode import Decoder

STATUS_NS = 10**9
STATUS_QUIET_NS = 60 * 10**9
"""Time between two status lines if stderr is no terminal [ns].

On a terminal, each line replaces the last one.
"""


def record(config: Config, seconds: float | None) -> str:
    """Record until the source ends, a signal arrives or the time is over; return a summary.

    Raises:
        UsageError: the source or the folder is wrong, or the source cannot be recorded.
        FlteaError: not everything could be written, or nothing arrived that could be.
    """
    with StopOnSignal() as stop:
        if is_shared(config.source):
            check_shared([config])
        source = open_source(config)
        check_recordable(config, source)
        run = _Recorder(source, config)
        stop.armed = True
        end_ns = None if seconds is None else clock.host_ns() + int(seconds * 1e9)
        try:
            for event in source.events():
                run.take(event)
                if stop.asked or (end_ns is not None and clock.host_ns() >= end_ns):
                    break
        finally:
            source.close()
            run.close()
        if run.lost:
            raise FlteaError(run.summary())
        if run.is_empty:
            raise FlteaError(f"{run.summary()}. Nothing arrived{run.why}.")
        return run.summary()


class _Recorder:
    """Writes a recording to the sink: the raw bytes, and the decoded records for the JSON channels."""

    def __init__(self, source: Source, config: Config) -> None:
        self._source, self._name = source, config.name or "device"
        self._sink = RecordSink(config.record.for_devices(1), self._name, self._report)
        self._decoder = Decoder(lambda: source.unix_offset_ns, config.link.max_gap, self._name)
        self._as_wire: AsWire | None = None
        self._trouble: Trouble | None = None
        if isinstance(source, SerialSource):
            source.tap = self._sink.write
        else:
            self._as_wire = AsWire(lambda: source.unix_offset_ns)
        self._folder = Path(config.record.folder or ".")
        self._live = sys.stderr.isatty()
        self._date = DateWatch(self._report)
        self._date.check()
        self._status_ns = clock.host_ns()

    def take(self, event: Event) -> None:
        """Record one event; its raw bytes are written first, unless the source wrote these bytes already."""
        if self._as_wire is not None:
            for item in self._as_wire.encode(event):
                self._sink.write(item)
        for record in self._records(event):
            self._sink.write(record)
        self._sink.flush()
        now_ns = clock.host_ns()
        if now_ns - self._status_ns >= (STATUS_NS if self._live else STATUS_QUIET_NS):
            self._status_ns = now_ns
            self._date.check()
            self._say(self.summary(), passing=True)

    @property
    def lost(self) -> int:
        """Number of items (raw reads, records …) that no file holds, plus the number of lost bytes.

        Bytes from the port are lost when the program is too slow, for instance because of a slow disk.
        """
        return self._sink.lost + self._source.link_stats().overflow_bytes

    @property
    def is_empty(self) -> bool:
        """Whether not even a byte arrived."""
        return not (self._decoder.counts.delivered or self._source.link_stats().bytes)

    @property
    def why(self) -> str:
        """The last trouble of the source, as the end of a sentence; "" if there was none."""
        return "" if self._trouble is None else f": {self._trouble.message.removesuffix('.')}"

    def close(self) -> None:
        """Finish the file."""
        self._sink.close()
        if self._live:
            self._say("")

    def summary(self) -> str:
        """Return a line of text that says how much was recorded and how much is missing."""
        count, rate_hz = self._decoder.counts, self._decoder.native.rate_hz
        at = "" if rate_hz is None else f" at {rate_hz:.2f} Hz"
        lost = f"{count.lost} lost in {count.gaps} gaps"
        stopped = f", {self._sink.lost} items NOT recorded" if self._sink.lost else ""
        if unread := self._source.link_stats().overflow_bytes:
            stopped += f", {unread} bytes thrown away while the disk was too slow"
        return (
            f"{self._name}: {count.delivered} samples{at}, {lost}; "
            f"{self._sink.parts} file{'' if self._sink.parts == 1 else 's'} in {self._folder}{stopped}"
        )

    def _records(self, event: Event) -> Iterator[AnyRecord | Block]:
        if isinstance(event, Trouble):
            self._trouble = event
            self._say(f"{event.kind}: {event.message}")
            unix_ns = event.host_ns + self._source.unix_offset_ns
            yield Error(event.kind, event.message, unix_ns, device=self._name)
        for found in self._decoder.feed(event):
            if isinstance(found, Hello):
                unix_ns = found.host_ns + self._source.unix_offset_ns
                yield msgspec.structs.replace(found, host_ns=unix_ns, device=self._name)
                continue
            block, missing = found.block, found.missing
            if missing:
                first, first_ns = int(block.seq[0]), int(block.host_ns[0])
                yield Gap(first - missing, missing, block.epoch, first_ns, device=self._name)
            yield block

    def _report(self, kind: str, message: str) -> None:
        self._say(f"{kind}: {message}")

    def _say(self, text: str, passing: bool = False) -> None:
        """Write a line to stderr. If `passing` is true, the next line replaces this line on a terminal."""
        text = visible_lines(text)
        if self._live:
            sys.stderr.write(f"\r\x1b[K{text}" + ("" if passing or not text else "\n"))
        else:
            sys.stderr.write(f"fltea: {text}\n")
        sys.stderr.flush()
