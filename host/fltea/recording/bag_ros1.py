"""Reads a bag of ROS 1 (format 2.0) from beginning to end, as far as it is readable.

The index at the end of the file is not used: a bag that was not closed has none, and in memory an index takes
over a hundred bytes for every message. Without it, memory for one chunk of messages is enough.
"""

import contextlib
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO, NamedTuple

from fltea.recording.bag_files import ROS1
from fltea.recording.bag_messages import Batch, Topic
from fltea.recording.decompress import decompressed_bz2, decompressed_lz4
from fltea.recording.files import Note
from fltea.settings.extras import load
from fltea.settings.limits import Limits

VERSION = ROS1 + b"2.0\n"


class Op:
    """Types of a bag's records: values of the field `op` in a record's header."""

    MESSAGE, BAG_HEADER, CHUNK, CHUNK_INFO, CONNECTION = b"\x02", b"\x03", b"\x05", b"\x06", b"\x07"


LONGEST_HEADER = 1 << 20
DAMAGE = (struct.error, ValueError, KeyError)
"""Errors that are raised when damaged records are read."""

LENGTH = struct.Struct("<I")
TIME = struct.Struct("<II")


def read_ros1(path: Path, limits: Limits) -> Iterator[Batch | Note]:
    """Yield all messages of a bag, and notes on the parts of the file that are unreadable.

    Raises:
        OSError: the file cannot be read.
        ValueError: the file is not a bag of ROS 1.
        UsageError: a chunk needs more memory than the limits allow, or the library that decompresses it is
            not installed.
    """
    with path.open("rb") as file:
        size = file.seek(0, 2)
        file.seek(0)
        version = file.read(len(VERSION))
        if not version.startswith(ROS1):
            raise ValueError("it is no bag of ROS 1")
        if version != VERSION:
            raise ValueError(
                f"its format is {version[len(ROS1) :].decode(errors='replace').strip()}, not 2.0"
            )
        messages = _Messages()
        index: bytes | None = None
        described = 0
        place = file.tell()
        while (record := next_record(file, size)) is not None:
            fields, length = record.fields, min(record.length, size - file.tell())
            begin = file.tell()
            match fields.get(b"op"):
                case Op.BAG_HEADER:
                    index = fields.get(b"chunk_count") if any(fields.get(b"index_pos", b"")) else None
                case Op.CHUNK_INFO:
                    described += 1
                case Op.CHUNK:
                    if length > limits.chunk_bytes:
                        raise limits.chunk_too_large(f"{path}: the chunk at byte {place}", length)
                    problem = _read_chunk(
                        file.read(length), fields, messages, limits, f"{path}: byte {place}"
                    )
                    yield from messages.taken()
                    if problem is not None and length == record.length:
                        text = f"{path}: the chunk at byte {place} is damaged ({problem})"
                        yield Note("recording_gap", f"{text}; what could be read of it is used.")
                case Op.MESSAGE | Op.CONNECTION if length <= limits.chunk_bytes and length == record.length:
                    with contextlib.suppress(*DAMAGE):
                        messages.add(fields, file.read(length))
                    yield from messages.taken()
            if length < record.length:
                break
            place = begin + length
            file.seek(place)
        if place != size or index != LENGTH.pack(described):
            text = f"{path}: was not closed, or is cut off; what reached the disk is read."
            yield Note("cut_recording", text)


class _Record(NamedTuple):
    fields: dict[bytes, bytes]
    length: int
    """Length of the record's data, which follow its header [bytes]."""


def next_record(file: BinaryIO, size: int) -> _Record | None:
    """Read the header of the next record. Return None at the end of the file or at invalid bytes."""
    head = file.read(LENGTH.size)
    if len(head) < LENGTH.size:
        return None
    (length,) = LENGTH.unpack(head)
    if length > min(LONGEST_HEADER, size - file.tell()):
        return None
    header, head = file.read(length), file.read(LENGTH.size)
    if len(head) < LENGTH.size:
        return None
    try:
        return _Record(_read_fields(header), LENGTH.unpack(head)[0])
    except ValueError:
        return None


