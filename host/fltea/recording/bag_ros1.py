"""Reads a bag of ROS 1 (format 2.0) from beginning to end, as far as it is readable.

The index at the end of the file is not used: a bag that was not closed has none, and in memory an index takes
over a hundred bytes for every message. Without it, memory for one chunk of messages is enough.
"""

import contextlib
import struct
from collections.abc import Iterator
from pathlib import Path

from fltea.recording.bag_files import ROS1
from fltea.recording.bag_messages import Batch, Topic, undescribed
from fltea.recording.bag_ros1_records import (
    DAMAGE,
    LENGTH,
    OUTER,
    FileBytes,
    Op,
    Place,
    find_record,
    follows,
    read_fields,
    record_at,
    records_in,
)
from fltea.recording.decompress import decompressed_bz2, decompressed_lz4
from fltea.recording.files import Note
from fltea.settings.extras import load
from fltea.settings.limits import Limits

VERSION = ROS1 + b"2.0\n"
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
        yield from _Bag(path, FileBytes(file, size), limits).read()


class _Bag:
    """One pass through a bag, whose version has been read."""

    def __init__(self, path: Path, content: FileBytes, limits: Limits) -> None:
        self._path, self._content, self._limits = path, content, limits
        self._messages = _Messages()

    def read(self) -> Iterator[Batch | Note]:
        """Yield all messages of the bag, and notes on the parts of the file that are unreadable."""
        at, size = len(VERSION), len(self._content)
        chunks: bytes | None = None
        described = damaged = 0
        is_cut = False
        while at < size and not is_cut:
            place = record_at(self._content, at)
            end = at if place is None else place.end
            if place is None or not follows(self._content, end):
                # the length of the record may be wrong, or bytes of it may be missing
                following = find_record(self._content, at + 1, OUTER)
                is_cut = following == size
                if not is_cut:
                    damaged += 1
                    yield self._lost(at, place, following)
                end = min(following, max(end, at) if is_cut else following)
            if place is not None:
                kind = place.fields[b"op"]
                described += kind == Op.CHUNK_INFO
                if kind == Op.BAG_HEADER:
                    index = int.from_bytes(place.fields.get(b"index_pos", b""), "little")
                    chunks = place.fields.get(b"chunk_count") if index else None
                    self._describe(index)
                yield from self._take(at, place, end)
            at = end
        if is_cut or chunks is None or (chunks != LENGTH.pack(described) and not damaged):
            text = f"{self._path}: was not closed, or is cut off; what reached the disk is read."
            yield Note("cut_recording", text)
        if self._messages.unknown:
            yield undescribed(self._path, self._messages.unknown)

    def _lost(self, at: int, place: Place | None, following: int) -> Note:
        what = "chunk" if place is not None and place.fields[b"op"] == Op.CHUNK else "record"
        text = (
            f"the {what} at byte {at} is damaged: the next record begins at byte {following}, and not where "
        )
        return Note("recording_gap", f"{self._path}: {text}this one ends; what could be read of it is used.")

    def _describe(self, index: int) -> None:
        """Read the descriptions of topics in the bag's index. Those in chunks may be damaged."""
        place, size = record_at(self._content, index), len(self._content)
        if index and (place is None or place.fields[b"op"] != Op.CONNECTION):
            # bytes are missing, so that the index is elsewhere
            at = find_record(self._content, 0, (Op.CONNECTION,))
            while at < size and (place := record_at(self._content, at)):
                self._add(place, place.end)
                at = find_record(self._content, place.end, (Op.CONNECTION,))
        while index and place and place.fields[b"op"] == Op.CONNECTION:
            self._add(place, place.end)
            place = record_at(self._content, place.end)

    def _add(self, place: Place, end: int) -> None:
        is_whole = end == place.end <= len(self._content)
        if is_whole and end - place.begin <= self._limits.chunk_bytes:
            with contextlib.suppress(*DAMAGE):
                self._messages.add(place.fields, self._content[place.begin : end])

    def _take(self, at: int, place: Place, end: int) -> Iterator[Batch | Note]:
        """Read a chunk, a message or a description. `end`: where it ends, or the damage in it."""
        kind = place.fields[b"op"]
        if kind in (Op.MESSAGE, Op.CONNECTION):
            self._add(place, end)
        elif kind == Op.CHUNK:
            if end - place.begin > self._limits.chunk_bytes:
                raise self._limits.chunk_too_large(f"{self._path}: the chunk at byte {at}", end - place.begin)
            where = f"{self._path}: byte {at}"
            packed = self._content[place.begin : end]
            problem = _read_chunk(packed, place.fields, self._messages, self._limits, where)
            yield from self._messages.taken()
            if problem is not None and end == place.end:
                text = f"{self._path}: the chunk at byte {at} is damaged ({problem})"
                yield Note("recording_gap", f"{text}; what could be read of it is used.")
            return
        yield from self._messages.taken()


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
        except (OSError, ValueError, RuntimeError, EOFError):
            return f"it cannot be decompressed by {compression.decode()}"
        if len(data) == most:
            raise limits.chunk_too_large(place, most)
        if LENGTH.pack(len(data)) != fields.get(b"size"):
            problem = "it does not hold the number of bytes that it states"
    return messages.add_all(data) or problem


class _Messages:
    """Collects the messages of a bag by connection: a publisher's stream of messages on one topic.

    `unknown`: number of messages whose connection is not described.
    """

    def __init__(self) -> None:
        self._topics: dict[bytes, Topic] = {}
        self._publishers: dict[bytes, str] = {}
        self._batches: dict[bytes, Batch] = {}
        self.unknown = 0

    def add_all(self, data: bytes) -> str | None:
        """Add the records in `data`.

        Return a text that says what is wrong with these records; None if nothing is.
        """
        problems: list[str] = []
        for fields, content in records_in(data, problems.append):
            try:
                self.add(fields, content)
            except DAMAGE:
                problems.append("a record without the fields that it needs")
        return problems[0] if problems else None

    def add(self, fields: dict[bytes, bytes], data: bytes) -> None:
        """Add one record: a message, or the description of a connection. Other records are ignored."""
        kind, connection = fields.get(b"op"), fields.get(b"conn", b"")
        if kind == Op.MESSAGE:
            batch = self._batches.get(connection)
            if batch is None:
                topic = self._topics.get(connection)
                if topic is None:
                    self.unknown += 1
                    return
                batch = self._batches[connection] = Batch(topic, publisher=self._publishers[connection])
            batch.count += 1
            if batch.topic.is_imu:
                seconds, nanoseconds = TIME.unpack(fields[b"time"])
                batch.arrival_ns.append(seconds * 1_000_000_000 + nanoseconds)
                batch.data.append(data)
        elif kind == Op.CONNECTION and connection not in self._topics:
            header = read_fields(data)
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
