"""Writes one MCAP file of a recording, so that a program killed at any moment leaves what can be read."""

import contextlib
import errno
import fcntl
import os
from collections.abc import Mapping
from pathlib import Path
from typing import IO, cast

import msgspec
from mcap.writer import CompressionType, Writer

from fltea.recording.schema import record_schema
from fltea.recording.session import HELLO, LINK, SESSION, WIRE, Entry, LinkMessage, PartInfo
from fltea.records.records import Hello
from fltea.records.version import __version__

CHUNK_BYTES = 1 << 20
NO_RESERVING = (errno.EOPNOTSUPP, errno.EINVAL, errno.ENOSYS)


class AppendOnly:
    """A new file that is written in one piece at every flush.

    good_bytes: length after the last flush that succeeded; `cut` goes back to it. To the library it looks
    like a binary stream, of which it uses no more than `write`, `tell` and `flush`.
    """

    def __init__(self, path: Path, reserve_bytes: int) -> None:
        self.good_bytes = 0
        self._pending = bytearray()
        self._fd = os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY | os.O_CLOEXEC, 0o666)
        with contextlib.suppress(OSError):  # not every file system has locks
            fcntl.flock(self._fd, fcntl.LOCK_EX)  # whoever would mend the file sees that it is in use
        try:
            if reserve_bytes:
                _reserve(self._fd, reserve_bytes)
        except OSError:
            os.close(self._fd)
            path.unlink(missing_ok=True)
            raise

    def write(self, data: bytes) -> int:
        """Keep bytes for the next flush."""
        self._pending += data
        return len(data)

    def tell(self) -> int:
        """Length of the file, as it will be after the next flush."""
        return self.good_bytes + len(self._pending)

    def flush(self) -> None:
        """Hand everything to the operating system; OSError if it does not take it."""
        done = 0
        while done < len(self._pending):
            done += os.write(self._fd, memoryview(self._pending)[done:])
        self.good_bytes += done
        self._pending.clear()

    def cut(self) -> None:
        """Remove what a failed flush wrote of a record, if the disk still lets us, and close."""
        with contextlib.suppress(OSError):
            os.ftruncate(self._fd, self.good_bytes)
        self.close()

    def close(self) -> None:
        """Close the file; may be called twice."""
        fd, self._fd = self._fd, -1
        if fd >= 0:
            with contextlib.suppress(OSError):
                os.close(fd)


def _reserve(fd: int, size_bytes: int) -> None:
    """Make sure that there is room for so much, then give it back."""
    try:
        os.posix_fallocate(fd, 0, size_bytes)
    except OSError as error:
        if error.errno not in NO_RESERVING:
            raise
    os.ftruncate(fd, 0)


class PartWriter:
    """One file: the session's metadata, then messages in compressed chunks.

    records: classes of the records that get a channel each. reserve_bytes: room that has to be there; it is
    not kept.

    Raises:
        OSError: from the constructor and from `flush` and `finish`, the disk's; call `abandon` then.
    """

    def __init__(
        self, path: Path, info: PartInfo, records: Mapping[str, type[msgspec.Struct]], reserve_bytes: int = 0
    ) -> None:
        self.path = path
        self._file = AppendOnly(path, reserve_bytes)
        stream = cast(IO[bytes], self._file)
        self._writer = Writer(stream, chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD)
        self._writer.start(library=f"fltea {__version__}")
        self._writer.add_metadata(SESSION, info.to_metadata())
        if info.hello is not None:
            self.note_hello(info.hello)
        link = self._writer.register_schema("fltea.Link", "jsonschema", record_schema(LinkMessage))
        self._channels = {
            WIRE: self._writer.register_channel(f"/{info.device}/{WIRE}", "application/octet-stream", 0),
            LINK: self._writer.register_channel(f"/{info.device}/{LINK}", "json", link),
        }
        for name, kind in records.items():
            schema = self._writer.register_schema(f"fltea.{kind.__name__}", "jsonschema", record_schema(kind))
            self._channels[name] = self._writer.register_channel(f"/{info.device}/{name}", "json", schema)
        try:
            self.flush()
        except OSError:
            self.discard()
            raise

    @property
    def size_bytes(self) -> int:
        """Length of the file so far, without the chunk in progress."""
        return self._file.tell()

    def add(self, entry: Entry) -> None:
        """Append one message."""
        topic, log_ns, publish_ns, sequence, data = entry
        self._writer.add_message(self._channels[topic], log_ns, data, publish_ns, sequence)

    def note_hello(self, hello: Hello) -> None:
        """Write what a device says of itself as metadata."""
        fields = msgspec.structs.asdict(hello)
        self._writer.add_metadata(
            HELLO, {key: str(value) for key, value in fields.items() if value is not None}
        )

    def flush(self) -> None:
        """End the chunk and hand everything to the operating system."""
        self._writer.flush()  # type: ignore[no-untyped-call]

    def finish(self) -> None:
        """Write summary and indexes, and close."""
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._file.flush()
        self._file.close()

    def abandon(self) -> None:
        """Close a file that cannot be written any more; what was flushed before stays readable."""
        self._file.cut()

    def discard(self) -> None:
        """Close and remove a file in which there is nothing yet."""
        self._file.close()
        with contextlib.suppress(OSError):
            self.path.unlink()
