"""Finds the next record of an MCAP file after invalid bytes, such as a hole or a wrong length of a record."""

import errno
import os
import struct
from typing import BinaryIO, NamedTuple

from mcap.opcode import Opcode
from mcap.records import Chunk
from mcap.writer import MCAP0_MAGIC

HEAD = struct.Struct("<BQ")
"""Binary format of a record's header: opcode of the record, and length of the record's data."""

DATA_END_BYTES = 4
FOOTER = struct.Struct("<BQQQI")

LONGEST_SUMMARY = 16 << 20
"""If a summary is not where the file says, it is searched for in this number of bytes at the file's end."""

PACKERS = (b"\x04\x00\x00\x00zstd", b"\x03\x00\x00\x00lz4")
"""Names of the two methods of compression, as chunks store them. The search for the next chunk looks for
these names, so the search cannot find chunks that are not compressed.
"""

PACKER_AT = HEAD.size + 28
"""Offset in a chunk record at which the name of the compression method begins [bytes]. Before it stand the
chunk's times, size and checksum.
"""

WINDOW_BYTES = 1 << 16
IN_A_ROW = 3
"""A position counts as the beginning of a record if this number of consecutive headers, from there on, are
valid.
"""


LAST_KIND = Opcode.DATA_END
"""Highest opcode of a record that MCAP defines. Other programs, or later versions of MCAP, define higher
opcodes.
"""


def begins_record(file: BinaryIO, at: int, size: int) -> bool:
    """Return True if a record may begin at byte `at`, or if the file ends there; else False.

    A record may begin there if the bytes can be a header: an opcode, and a length that fits into the file.
    Few other bytes look like this. One exception is the end of a time stamp, followed by a small number: it
    may look like a header with an unknown opcode. So such a header is accepted only if a known opcode stands
    where its record ends.
    """
    file.seek(at)
    head = file.read(HEAD.size)
    if len(head) < HEAD.size:
        return not head
    kind, length = HEAD.unpack(head)
    if kind == 0 or length > size - at - HEAD.size or (kind == Opcode.DATA_END and length != DATA_END_BYTES):
        return False
    if kind <= LAST_KIND:
        return True
    file.seek(at + HEAD.size + length)
    return 0 < int.from_bytes(file.read(1)) <= LAST_KIND


class ChunkLength(NamedTuple):
    """The length of a chunk, found in two ways.

    `claimed`: the length that the chunk's header states. `by_fields`: the sum of the lengths of its fields.
    """

    claimed: int
    by_fields: int


def chunk_length(file: BinaryIO, at: int) -> ChunkLength | None:
    """Return stated and computed length of the chunk at byte `at`; None if no chunk can begin there."""
    file.seek(at)
    data = file.read(PACKER_AT + 64)
    if len(data) < PACKER_AT + 12 or data[0] != Opcode.CHUNK:
        return None
    _, claimed = HEAD.unpack_from(data)
    (name,) = struct.unpack_from("<I", data, PACKER_AT)
    if name > 32 or len(data) < PACKER_AT + 12 + name:
        return None
    (packed,) = struct.unpack_from("<Q", data, PACKER_AT + 4 + name)
    return ChunkLength(claimed, _chunk_bytes(name, packed))


def chunk_bytes(chunk: Chunk) -> int:
    """Return the length of a chunk record without the record's header [bytes]."""
    return _chunk_bytes(len(chunk.compression), len(chunk.data))


def _chunk_bytes(packer: int, packed: int) -> int:
    return PACKER_AT - HEAD.size + 4 + packer + 8 + packed


def behind_zeros(file: BinaryIO, at: int, size: int) -> int | None:
    """Skip the zeros that begin at byte `at`.

    Return the offset of the first byte after them if valid records begin there, else None.
    """
    data_at = begin = _data_at(file, at, size)
    for _ in range(IN_A_ROW):
        if begin is None or not begins_record(file, begin, size):
            return None
        if begin == size:
            break
        file.seek(begin)
        kind, length = HEAD.unpack(file.read(HEAD.size))
        if kind == Opcode.DATA_END:
            break
        begin += HEAD.size + length
    return data_at


def next_chunk(file: BinaryIO, begin: int, size: int) -> int | None:
    """Return the offset of the next compressed chunk whose two lengths (see `ChunkLength`) agree.

    Return None if there is no such chunk.
    """
    at = begin
    while (data_at := _data_at(file, at, size)) is not None:
        at = max(begin, data_at - PACKER_AT)
        file.seek(at)
        window = file.read(WINDOW_BYTES)
        if not window:  # another program truncated the file during the search
            return None
        for place in _places(window):
            one = at + place - PACKER_AT
            lengths = chunk_length(file, one) if one >= begin else None
            if lengths and lengths.claimed == lengths.by_fields <= size - one - HEAD.size:
                return one
        if at + len(window) >= size:
            return None
        at += len(window) - len(PACKERS[0])
    return None


def data_end(file: BinaryIO, begin: int, size: int) -> int | None:
    """Return the offset of the file's summary if the file has a summary after byte `begin`; else None."""
    at = size - FOOTER.size - len(MCAP0_MAGIC)
    if at < begin:
        return None
    file.seek(at)
    data = file.read()
    kind, length, summary, _, _ = FOOTER.unpack_from(data)
    if data[FOOTER.size :] != MCAP0_MAGIC or (kind, length) != (Opcode.FOOTER, FOOTER.size - HEAD.size):
        return None
    return summary if begin < summary <= at else None


def summary_begin(file: BinaryIO, size: int) -> int | None:
    """Return the offset of the file's summary, even if bytes before it are missing; None if there is none."""
    end = size - FOOTER.size - len(MCAP0_MAGIC)
    claimed = data_end(file, 0, size)
    if claimed is None or _is_chain(file, claimed, end):
        return claimed
    begin = max(0, end - LONGEST_SUMMARY)
    file.seek(begin)
    tail, mark = file.read(end - begin), HEAD.pack(Opcode.DATA_END, DATA_END_BYTES)
    place = tail.rfind(mark)
    while place >= 0:
        found = begin + place + HEAD.size + DATA_END_BYTES
        if _is_chain(file, found, end):
            return found
        place = tail.rfind(mark, 0, place)
    return None


def _is_chain(file: BinaryIO, at: int, end: int) -> bool:
    """Return whether records follow on each other from byte `at` to byte `end`."""
    while at < end:
        file.seek(at)
        kind, length = HEAD.unpack(file.read(HEAD.size))
        if not 0 < kind <= LAST_KIND:
            return False
        at += HEAD.size + length
    return at == end


def _data_at(file: BinaryIO, begin: int, size: int) -> int | None:
    """Return the offset of the next byte that is not 0. The holes of a sparse file are skipped."""
    at = begin
    while at < size:
        try:
            at = file.seek(at, os.SEEK_DATA)
        except OSError as error:
            if error.errno == errno.ENXIO:
                return None
            file.seek(at)  # this file system cannot say where the holes of a file are
        window = file.read(WINDOW_BYTES)
        if rest := window.lstrip(b"\0"):
            return at + len(window) - len(rest)
        at += len(window) or size
    return None


def _places(window: bytes) -> list[int]:
    """Return all offsets in `window`, a part of the file, at which the name of a compression stands."""
    found = []
    for name in PACKERS:
        place = window.find(name)
        while place >= 0:
            found.append(place)
            place = window.find(name, place + 1)
    return sorted(found)
