"""Reads as much as possible of an MCAP file, which may be truncated, damaged, or have holes."""

import struct
import zlib
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Metadata, Schema
from mcap.writer import MCAP0_MAGIC

from fltea import _native
from fltea.recording.decompress import decompressed_lz4, decompressed_zstd
from fltea.recording.in_use import is_in_use
from fltea.recording.resync import (
    HEAD,
    WINDOW_BYTES,
    begins_record,
    behind_zeros,
    chunk_bytes,
    chunk_length,
    data_end,
    next_chunk,
    summary_begin,
)
from fltea.recording.session import LATEST_NS
from fltea.records.errors import UsageError
from fltea.records.events import Ints
from fltea.records.small_file import open_file
from fltea.settings.limits import DEFAULT_LIMITS, Limits

CHUNK_HEAD_BYTES = 1 << 10
"""The data in a chunk begin after at most this number of bytes."""

INDEX_HEAD = struct.Struct("<HI")
"""Binary format of the first two fields of a message index: the channel of the messages, and the length of
all entries of the index [bytes].
"""

MAX_DESCRIPTION_BYTES = 16 << 20
"""Longest metadata, schema or channel record that is read [bytes]. Those in fltea's own files are a thousand
times shorter.

Reading a record needs ten times as much memory as the record is long.
"""

MOST_DAMAGED_FILES, MOST_DAMAGED_BYTES = 4, 64 << 20
"""Limits on the bytes that the search through damaged parts reads: four times the file's size, plus 64 MB."""

BEGIN, END, CHANNEL, SEQUENCE, LOG_TIME, PUBLISH_TIME = range(1, 7)
"""Indices of the columns in `Messages.table`; column 0 holds the kind of the record."""


class Message(NamedTuple):
    """A message of an MCAP file.

    Reading messages as tuples takes a fifth of the time that it takes with the MCAP library's class.
    """

    channel_id: int
    sequence: int
    log_time: int
    publish_time: int
    data: bytes


@dataclass(frozen=True)
class Messages:
    """Successive messages, stored as a table, since a recording has millions of messages.

    `table`: (n, 7), with the kind, the beginning and the end of the content in `data`, the channel, the
    sequence number, the log time and the publish time of each message.
    """

    data: bytes
    table: Ints

    def of_channels(self, channels: Collection[int]) -> "Messages":
        """Return the messages of the given channels."""
        rows = np.isin(self.table[:, CHANNEL], list(channels))
        return self if rows.all() else Messages(self.data, self.table[rows])

    def each(self) -> Iterator[Message]:
        """Yield the messages one by one."""
        for _, begin, end, channel, sequence, log_ns, publish_ns in self.table.tolist():
            yield Message(channel, sequence, log_ns, publish_ns, self.data[begin:end])


class Damage(NamedTuple):
    """An unreadable record, or a hole in the file.

    `size`: number of bytes that are skipped because of the damage.
    """

    offset: int
    text: str
    size: int

    @property
    def said(self) -> str:
        """Description of the damage for people."""
        if not self.size:
            return f"has a wrong length at byte {self.offset} ({self.text})"
        return f"is damaged at byte {self.offset} ({self.text})"


class ChunkEnd(NamedTuple):
    """This item is yielded after the last message of a chunk."""


Item = Schema | Channel | Messages | Metadata | Damage | ChunkEnd


