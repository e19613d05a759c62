"""Reads one MCAP file as far as it can be read: whole, torn at its end, or damaged within."""

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
from fltea.recording.session import LATEST_NS
from fltea.recording.unpack import unpacked_lz4, unpacked_zstd
from fltea.records.errors import UsageError
from fltea.records.events import Ints
from fltea.records.small_file import open_file
from fltea.settings.limits import DEFAULT_LIMITS, Limits

HEAD = struct.Struct("<BQ")
"""Of every record: its kind and the length of what follows."""

CHUNK_HEAD_BYTES = 1 << 10
"""More than what stands before the data in a chunk."""

MAX_DESCRIPTION_BYTES = 16 << 20
"""Of metadata, a schema or a channel: thousands of times what ours have. In memory it is ten times larger."""

BEGIN, END, CHANNEL, SEQUENCE, LOG_TIME, PUBLISH_TIME = range(1, 7)
"""Columns of `Messages.table`."""


class Message(NamedTuple):
    """As the library's, which takes five times as long to read."""

    channel_id: int
    sequence: int
    log_time: int
    publish_time: int
    data: bytes


@dataclass(frozen=True)
class Messages:
    """Successive messages: of a recording there are millions, so they stay in a table.

    table: (n, 7), of each message its kind, where its content begins and ends in `data`, channel, sequence,
    log and publish time.
    """

    data: bytes
    table: Ints

    def of_channels(self, channels: Collection[int]) -> "Messages":
        """Those of some channels."""
        rows = np.isin(self.table[:, CHANNEL], list(channels))
        return self if rows.all() else Messages(self.data, self.table[rows])

    def each(self) -> Iterator[Message]:
        """One by one."""
        for _, begin, end, channel, sequence, log_ns, publish_ns in self.table.tolist():
            yield Message(channel, sequence, log_ns, publish_ns, self.data[begin:end])


class Damage(NamedTuple):
    """A chunk that cannot be read; the records after it can. offset: in the file [bytes]."""

    offset: int
    text: str

    @property
    def said(self) -> str:
        """The same for a person."""
        return f"is damaged at byte {self.offset} ({self.text})"


class ChunkEnd(NamedTuple):
    """All messages of a chunk have been given."""


Item = Schema | Channel | Messages | Metadata | Damage | ChunkEnd


class Scan:
    """One pass through a file; memory for one chunk.

    After it, `whole` says whether the file was finished in an orderly way, and `lost_bytes` how much of its
    end cannot be read.
    """

    def __init__(self, path: Path, limits: Limits = DEFAULT_LIMITS) -> None:
        self.path = path
        self._limits = limits
        self.whole = False
        self.lost_bytes = 0

    def __iter__(self) -> Iterator[Item]:
        """Yield what is in the file, in its order.

        Raises:
            OSError: the file cannot be read.
            ValueError: it is no MCAP file.
            UsageError: a record of it would take more memory than the limits allow.
        """
        with open_file(self.path) as file:
            size = file.seek(0, 2)
            file.seek(0)
            magic = file.read(len(MCAP0_MAGIC))
            if not MCAP0_MAGIC.startswith(magic):
                raise ValueError("it is no MCAP file")
            good = len(magic)
            while (head := file.read(HEAD.size)) and len(head) == HEAD.size:
                kind, length = HEAD.unpack(head)
                if kind == 0 or length > size - file.tell():
                    break  # torn, or the zeros that a power cut leaves
                if kind == Opcode.DATA_END:  # only summary and indexes follow
                    self.whole = _ends_with_magic(file, size)
                    good = size
                    break
                yield from self._items(kind, length, file)
                good = file.tell()
            self.lost_bytes = size - good

    def _items(self, kind: int, length: int, file: BinaryIO) -> Iterator[Item]:
        offset = file.tell() - HEAD.size
        place = f"{self.path}: the record at byte {offset}"
        if kind not in (Opcode.CHUNK, Opcode.METADATA, Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE):
            file.seek(length, 1)
            return
        if kind in (Opcode.CHUNK, Opcode.MESSAGE) and length > self._limits.chunk_bytes + CHUNK_HEAD_BYTES:
            raise self._limits.chunk_too_large(place, length)
        if kind not in (Opcode.CHUNK, Opcode.MESSAGE) and length > MAX_DESCRIPTION_BYTES:
            file.seek(length, 1)
            yield Damage(offset, f"a description of {length} bytes")
            return
        body = file.read(length)
        stream = ReadDataStream(BytesIO(body))
        try:
            match kind:
                case Opcode.CHUNK:
                    yield from _records(_unpacked(Chunk.read(stream), self._limits, place))
                    yield ChunkEnd()
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
        except Exception as error:  # whatever struct, zstandard and the library raise on damaged bytes
            yield Damage(offset, f"{type(error).__name__}: {error}")


def _ends_with_magic(file: BinaryIO, size: int) -> bool:
    file.seek(size - len(MCAP0_MAGIC))
    return file.read() == MCAP0_MAGIC


def _unpacked(chunk: Chunk, limits: Limits, place: str) -> bytes:
    """The content of a chunk. Its declared size is believed only as far as the content bears it out."""
    most = min(chunk.uncompressed_size, limits.chunk_bytes)
    match chunk.compression:
        case "zstd":
            data = unpacked_zstd(chunk.data, most + 1, limits.chunk_bytes)
        case "lz4":
            data = unpacked_lz4(chunk.data, most + 1)
        case "":
            data = chunk.data
        case _:
            raise McapError(f"no reader for chunks that are packed by {chunk.compression[:20]!r}")
    if len(data) > limits.chunk_bytes:
        raise limits.chunk_too_large(place, max(chunk.uncompressed_size, len(data)))
    if len(data) != chunk.uncompressed_size:
        raise McapError(f"a chunk that declares {chunk.uncompressed_size} bytes and does not hold as many")
    if chunk.uncompressed_crc not in (0, zlib.crc32(data)):
        raise McapError("a chunk with a wrong checksum")
    return data


def _records(data: bytes) -> Iterator[Schema | Channel | Messages]:
    """What is in a chunk, in its order."""
    table = np.frombuffer(_native.chunk_records(data), np.int64).reshape(-1, 7)
    kind = table[:, 0]
    if len(table) and table[:, LOG_TIME:].max() > LATEST_NS:
        raise McapError("a message of a time that cannot be")
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
