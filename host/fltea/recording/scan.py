"""Reads one MCAP file as far as it can be read: whole, torn at its end, or damaged within."""

import struct
from collections.abc import Iterator, Sequence
from io import BytesIO
from pathlib import Path
from typing import BinaryIO, NamedTuple

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Metadata, Schema
from mcap.stream_reader import get_chunk_data_stream
from mcap.writer import MCAP0_MAGIC

HEAD = struct.Struct("<BQ")
"""Of every record: its kind and the length of what follows."""

MAX_CHUNK_BYTES = 1 << 30
"""No chunk of ours has a thousandth of it; a damaged length must not fill the memory."""


MESSAGE_HEAD = struct.Struct("<HIQQ")


class Message(NamedTuple):
    """As the library's, which takes five times as long to read: of a recording there are millions."""

    channel_id: int
    sequence: int
    log_time: int
    publish_time: int
    data: bytes


class Damage(NamedTuple):
    """A chunk that cannot be read; the records after it can. offset: in the file [bytes]."""

    offset: int
    text: str


class ChunkEnd(NamedTuple):
    """All messages of a chunk have been given."""


Item = Schema | Channel | Message | Metadata | Damage | ChunkEnd


class Scan:
    """One pass through a file; memory for one chunk.

    After it, `whole` says whether the file was finished in an orderly way, and `lost_bytes` how much of its
    end cannot be read.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.whole = False
        self.lost_bytes = 0

    def __iter__(self) -> Iterator[Item]:
        """Yield what is in the file, in its order.

        Raises:
            OSError: the file cannot be read.
            ValueError: it is no MCAP file.
        """
        with self.path.open("rb") as file:
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
                yield from _items(kind, length, file)
                good = file.tell()
            self.lost_bytes = size - good


def _ends_with_magic(file: BinaryIO, size: int) -> bool:
    file.seek(size - len(MCAP0_MAGIC))
    return file.read() == MCAP0_MAGIC


def _items(kind: int, length: int, file: BinaryIO) -> Sequence[Item]:
    offset = file.tell() - HEAD.size
    if kind not in (Opcode.CHUNK, Opcode.METADATA, Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE):
        file.seek(length, 1)
        return ()
    stream = ReadDataStream(BytesIO(file.read(length)))
    try:
        match kind:
            case Opcode.CHUNK:
                return (*_chunk(stream), ChunkEnd())
            case Opcode.METADATA:
                return (Metadata.read(stream),)
            case Opcode.SCHEMA:
                return (Schema.read(stream),)
            case Opcode.CHANNEL:
                return (Channel.read(stream),)
            case _:
                return (_message(stream.read(length)),)
    except MemoryError:
        raise
    except Exception as error:  # whatever struct, zstandard and the library raise on damaged bytes
        return (Damage(offset, f"{type(error).__name__}: {error}"),)


def _chunk(stream: ReadDataStream) -> list[Schema | Channel | Message]:
    chunk = Chunk.read(stream)
    if chunk.uncompressed_size > MAX_CHUNK_BYTES:
        raise McapError(f"a chunk of {chunk.uncompressed_size} bytes")
    content, size = get_chunk_data_stream(chunk, validate_crc=True)
    data = content.read(size)
    found: list[Schema | Channel | Message] = []
    at = 0
    while at < size:
        kind, length = HEAD.unpack_from(data, at)
        body, at = data[at + HEAD.size : at + HEAD.size + length], at + HEAD.size + length
        if kind == Opcode.MESSAGE:
            found.append(_message(body))
        elif kind == Opcode.CHANNEL:
            found.append(Channel.read(ReadDataStream(BytesIO(body))))
        elif kind == Opcode.SCHEMA:
            found.append(Schema.read(ReadDataStream(BytesIO(body))))
    return found


def _message(body: bytes) -> Message:
    channel_id, sequence, log_time, publish_time = MESSAGE_HEAD.unpack_from(body)
    return Message(channel_id, sequence, log_time, publish_time, body[MESSAGE_HEAD.size :])