class Scan:
    """One pass through an MCAP file; only one chunk is in memory at a time.

    The following is known after the pass. `whole`: whether the file was finished properly. `lost_bytes`:
    number of unreadable bytes at the end of the file. `why`: text on what is wrong at the end of the file;
    empty if the file merely ends early. `has_writer`: whether a program was writing the file when the pass
    began; False if `asks_for_writer` is False, since this is not examined then.
    """

    def __init__(self, path: Path, limits: Limits = DEFAULT_LIMITS, *, asks_for_writer: bool = False) -> None:
        self.path = path
        self._limits, self._asks_for_writer = limits, asks_for_writer
        self.has_writer = False
        self.whole = False
        self.lost_bytes = 0
        self.why = ""
        self._size = 0
        # end of the last readable chunk; a search for chunks that a wrong length led past begins here
        self._known = 0
        self._last = 0, 0  # offset of the newest record, and its stated length
        self._spent_bytes = 0
        self._is_described = False

    def __iter__(self) -> Iterator[Item]:
        """Yield the contents of the file in the file's order.

        Raises:
            OSError: the file cannot be read.
            ValueError: the file is not MCAP.
            UsageError: a record needs more memory than the limits allow.
        """
        with open_file(self.path) as file:
            # Whether a program writes the file is examined before reading, since that program may finish
            # meanwhile.
            self.has_writer = self._asks_for_writer and is_in_use(file)
            self._size = size = file.seek(0, 2)
            file.seek(0)
            magic = file.read(len(MCAP0_MAGIC))
            if not MCAP0_MAGIC.startswith(magic):
                raise ValueError("it is no MCAP file")
            self._known = at = len(magic)
            while size - at >= HEAD.size:
                file.seek(at)
                kind, length = HEAD.unpack(file.read(HEAD.size))
                if (other := self._true_length(file, at, kind, length)) is not None:
                    what = "chunk" if kind == Opcode.CHUNK else "message index"
                    text = f"a {what} that claims to have {length} bytes, but has {other}; these are read"
                    yield Damage(at, text, 0)
                    length = other
                elif not begins_record(file, at, size):
                    hole, at = self._hole(file, at, kind, length)
                    if hole is None:
                        break
                    yield hole
                    yield from self._described(file)
                    continue
                if kind == Opcode.DATA_END:  # only summary and indexes follow
                    self.whole = _ends_with_magic(file, size)
                    at = size
                    break
                self._last = at, length
                at += HEAD.size + length
                yield from self._items(kind, length, file)
            self.lost_bytes = size - at

    def _true_length(self, file: BinaryIO, at: int, kind: int, length: int) -> int | None:
        """Return the true length of a chunk or message index if its header states a wrong one, else None.

        The lengths of the fields of a record give the length of the record. If this differs from the length
        in the header, and another record begins where it ends, the header is wrong. Without this function,
        chunks could be lost unnoticed: a wrong length may lead to a later record, past the chunks between.
        """
        if kind == Opcode.CHUNK:
            found = chunk_length(file, at)
            by_fields = length if found is None else found.by_fields
        elif kind == Opcode.MESSAGE_INDEX and self._size - at >= HEAD.size + INDEX_HEAD.size:
            file.seek(at + HEAD.size)
            _, entries_bytes = INDEX_HEAD.unpack(file.read(INDEX_HEAD.size))
            by_fields = INDEX_HEAD.size + entries_bytes
        else:
            return None
        end = at + HEAD.size + by_fields
        follows = by_fields != length and end <= self._size and begins_record(file, end, self._size)
        return by_fields if follows else None

    def _hole(self, file: BinaryIO, at: int, kind: int, length: int) -> tuple[Damage | None, int]:
        """Return the damage at byte `at`, and the offset at which to continue reading.

        In place of the damage, return None if nothing readable follows after byte `at`.
        """
        room = self._size - at - HEAD.size
        self.why = (
            "they are zeros"
            if kind == 0
            else f"a record claims to have {length} bytes, but only {room} are left"
        )
        if self._spent_bytes > MOST_DAMAGED_FILES * self._size + MOST_DAMAGED_BYTES:
            self.why = "too much of the file is damaged"
            return None, at
        self._spent_bytes += WINDOW_BYTES
        begin = next_chunk(file, self._known, self._size)
        if kind == 0 and (begin is None or begin > at):
            begin = behind_zeros(file, at, self._size) or begin
        if begin is None:
            end = data_end(file, at, self._size)
            if end is None:
                return None, at
            self.whole, begin = True, end
        self._known = max(self._known, begin + 1)
        last, claimed = self._last
        if begin < at:  # a wrong length has led to byte `at`, past readable records
            at, text = last, f"a record that claims {claimed} bytes, and no record follows there"
        else:
            what = "zeros" if kind == 0 else f"a record of {length} bytes, of which the file has {room},"
            text = f"{what} behind a record that claims {claimed} bytes; {begin - at} bytes are skipped"
        return Damage(at, text, max(1, begin - at)), self._size if self.whole else begin

    def _items(self, kind: int, length: int, file: BinaryIO) -> Iterator[Item]:
        offset = self._last[0]
        place = f"{self.path}: the record at byte {offset}"
        if kind not in (Opcode.CHUNK, Opcode.METADATA, Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE):
            return
        if kind in (Opcode.CHUNK, Opcode.MESSAGE) and length > self._limits.chunk_bytes + CHUNK_HEAD_BYTES:
            raise self._limits.chunk_too_large(place, length)
        if kind not in (Opcode.CHUNK, Opcode.MESSAGE) and length > MAX_DESCRIPTION_BYTES:
            yield Damage(offset, f"a description of {length} bytes", HEAD.size + length)
            return
        file.seek(offset + HEAD.size)
        body = file.read(length)
        stream = ReadDataStream(BytesIO(body))
        try:
            match kind:
                case Opcode.CHUNK:
                    chunk = Chunk.read(stream)
                    if not chunk.data and length > chunk_bytes(chunk):
                        raise McapError("a chunk whose head is gone")
                    yield from _records(_unpacked(chunk, self._limits, place))
                    yield ChunkEnd()
                    self._known = max(self._known, offset + HEAD.size + chunk_bytes(chunk))
                case Opcode.METADATA:
                    yield Metadata.read(stream)
                case Opcode.SCHEMA:
                    yield Schema.read(stream)
                case Opcode.CHANNEL:
                    yield Channel.read(stream)
                case _:
                    yield from _records(HEAD.pack(kind, length) + body)
        except (MemoryError, UsageError):
            raise
        except Exception as error:  # struct, zstandard and mcap raise errors of many types for damaged bytes
            self._known = max(self._known, offset + 1)
            self._spent_bytes += length
            text = str(error) if isinstance(error, McapError | ValueError) else "it cannot be decompressed"
            found = chunk_length(file, offset)
            if found is not None and found.by_fields > length:
                text = f"a chunk that claims to have {length} bytes, but has {found.by_fields} by its fields"
            yield Damage(offset, text, HEAD.size + length)
            yield from self._described(file)

    def _described(self, file: BinaryIO) -> Iterator[Schema | Channel]:
        """Yield the descriptions of channels in the file's summary, once: those before may be damaged."""
        at = None if self._is_described else summary_begin(file, self._size)
        self._is_described = True
        while at is not None and self._size - at >= HEAD.size:
            file.seek(at)
            kind, length = HEAD.unpack(file.read(HEAD.size))
            at += HEAD.size + length
            if length > min(MAX_DESCRIPTION_BYTES, self._size) or kind == Opcode.FOOTER:
                return
            if kind in (Opcode.SCHEMA, Opcode.CHANNEL):
                stream = ReadDataStream(BytesIO(file.read(length)))
                try:
                    yield Schema.read(stream) if kind == Opcode.SCHEMA else Channel.read(stream)
                except (McapError, ValueError, struct.error, EOFError):
                    return


