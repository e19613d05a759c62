"""Reads the records of a bag of ROS 1, and finds the next one after damage."""

import struct
from collections.abc import Callable, Iterator
from typing import BinaryIO, NamedTuple


class Op:
    """Types of a bag's records: values of the field `op` in a record's header."""

    MESSAGE, BAG_HEADER, INDEX_DATA = b"\x02", b"\x03", b"\x04"
    CHUNK, CHUNK_INFO, CONNECTION = b"\x05", b"\x06", b"\x07"


OUTER, INNER = (Op.INDEX_DATA, Op.CHUNK, Op.CHUNK_INFO), (Op.MESSAGE, Op.CONNECTION)
"""Types of records that are only outside of chunks, and types of those in chunks."""

LONGEST_HEADER = 1 << 20
DAMAGE = (struct.error, ValueError, KeyError)
"""Errors that are raised when damaged records are read."""

LENGTH = struct.Struct("<I")
OP_FIELD = b"\x04\x00\x00\x00op="
BEFORE_OP = 200
"""The field `op` begins at most this number of bytes after the beginning of a record's header."""

WINDOW_BYTES = 1 << 18


class Record(NamedTuple):
    """Header of a record. `length`: length of the record's data, which follow its header [bytes]."""

    fields: dict[bytes, bytes]
    length: int


def next_record(file: BinaryIO, size: int) -> Record | None:
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
        return Record(read_fields(header), LENGTH.unpack(head)[0])
    except ValueError:
        return None


def read_fields(header: bytes) -> dict[bytes, bytes]:
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


class FileBytes:
    """A file whose bytes are read as those of a `bytes` are, a part at a time. `size`: its length."""

    def __init__(self, file: BinaryIO, size: int) -> None:
        self._file, self._size = file, size

    def __len__(self) -> int:
        return self._size

    def __getitem__(self, place: slice) -> bytes:
        begin, end, _ = place.indices(self._size)
        self._file.seek(begin)
        return self._file.read(end - begin)

    def find(self, pattern: bytes, begin: int) -> int:
        """Return the offset of the next occurrence of a pattern, or -1."""
        while begin < self._size and (window := self[begin : begin + WINDOW_BYTES]):
            if (place := window.find(pattern)) >= 0:
                return begin + place
            begin += max(len(window) - len(pattern) + 1, 1)
        return -1


Content = bytes | FileBytes


class Place(NamedTuple):
    """A record in some bytes: its fields, begin and end of its data."""

    fields: dict[bytes, bytes]
    begin: int
    end: int


def record_at(content: Content, at: int) -> Place | None:
    """Return the record that begins at byte `at`; None if none does.

    The end of its data may lie after the end of the content.
    """
    length = int.from_bytes(content[at : at + LENGTH.size], "little")
    begin = at + LENGTH.size + length + LENGTH.size
    if length > LONGEST_HEADER or begin > len(content):
        return None
    try:
        fields = read_fields(content[at + LENGTH.size : begin - LENGTH.size])
    except ValueError:
        return None
    end = begin + int.from_bytes(content[begin - LENGTH.size : begin], "little")
    return Place(fields, begin, end) if b"op" in fields else None


def follows(content: Content, end: int) -> bool:
    """Return whether the content ends at byte `end`, or another record begins there."""
    return end == len(content) or (end < len(content) and record_at(content, end) is not None)


def find_record(content: Content, begin: int, kinds: tuple[bytes, ...]) -> int:
    """Return where the next record of one of some types begins, from byte `begin` on; else the content's end.

    It counts only if another record, or the end of the content, follows on it.
    """
    at = begin
    while (at := content.find(OP_FIELD, at)) >= 0:
        if content[at + len(OP_FIELD) : at + len(OP_FIELD) + 1] in kinds:
            for one in range(at - LENGTH.size, max(begin, at - BEFORE_OP) - 1, -1):
                place = record_at(content, one)
                is_one = place and place.begin > at and place.fields[b"op"] in kinds
                if place and is_one and follows(content, place.end):
                    return one
        at += 1
    return len(content)


def records_in(data: bytes, damaged: Callable[[str], None]) -> Iterator[tuple[dict[bytes, bytes], bytes]]:
    """Yield the fields and the data of the records in a chunk. Behind damage go on at the next record.

    A record counts only if another one, or the end of the chunk, follows on it: otherwise its length is
    wrong, or bytes of it are missing.

    `damaged`: is called with a text that says what is wrong with the chunk.
    """
    at, size, place = 0, len(data), record_at(data, 0)
    while at < size:
        after = record_at(data, place.end) if place is not None and place.end < size else None
        if place is not None and (after is not None or place.end == size):
            yield place.fields, data[place.begin : place.end]
            at, place = place.end, after
            continue
        found = find_record(data, at + 1, INNER)
        damaged(f"{found - at} bytes at byte {at} of it are no record")
        at, place = found, record_at(data, found)