def _read_fields(header: bytes) -> dict[bytes, bytes]:
    """Return the fields of a header, by name. A header stores each field as its length and `name=value`."""
    fields = {}
    at, end = 0, len(header)
    while at < end:
        if at + LENGTH.size > end:
            raise ValueError("a header that is cut")
        after = at + LENGTH.size + int.from_bytes(header[at : at + 4], "little")
        name, equals, value = header[at + 4 : after].partition(b"=")
        if after > end or not equals:
            raise ValueError("a header without names")
        fields[name] = value
        at = after
    return fields


def _read_chunk(
    packed: bytes, fields: dict[bytes, bytes], messages: "_Messages", limits: Limits, place: str
) -> str | None:
    """Decompress a chunk, and add its records to `messages`.

    Return a text that says what is wrong with the chunk; None if nothing is.
    """
    compression = fields.get(b"compression", b"")
    data, problem = packed, None
    if compression != b"none":
        if compression not in (b"lz4", b"bz2"):
            return f"no reader for chunks that are compressed by {compression[:20]!r}"
        if compression == b"lz4":
            load("lz4.frame", "lz4", "ros", "Bags that are compressed by LZ4 need")
        most = limits.chunk_bytes + 1
        try:
            data = (decompressed_lz4 if compression == b"lz4" else decompressed_bz2)(packed, most)
        except (OSError, ValueError, RuntimeError, EOFError) as error:
            return str(error)
        if len(data) == most:
            raise limits.chunk_too_large(place, most)
        if LENGTH.pack(len(data)) != fields.get(b"size"):
            problem = "it does not hold the number of bytes that it states"
    return messages.add_all(data) or problem


class _Messages:
    """Collects the messages of a bag by connection: a publisher's stream of messages on one topic."""

    def __init__(self) -> None:
        self._topics: dict[bytes, Topic] = {}
        self._publishers: dict[bytes, str] = {}
        self._batches: dict[bytes, Batch] = {}

    def add_all(self, data: bytes) -> str | None:
        """Add the records in `data`.

        Return a text that says what is wrong with these records; None if nothing is.
        """
        at, end = 0, len(data)
        length_at = LENGTH.unpack_from
        try:
            while at < end:
                header = at + LENGTH.size
                begin = header + length_at(data, at)[0] + LENGTH.size
                at = begin + length_at(data, begin - LENGTH.size)[0]
                if at > end:
                    return "its last record is cut"
                self.add(_read_fields(data[header : begin - LENGTH.size]), data[begin:at])
        except DAMAGE as error:
            return f"{type(error).__name__}: {error}"
        return None

    def add(self, fields: dict[bytes, bytes], data: bytes) -> None:
        """Add one record: a message, or the description of a connection. Other records are ignored."""
        kind, connection = fields.get(b"op"), fields.get(b"conn", b"")
        if kind == Op.MESSAGE:
            batch = self._batches.get(connection)
            if batch is None:
                topic = self._topics.get(connection)
                if topic is None:
                    raise ValueError("messages of a topic that is not described")
                batch = self._batches[connection] = Batch(topic, publisher=self._publishers[connection])
            batch.count += 1
            if batch.topic.is_imu:
                seconds, nanoseconds = TIME.unpack(fields[b"time"])
                batch.arrival_ns.append(seconds * 1_000_000_000 + nanoseconds)
                batch.data.append(data)
        elif kind == Op.CONNECTION and connection not in self._topics:
            header = _read_fields(data)
            name, kind_of = (one.decode(errors="replace") for one in (fields[b"topic"], header[b"type"]))
            schema = header.get(b"message_definition", b"")
            self._topics[connection] = Topic(name, kind_of, "ros1", schema)
            publisher = header.get(b"callerid", b"").decode(errors="replace")
            self._publishers[connection] = publisher or f"connection {int.from_bytes(connection, 'little')}"
            self._batches[connection] = Batch(
                self._topics[connection], publisher=self._publishers[connection]
            )

    def taken(self) -> Iterator[Batch]:
        """Yield the batches of messages that were added since the last call."""
        batches = list(self._batches.values())
        self._batches.clear()
        yield from batches
