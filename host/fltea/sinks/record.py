"""Records what comes over the wire, and the records made of it, in MCAP files."""

import errno
from itertools import chain
from pathlib import Path
from typing import get_args

import msgspec

from fltea.recording.schema import encode_message
from fltea.recording.session import OVERFLOW, WIRE, WIRE_WRAP, Entry, LinkMessage
from fltea.records import clock
from fltea.records.block import Block
from fltea.records.events import Chunk, Failed, LinkDown, Reads, TransportEvent
from fltea.records.ports import Item, Report, Sink
from fltea.records.records import AnyRecord, Hello
from fltea.settings.outputs import RecordConfig
from fltea.sinks.lines import BlockLines, Wanted
from fltea.sinks.record_session import NOTHING, OpenPart, Session, longer
from fltea.sources.wire_events import WireEvents

FLUSH_NS = 500_000_000
"""What a killed program loses is at most this and the pause between two calls of `flush`."""

RETRY_NS = 5 * 10**9
"""A disk that failed is looked at so often."""

NO_ROOM = (errno.ENOSPC, errno.EDQUOT)

KINDS: dict[str, type[AnyRecord]] = {str(kind.__struct_config__.tag): kind for kind in get_args(AnyRecord)}
"""Records by the names of their classes."""

OF_BLOCKS = {
    "sample": Wanted(samples=True, nulls=False),
    "estimate": Wanted(estimates=True, nulls=False),
    "corrected": Wanted(corrected=True, nulls=False),
}
"""Channels of what has a row a sample."""


