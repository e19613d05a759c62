"""Record the bytes from the wire, and the records that the program makes of them, in MCAP files."""

import errno
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import get_args

import msgspec

from fltea.diagnostics.asked import AskedOutput
from fltea.diagnostics.finding import Finding
from fltea.recording.append_only import Meddled
from fltea.recording.schema import encode_message
from fltea.recording.session import OVERFLOW, WIRE_WRAP, LinkMessage
from fltea.records import clock
from fltea.records.block import Block
from fltea.records.events import Chunk, Failed, Opened, Reads
from fltea.records.ports import Item, Printed, Report, Sink, Wanted
from fltea.records.records import AnyRecord, Error, Hello
from fltea.settings.outputs import RecordConfig
from fltea.sinks.json_lines import BlockLines
from fltea.sinks.opening import Opening
from fltea.sinks.record_loss import DELETED, Outage, lost_of, told
from fltea.sinks.record_session import NOTHING, OpenPart, Session, SourceClock, summed
from fltea.sinks.record_space import check_space
from fltea.sources.as_wire import as_stated

FLUSH_NS = 750_000_000
"""Shortest time between two writes of buffered data to the file [ns]. If the program is killed, the data
since the last write are lost: those of at most this time, plus the pause between two calls of `flush`.
"""

RETRY_NS = 5 * 10**9
"""Time between two attempts to begin a new file after the disk failed [ns]."""

REFUSED = ("version", "bad_hello")
"""Kinds of `error` records about a HELLO that cannot be used. After such a HELLO, the device's samples are
not used until its next good HELLO.
"""

NO_ROOM = (errno.ENOSPC, errno.EDQUOT)

KINDS: dict[str, type[AnyRecord]] = {str(kind.__struct_config__.tag): kind for kind in get_args(AnyRecord)}
"""Type of the records in each channel, by the channel's name."""

OF_BLOCKS = {
    "sample": Wanted(samples=True, nulls=False),
    "estimate": Wanted(estimates=True, nulls=False),
    "corrected": Wanted(corrected=True, nulls=False),
}
"""The channels that have one message per sample, by name. The value says which records are made of a block of
samples and written to the channel.
"""


class Channels:
    """The channels of a recording that contain records, by their names.

    `kinds`: for the name of each channel, the type of its records.
    """

    def __init__(self, names: Iterable[str]) -> None:
        self.kinds = {str(name): KINDS[name] for name in names}
        self._names = {kind: name for name, kind in self.kinds.items()}
        self._of_blocks = {name: wanted for name, wanted in OF_BLOCKS.items() if name in self.kinds}
        self._lines = BlockLines()

    def name_of(self, record: AnyRecord) -> str | None:
        """Return the name of a record's channel; None if such records are not recorded."""
        return self._names.get(type(record))

    def lines_of(self, block: Block) -> Iterator[tuple[str, bytes]]:
        """Yield the name of each channel that has records of the block, and these records as JSON lines."""
        for name, wanted in self._of_blocks.items():
            if lines := self._lines.of(block, wanted, block.due_rows):
                yield name, lines


