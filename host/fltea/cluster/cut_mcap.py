"""Cuts MCAP files of fltea and ROS into pieces.

A piece is the file's schemas and channels, followed by some of its chunks.
"""

import struct
from bisect import bisect_left
from io import BytesIO
from typing import NamedTuple

import msgspec
from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, ChunkIndex, DataEnd, Footer, Metadata, MetadataIndex, Schema
from mcap.stream_reader import StreamReader
from mcap.writer import MCAP0_MAGIC

from fltea.cluster.cut import Cut, Ranges, even_pieces
from fltea.recording.resync import HEAD
from fltea.recording.scan import MAX_DESCRIPTION_BYTES
from fltea.recording.session import HELLO, SESSION, PartInfo, from_metadata
from fltea.records.records import Hello

FOOTER_BYTES = HEAD.size + 20 + len(MCAP0_MAGIC)
MOST_SUMMARY_BYTES = 256 << 20
"""Largest summary section that is read [bytes]; a file of 1 TB in chunks of 1 MB has a summary of 100 MB."""


class _Summary(NamedTuple):
    header: bytes
    descriptions: bytes
    """Schemas and channels of the file, as MCAP records."""
    chunks: list[int]
    """Offsets of the chunks [bytes]."""
    end: int
    """Offset of the end of the last chunk [bytes]."""
    metadata: list[MetadataIndex]


def cuts(source: Ranges, block_bytes: int) -> list[Cut]:
    """Return the pieces of a file.

    The list is empty if the file has no index, for instance because its writer was killed.
    """
    try:
        summary = _summary(source)
        if summary is None:
            return []
        session = _session(source, summary)
        pieces = even_pieces(summary.chunks, summary.end, block_bytes)
        return [
            Cut(begin, end, _head(source, summary, session, number, begin), _TAIL)
            for number, (begin, end) in enumerate(pieces)
        ]
    # The library raises various errors for damaged bytes. The file is then read whole, so that the damage is
    # reported.
    except (McapError, ValueError, struct.error, EOFError, IndexError):
        return []


def _tail() -> bytes:
    out = RecordBuilder()
    DataEnd(0).write(out)
    Footer(0, 0, 0).write(out)
    return _bytes(out) + MCAP0_MAGIC


def _bytes(out: RecordBuilder) -> bytes:
    found: bytes = out.end()  # type: ignore[no-untyped-call]
    return found


_TAIL = _tail()


def _one(source: Ranges, begin: int, kind: int) -> bytes:
    """Return the content of the record at offset `begin`, which must be of the given kind."""
    found, length = HEAD.unpack(source.read(begin, begin + HEAD.size))
    if found != kind or length > MAX_DESCRIPTION_BYTES:
        raise ValueError("another record stands there")
    return source.read(begin + HEAD.size, begin + HEAD.size + length)


def _summary(source: Ranges) -> _Summary | None:
    magic = len(MCAP0_MAGIC)
    footer = source.read(source.size - FOOTER_BYTES, source.size)
    if len(footer) != FOOTER_BYTES or footer[-magic:] != MCAP0_MAGIC or footer[0] != Opcode.FOOTER:
        return None
    begin = Footer.read(_stream(footer[HEAD.size :])).summary_start
    if not 0 < begin < source.size or source.size - begin > MOST_SUMMARY_BYTES:
        return None
    descriptions, chunks, end, metadata = RecordBuilder(), [], 0, []
    for record in StreamReader(BytesIO(source.read(begin, source.size)), skip_magic=True).records:
        match record:
            case Schema() | Channel():
                record.write(descriptions)
            case ChunkIndex():
                chunks.append(record.chunk_start_offset)
                end = max(end, record.chunk_start_offset + record.chunk_length)
            case MetadataIndex():
                metadata.append(record)
    _, length = HEAD.unpack(source.read(magic, magic + HEAD.size))
    if not chunks or end > begin or length > MAX_DESCRIPTION_BYTES:
        return None
    header = source.read(0, magic + HEAD.size + length)
    metadata.sort(key=lambda one: one.offset)
    return _Summary(header, _bytes(descriptions), sorted(chunks), end, metadata)


def _session(source: Ranges, summary: _Summary) -> PartInfo | None:
    """Return the metadata of the session in a file that fltea wrote; None for other files."""
    for one in summary.metadata:
        if one.name == SESSION:
            return from_metadata(_metadata(source, one.offset))
    return None


def _metadata(source: Ranges, begin: int) -> dict[str, str]:
    found: dict[str, str] = Metadata.read(_stream(_one(source, begin, Opcode.METADATA))).metadata
    return found


def _head(source: Ranges, summary: _Summary, session: PartInfo | None, number: int, begin: int) -> bytes:
    out = RecordBuilder()
    if session is not None:
        if number:  # the piece gets the metadata that a file would have which begins with this piece
            # The recorder collects samples until a chunk is full, but writes a HELLO at once. So a HELLO that
            # is stored between the previous chunk and this piece is newer than the piece's first samples. At
            # these samples, the newest HELLO was one that is stored before the previous chunk.
            before = summary.chunks[bisect_left(summary.chunks, begin) - 1]
            heard = [one for one in summary.metadata if one.name == HELLO and one.offset < before]
            hello = session.hello
            if heard:
                hello = msgspec.convert(_metadata(source, heard[-1].offset), Hello, strict=False)
            session = msgspec.structs.replace(session, part=session.part + number, hello=hello)
        Metadata(SESSION, session.to_metadata()).write(out)
    return summary.header + _bytes(out) + summary.descriptions


def _stream(data: bytes) -> ReadDataStream:
    return ReadDataStream(BytesIO(data))