class RecordSink(Sink):
    """One device's session: files one after the other, in a folder that may hold others.

    A disk that is full or fails stops the recording, not the program: what is not recorded is counted, and a
    new file begins when there is room again. hello: what is known of a device that is running already.
    path: the newest file; trouble: why nothing is recorded at the moment.

    Raises:
        UsageError: the folder cannot be made or written to.
    """

    name = "record"
    lossless = True
    takes_wire = True
    capacity = 50_000

    def __init__(
        self, settings: RecordConfig, device: str, report: Report, hello: Hello | None = None
    ) -> None:
        assert settings.folder is not None
        self.path: Path | None = None
        self.trouble: str | None = None
        self.lost = 0
        self._settings, self._report = settings, report
        kinds = {str(name): KINDS[name] for name in settings.channels}
        self._topics = {kind: name for name, kind in kinds.items()}
        self._of_blocks = {name: wanted for name, wanted in OF_BLOCKS.items() if name in kinds}
        self._lines = BlockLines()
        self._session = Session(settings.folder, device, kinds)
        self._part: OpenPart | None = None
        self._finished_bytes = 0
        self._offset_ns: int | None = None
        self._now_ns = self._retry_ns = 0
        self._sequence = 0
        self._hello = hello
        self._wire = WireEvents(device)
        self._unread: list[Chunk] = []
        self._gap: LinkMessage | None = None

    @property
    def parts(self) -> int:
        """The number of files so far."""
        return self._session.parts

    @property
    def size_bytes(self) -> int:
        """The size of all files so far, as far as written; may be asked from any thread."""
        part = self._part
        return self._finished_bytes + (part.writer.size_bytes if part is not None else 0)

    def write(self, item: Item) -> None:
        """Take one item; a new file begins only before one from the wire."""
        if isinstance(item, TransportEvent):
            self._on_wire(item)
        elif isinstance(item, Reads):
            for one in item.chunks():
                self._on_wire(one)
        elif isinstance(item, Block):
            self._on_block(item)
        elif type(item) in self._topics:
            self._on_message(self._topics[type(item)], item.host_ns, encode_message(item))

    def flush(self) -> None:
        """Hand what has been gathered to the operating system, if the last time is long enough ago."""
        now_ns = clock.host_ns()
        if self._part is None or now_ns - self._part.flushed_ns < FLUSH_NS:
            return
        self._read()
        try:
            self._part.flush(now_ns)
        except OSError as error:
            self._stop(error)

    def on_overflow(self, count: int) -> None:
        """Mark the place, and forget what was known of the device."""
        self._read()
        self._hello = None
        if self._part is not None:
            self._part.add_link(LinkMessage("gap", kind=OVERFLOW, items=count), self._log_ns)

    def close(self) -> None:
        """Finish the file."""
        self._finish()

    def _on_wire(self, item: TransportEvent) -> None:
        self._now_ns = item.host_ns
        if self._offset_ns is None:
            self._offset_ns = item.unix_offset_ns
        if self._part is not None and self._is_due(self._part):
            self._finish()
        if self._part is None:
            self._begin()
        publish_ns = item.host_ns + item.unix_offset_ns
        if isinstance(item, Chunk):
            if self._part is None:
                self._lose(len(item.data), chunks=1)
            else:
                self._part.add(Entry(WIRE, self._log_ns, publish_ns, self._sequence, item.data))
            self._sequence = (self._sequence + 1) % WIRE_WRAP
        elif self._part is None:
            self._lose()
        elif isinstance(item, Failed):
            failed = LinkMessage("failed", kind=item.kind, message=item.message)
            self._part.add_link(failed, self._log_ns, publish_ns)
        else:
            self._part.add_link(LinkMessage("opened"), self._log_ns, publish_ns)
        if isinstance(item, Chunk):
            self._unread.append(item)
            if item.host_ns - self._unread[0].host_ns >= FLUSH_NS:
                self._read()
        else:
            self._read(item)

    def _read(self, *last: TransportEvent) -> None:
        """Take note of what the device says of itself; of many reads at once, which costs less."""
        reads = (Reads.of(*self._unread),) if self._unread else ()
        self._unread = []
        for item in (*reads, *last):
            for event in self._wire.feed(item, self._now_ns):
                if isinstance(event, Hello):
                    self._on_hello(event)
                elif isinstance(event, LinkDown):
                    self._hello = None

    def _on_block(self, block: Block) -> None:
        rows = block.due_rows
        times = block.host_ns[rows.start : rows.stop : rows.step].tolist()
        kinds = []
        for name, wanted in self._of_blocks.items():
            lines = self._lines.of(block, wanted, rows).splitlines()
            if lines:
                kinds.append([(name, *one) for one in zip(times, lines, strict=True)])
        for message in chain.from_iterable(zip(*kinds, strict=True)):
            self._on_message(*message)

    def _on_message(self, name: str, host_ns: int, data: bytes) -> None:
        if self._offset_ns is None:  # an error of another output, before anything from the device
            self._offset_ns = clock.unix_offset_ns()
            self._now_ns = clock.host_ns()
            self._begin()
        if self._part is None:
            self._lose()
        else:
            self._part.add(Entry(name, host_ns, host_ns, 0, data))

    def _on_hello(self, hello: Hello) -> None:
        self._hello = hello
        if self._part is not None:
            self._part.note(hello)

    @property
    def _log_ns(self) -> int:
        """Time of the newest item, as the file has it."""
        return self._now_ns + (self._offset_ns or 0)

    def _lose(self, size_bytes: int = 0, chunks: int = 0) -> None:
        """Count one item that no file takes."""
        self.lost += 1
        if self._gap is not None:
            self._gap = longer(self._gap, size_bytes, chunks)

    def _is_due(self, part: OpenPart) -> bool:
        """Whether the file is large or old enough."""
        age_ns = self._now_ns - part.began_ns
        return (
            part.writer.size_bytes >= self._settings.rotate_mb * 1e6
            or age_ns >= self._settings.rotate_s * 1e9
        )

    def _begin(self) -> None:
        """Begin the next file; after a failure only now and then, and only if there is room for some time."""
        self._read()
        now_ns = clock.host_ns()
        if self._gap is not None and now_ns < self._retry_ns:
            return
        self._retry_ns = now_ns + RETRY_NS
        assert self._offset_ns is not None
        reserve_bytes = 0 if self._gap is None else int(self._settings.resume_mb * 1e6)
        path, part = self._session.next_path, None
        try:
            writer = self._session.begin(self._offset_ns, self._hello, reserve_bytes)
            part = OpenPart(writer, self._hello, self._now_ns, now_ns)
            if self._gap is not None:
                part.add_link(self._gap, self._log_ns)
                part.flush(now_ns)
        except OSError as error:
            if part is not None:
                part.writer.discard()
            self._stop(error)
            return
        self._session.parts += 1
        self._part, self.path, self.trouble = part, path, None
        if self._gap is not None:
            text = f"recording goes on in {path}; {self._gap.items} items before it were not recorded."
            self._gap = None
            self._report("record_resumed", text)

    def _finish(self) -> None:
        if self._part is None:
            return
        self._read()
        try:
            self._part.writer.finish()
        except OSError as error:
            self._stop(error)
        else:
            self._finished_bytes += self._part.writer.size_bytes
            self._part = None

    def _stop(self, error: OSError) -> None:
        """Give the file up, report it once, and begin to count what is not recorded."""
        unflushed = NOTHING
        if self._part is not None:
            unflushed = self._part.unflushed
            self._part.writer.abandon()
            self._finished_bytes += self._part.writer.size_bytes
            self._part = None
        if self._gap is not None:
            return
        kind, text = _explain(self._session.folder, error, self._settings.resume_mb)
        self.lost += unflushed.items
        self._gap = msgspec.structs.replace(unflushed, kind=kind)
        self._retry_ns = clock.host_ns() + RETRY_NS
        self.trouble = text
        self._report(kind, text)


def _explain(folder: Path, error: OSError, resume_mb: float) -> tuple[str, str]:
    """Kind and text of what stopped a recording."""
    if error.errno in NO_ROOM:
        return "disk_full", (
            f"recording to {folder} stopped: {error.strerror}. All else goes on, and so does the recording, "
            f"in a new file, once there is room for {resume_mb:g} MB. Remove what is not needed."
        )
    return "record_failed", (
        f"recording to {folder} stopped: {error.strerror}. All else goes on; a new file is tried every "
        f"{RETRY_NS // 10**9} s. Is the disk still there, and may this program write to it?"
    )