def _ends_with_magic(file: BinaryIO, size: int) -> bool:
    file.seek(size - len(MCAP0_MAGIC))
    return file.read() == MCAP0_MAGIC


def _unpacked(chunk: Chunk, limits: Limits, place: str) -> bytes:
    """Return the decompressed data of a chunk. The size and checksum that the chunk states are checked."""
    most = min(chunk.uncompressed_size, limits.chunk_bytes)
    match chunk.compression:
        case "zstd":
            data = decompressed_zstd(chunk.data, most + 1, limits.chunk_bytes)
        case "lz4":
            data = decompressed_lz4(chunk.data, most + 1)
        case "":
            data = chunk.data
        case _:
            raise McapError(
                f"this program cannot read chunks that are compressed by {chunk.compression[:20]!r}"
            )
    if len(data) > limits.chunk_bytes:
        raise limits.chunk_too_large(place, max(chunk.uncompressed_size, len(data)))
    if len(data) != chunk.uncompressed_size:
        raise McapError(f"a chunk that declares {chunk.uncompressed_size} bytes, but holds another number")
    if chunk.uncompressed_crc not in (0, zlib.crc32(data)):
        raise McapError("a chunk with a wrong checksum")
    return data


def _records(data: bytes) -> Iterator[Schema | Channel | Messages]:
    """Yield the contents of a chunk in the chunk's order."""
    table = np.frombuffer(_native.chunk_records(data), np.int64).reshape(-1, 7)
    kind = table[:, 0]
    if len(table) and table[:, LOG_TIME:].max() > LATEST_NS:
        raise McapError("a message after the year 2116: the clock was wrong")
    described = np.flatnonzero((kind == Opcode.CHANNEL) | (kind == Opcode.SCHEMA))
    begin = 0
    for place in [*described.tolist(), len(kind)]:
        rows = table[begin:place]
        if len(rows):
            yield Messages(data, rows[rows[:, 0] == Opcode.MESSAGE])
        if place < len(kind):
            stream = ReadDataStream(BytesIO(data[table[place, BEGIN] : table[place, END]]))
            yield Channel.read(stream) if kind[place] == Opcode.CHANNEL else Schema.read(stream)
        begin = place + 1
