"""Write the successive files of one recorded session, in a folder that may hold other files."""

import errno
import os
import secrets
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path

import msgspec

from fltea.recording.part import PartWriter
from fltea.recording.schema import encode_message
from fltea.recording.session import LINK, LinkMessage, PartInfo
from fltea.records import clock
from fltea.records.errors import UsageError
from fltea.records.events import Ints, Reads
from fltea.records.records import AnyRecord, Hello
from fltea.records.version import __version__
from fltea.records.whole_file import make_folder

MOST_NOTES = 100
"""Largest number of HELLO messages that are written as metadata of one file. The number is limited since the
index of the metadata stays in memory. The recorded bytes contain all HELLO messages anyway.
"""

NOTHING = LinkMessage("gap")
"""A message about a gap in the recording, in which all counts of lost data are 0."""


NO_DISK = "the folder is gone, and what is left of its path is on another disk"


def longer(gap: LinkMessage, items: int, size_bytes: int = 0, chunks: int = 0) -> LinkMessage:
    """Return the message `gap`, with the given numbers added to its counts of lost data."""
    return msgspec.structs.replace(
        gap, bytes=gap.bytes + size_bytes, chunks=gap.chunks + chunks, items=gap.items + items
    )


def summed(gap: LinkMessage, other: LinkMessage) -> LinkMessage:
    """Return the message `gap` with the counts of lost data of `other` added."""
    return longer(gap, other.items, other.bytes, other.chunks)


class SourceClock:
    """The source's clock, by which the items of a recording get their times.

    `now_ns`: time of the newest item [ns]. `offset_ns`: offset from this clock to Unix time [ns]. The offset
    of the first item is used for all items; None before the first item.
    """

    def __init__(self) -> None:
        self.now_ns = 0
        self.offset_ns: int | None = None

    @property
    def log_ns(self) -> int:
        """Unix time of the newest item, as it is written to the file [ns]."""
        return self.now_ns + (self.offset_ns or 0)


class OpenPart:
    """A file that is being written.

    `began_ns`: time of the file's beginning, on the source's clock. `flushed_ns`: time of the last flush, on
    the host's clock. `unflushed`: counts of the items that are still in the buffer, and are lost if writing
    fails now.
    `flushed`: counts of the items that are already in the file, and are lost only if another program deletes
    or truncates the file.
    `gaps`: counts of items that were not recorded, as messages in the file report them.
    """

    def __init__(self, writer: PartWriter, hello: Hello | None, began_ns: int, now_ns: int) -> None:
        self.writer, self.began_ns, self.flushed_ns = writer, began_ns, now_ns
        self.unflushed = self.flushed = self.gaps = NOTHING
        self._noted, self._notes = hello, 0

    def add(self, topic: str, log_ns: int, publish_ns: int, data: bytes) -> None:
        """Write one message."""
        self.writer.add(topic, log_ns, publish_ns, data)
        self.unflushed = longer(self.unflushed, 1)

    def add_link(self, message: LinkMessage, log_ns: int, publish_ns: int | None = None) -> None:
        """Write an event of the connection. `publish_ns`: its publish time; None if it is `log_ns`."""
        self.add(LINK, log_ns, log_ns if publish_ns is None else publish_ns, encode_message(message))

    def add_gap(self, gap: LinkMessage, log_ns: int) -> None:
        """Write a message about a gap, which does not count as a recorded item."""
        self.writer.add(LINK, log_ns, log_ns, encode_message(gap))
        self.gaps = summed(self.gaps, gap)

    def add_reads(self, reads: Reads, offset_ns: int, sequence: int) -> None:
        """Write bytes that arrived over the wire. `PartWriter.add_reads` explains the arguments."""
        self.writer.add_reads(reads, offset_ns, sequence)
        count = len(reads.end)
        self.unflushed = longer(self.unflushed, count, len(reads.data), chunks=count)

    def add_lines(self, topic: str, log_ns: Ints, lines: bytes) -> None:
        """Write one message for each line of text. `log_ns`: the times of the messages."""
        self.writer.add_lines(topic, log_ns, lines)
        self.unflushed = longer(self.unflushed, len(log_ns))

    def flush(self, now_ns: int) -> None:
        """Write all buffered data to the file.

        Raises:
            OSError: the disk is full, or fails; `Meddled` if the file is gone.
        """
        self.flushed_ns = now_ns
        self.writer.flush()
        self.flushed, self.unflushed = summed(self.flushed, self.unflushed), NOTHING

    def note(self, hello: Hello) -> None:
        """Write a HELLO as metadata of the file if it differs from the previous HELLO."""
        unchanged = self._noted and msgspec.structs.replace(self._noted, host_ns=hello.host_ns) == hello
        if not unchanged and self._notes < MOST_NOTES:
            self._noted = hello
            self._notes += 1
            self.writer.note_hello(hello)


class Session:
    """Names and begins the files of a session. `parts`: number of files so far.

    Raises:
        UsageError: the folder cannot be made or written to.
    """

    def __init__(self, folder: str, device: str, kinds: Mapping[str, type[AnyRecord]]) -> None:
        self.folder, self._device, self._kinds = Path(folder), device, dict(kinds)
        self._name = secrets.token_hex(4)
        self._started = datetime.now(UTC).strftime("%Y%m%dT%H%M%SZ")
        self.parts = 0
        try:
            make_folder(self.folder)
        except OSError as error:
            raise UsageError(
                f"--record {self.folder}: the folder cannot be made ({error.strerror})."
            ) from error
        if not os.access(self.folder, os.W_OK | os.X_OK):
            raise UsageError(f"--record {self.folder}: no permission to write into this folder.")
        self._disk = self.folder.stat().st_dev

    @property
    def next_path(self) -> Path:
        """Path of the next file."""
        return self.folder / f"{self._device}_{self._started}_{self._name}_{self.parts:03d}.mcap"

    def begin(self, offset_ns: int, hello: Hello | None, reserve_bytes: int) -> PartWriter:
        """Begin the next file. The caller increases `parts` once the file works.

        Raises:
            OSError: the disk is full, fails, or is no longer mounted.
        """
        self._find_folder()
        info = PartInfo(
            session=self._name,
            part=self.parts,
            device=self._device,
            fltea=__version__,
            offset_ns=offset_ns,
            created_ns=clock.unix_ns(),
            hello=hello,
        )
        return PartWriter(self.next_path, info, self._kinds, reserve_bytes)

    def _find_folder(self) -> None:
        """Create a deleted folder again, unless its disk is no longer mounted.

        If the disk is no longer mounted, a new folder of this name would be on another disk.
        """
        place = self.folder.absolute()
        while not place.exists():
            place = place.parent
        disk = place.stat().st_dev
        if place != self.folder.absolute():
            if disk != self._disk:
                raise OSError(errno.ENODEV, NO_DISK)
            make_folder(self.folder)
        self._disk = disk