class RecordSink(Sink):
    """Records the session of one device in successive files, in a folder that may hold other files.

    A disk that is full or fails stops the recording, not the program. Items that are not recorded are
    counted. A new file begins when the disk has room again, or at once if another program has removed the
    file.

    `hello`: the last HELLO of the device, if the device is already running. `path`: the newest file.

    Raises:
        UsageError: the folder cannot be made or written to.
    """

    name = "record"
    lossless = True
    takes_wire = together = True
    capacity = 50_000
    rest_s = 0.1

    def __init__(
        self, settings: RecordConfig, device: str, report: Report, hello: Hello | None = None
    ) -> None:
        assert settings.folder is not None
        assert settings.channels is not None  # `RecordConfig.for_devices` has set unset channels
        self.path: Path | None = None
        self.lost = 0
        self._settings, self._report = settings, report
        self._channels = Channels(settings.channels)
        self._session = Session(settings.folder, device, self._channels.kinds)
        self._part: OpenPart | None = None
        self._finished_bytes = 0
        self._clock = SourceClock()
        self._sequence = 0
        self._hello = None if hello is None else as_stated(hello)
        self._outage = Outage()

    @property
    def trouble(self) -> str | None:
        """Reason why nothing is recorded at the moment."""
        return self._outage.trouble

    @property
    def parts(self) -> int:
        """Number of files that have been begun so far."""
        return self._session.parts

    @property
    def size_bytes(self) -> int:
        """Number of bytes written to all files so far. Any thread may read this number."""
        part = self._part
        return self._finished_bytes + (part.writer.size_bytes if part is not None else 0)

    def write(self, item: Item) -> None:
        """Record one item.

        If the file has become too large or too old, the next file begins with the next item from the wire.
        """
        match item:
            case Reads():
                self._on_reads(item)
            case Chunk():
                self._on_reads(Reads.of(item))
            case Opened() | Failed():
                self._on_link(item)
            case Block():
                self._on_block(item)
            case Printed():  # this output gets no `Printed`, since it does not set `prints`
                pass
            case _:
                self._on_record(item)

    def flush(self) -> None:
        """Write buffered data to the file, if the last flush was more than `FLUSH_NS` ago."""
        now_ns = clock.host_ns()
        if self._part is None or now_ns - self._part.flushed_ns < FLUSH_NS:
            return
        try:
            self._part.flush(now_ns)
        except Meddled as error:
            self._stop(error)
            self._begin()  # begin the next file now, not with the next item: a silent device sends none
        except OSError as error:
            self._stop(error)

    def on_overflow(self, count: int) -> None:
        """Record a gap, and forget the device's HELLO, since a newer HELLO may be among the dropped items."""
        self._hello = None
        if self._part is not None:
            self._part.add_gap(LinkMessage("gap", kind=OVERFLOW, items=count), self._clock.log_ns)

    def close(self) -> None:
        """Finish the present file."""
        self._finish()

    def _on_reads(self, reads: Reads) -> None:
        self._come(int(reads.host_ns[0]), int(reads.unix_offset_ns[0]))
        count = len(reads.end)
        if self._part is None or self._clock.offset_ns is None:
            self._lose(count, len(reads.data), chunks=count)
        else:
            self._part.add_reads(reads, self._clock.offset_ns, self._sequence)
        self._sequence = (self._sequence + count) % WIRE_WRAP
        self._clock.now_ns = int(reads.host_ns[-1])

    def _on_link(self, item: Opened | Failed) -> None:
        self._come(item.host_ns, item.unix_offset_ns)
        message = LinkMessage("opened")
        if isinstance(item, Failed):
            message = LinkMessage("failed", kind=item.kind, message=item.message)
            self._hello = None
        if self._part is None:
            self._lose()
        else:
            self._part.add_link(message, self._clock.log_ns, item.host_ns + item.unix_offset_ns)

    def _come(self, host_ns: int, unix_offset_ns: int) -> None:
        """Note the time of the next item from the wire, and see to it that a file is open.

        Begin a new file if the present one is large or old enough, or if there is none.
        """
        self._clock.now_ns = host_ns
        if self._clock.offset_ns is None:
            self._clock.offset_ns = unix_offset_ns
        if self._part is not None and self._is_due(self._part):
            self._finish()
        if self._part is None:
            self._begin()

    def _on_block(self, block: Block) -> None:
        rows = block.due_rows
        times = block.host_ns[rows.start : rows.stop : rows.step]
        for name, lines in self._channels.lines_of(block):
            if part := self._file():
                part.add_lines(name, times, lines)
            else:
                self._lose(len(times))

    def _on_record(self, record: AnyRecord) -> None:
        if isinstance(record, Hello):
            self._hello = as_stated(msgspec.structs.replace(record, device=None))
            if self._part is not None:
                self._part.note(self._hello)
        elif isinstance(record, Error) and record.kind in REFUSED:
            self._hello = None
        name = self._channels.name_of(record)
        if name is None:
            return
        if part := self._file():
            part.add(name, record.host_ns, record.host_ns, encode_message(record))
        else:
            self._lose()

    def _file(self) -> OpenPart | None:
        """Return the open file, or None if no file can be written at the moment.

        The first file begins with the first item. If this one is the first, begin the file now.
        """
        if self._clock.offset_ns is None:
            self._come(clock.host_ns(), clock.unix_offset_ns())
        return self._part

    def _lose(self, items: int = 1, size_bytes: int = 0, chunks: int = 0) -> None:
        """Count items as lost, since they are written to no file."""
        self.lost += items
        self._outage.count(items, size_bytes, chunks)

    def _is_due(self, part: OpenPart) -> bool:
        """Return whether this file is so large or so old that the next file has to begin."""
        age_ns = self._clock.now_ns - part.began_ns
        return (
            part.writer.size_bytes >= self._settings.rotate_mb * 1e6
            or age_ns >= self._settings.rotate_s * 1e9
        )

    def _begin(self) -> None:
        """Begin the next file.

        After a failure, try to begin the file only every few seconds, and only if the disk has enough room.
        """
        now_ns, outage = clock.host_ns(), self._outage
        if outage.gap is not None and now_ns < outage.retry_ns:
            return
        outage.retry_ns = now_ns + RETRY_NS
        assert self._clock.offset_ns is not None
        reserve_bytes = int(self._settings.resume_mb * 1e6) if outage.is_of_disk else 0
        path, part = self._session.next_path, None
        try:
            writer = self._session.begin(self._clock.offset_ns, self._hello, reserve_bytes)
            part = OpenPart(writer, self._hello, self._clock.now_ns, now_ns)
            if outage.gap is not None:
                part.add_gap(outage.gap, self._clock.log_ns)
                part.flush(now_ns)
        except OSError as error:
            if part is not None:
                part.writer.discard()
            self._stop(error)
            return
        self._session.parts += 1
        self._part, self.path, outage.trouble = part, path, None
        if outage.gap is not None:
            text = f"recording goes on in {path}; {outage.gap.items} items before it were not recorded."
            outage.gap = None
            self._report("record_resumed", text)

    def _finish(self) -> None:
        if self._part is None:
            return
        try:
            self._part.writer.finish()
        except OSError as error:
            self._stop(error)
        else:
            self._finished_bytes += self._part.writer.size_bytes
            self._part = None

    def _stop(self, error: OSError) -> None:
        """Give the present file up after an error.

        Report the error once, and begin to count the items that are not recorded.
        """
        part, self._part = self._part, None
        if isinstance(error, Meddled) and part is not None:
            self._lose_file(part, error)
            return
        unflushed = NOTHING
        if part is not None:
            unflushed = part.unflushed
            part.writer.abandon()
            self._finished_bytes += part.writer.size_bytes
        if self._outage.is_of_disk:
            return
        kind, text = _explain(self._session.folder, error, self._settings.resume_mb)
        self.lost += unflushed.items
        self._outage.add(kind, unflushed)
        self._outage.retry_ns = clock.host_ns() + RETRY_NS
        self._outage.trouble = text
        self._report(kind, text)

    def _lose_file(self, part: OpenPart, error: Meddled) -> None:
        """Close a file that another program has deleted, moved or truncated.

        Report the loss, and let the next file begin at once.
        """
        lost = lost_of(part, error)
        if error.what == "moved":
            try:
                part.writer.finish(moved=True)
            except OSError as other:
                self._part = part
                self._stop(other)
                return
        else:
            part.writer.abandon()
        if error.what != "deleted":
            self._finished_bytes += part.writer.size_bytes
        kind, text = told(part.writer.path, error, lost.items)
        self.lost += lost.items.items
        if kind == DELETED:
            self._outage.add(kind, summed(lost.items, lost.gaps))
        self._outage.retry_ns = 0
        self._outage.trouble = text
        self._report(kind, text)


def _explain(folder: Path, error: OSError, resume_mb: float) -> tuple[str, str]:
    """Return kind and text of the error that stopped a recording."""
    if error.errno in NO_ROOM:
        return "disk_full", (
            f"recording to {folder} stopped: {error.strerror}. Everything else goes on. The recording "
            f"goes on in a new file once there is room for {resume_mb:g} MB. Remove what is not needed."
        )
    return "record_failed", (
        f"recording to {folder} stopped: {error.strerror}. Everything else goes on; a new file is tried "
        f"every {RETRY_NS // 10**9} s. Is the disk still there, and may this program write to it?"
    )


def open_output(opening: Opening) -> RecordSink:
    """Open a recording of one device that runs as long as the program."""
    settings = opening.program.record.for_devices(len(opening.configs))
    return RecordSink(settings, opening.device, opening.report)


def check_output(asked: AskedOutput) -> Iterator[Finding]:
    """Yield what is wrong with the folder of recordings, and for how long it has room."""
    return check_space(asked)
