"""Finds the messages in a damaged log of ArduPilot (DataFlash).

A message begins with two fixed bytes and the number of its kind, and has no checksum. The library for these
logs ends at the first number that it does not know. This module goes on where messages begin again, and
counts the bytes between.
"""

import struct
from array import array
from mmap import mmap
from typing import NamedTuple

HEAD = b"\xa3\x95"
HEAD_BYTES = 3
FORMAT_KIND, FORMAT = 0x80, struct.Struct("<BB4s16s64s")
"""Number and binary format of the messages that describe the others: kind, length, name, fields, columns."""

TYPES = {
    "b": "i1",
    "B": "u1",
    "M": "u1",
    "h": "<i2",
    "H": "<u2",
    "c": "<i2",
    "C": "<u2",
    "i": "<i4",
    "I": "<u4",
    "e": "<i4",
    "E": "<u4",
    "L": "<i4",
    "f": "<f4",
    "g": "<f2",
    "d": "<f8",
    "q": "<i8",
    "Q": "<u8",
    "n": "S4",
    "N": "S16",
    "Z": "S64",
    "a": "(32,)<i2",
}
"""Types of fields, by the letters of a format. Source:
ardupilot.org/dev/docs/code-overview-adding-a-new-log-message.html.
"""

BYTES = {**dict.fromkeys("bBM", 1), **dict.fromkeys("hHcCg", 2), **dict.fromkeys("iIeELf", 4)}
BYTES |= {**dict.fromkeys("dqQ", 8), "n": 4, "N": 16, "Z": 64, "a": 64}

MOST_PADDING = 528
"""A log may end with padding of zeros or ones, since it is written in pages. As in ArduPilot's library, there
are fewer than this number of bytes of padding.
"""


class Form(NamedTuple):
    """Format of a kind of messages. `length`: with the head [bytes]. `fields`: a letter for each column."""

    name: str
    length: int
    fields: str
    columns: list[str]


class Found(NamedTuple):
    """The messages of a log. `forms`: by kind. `offsets`: offsets of the messages in the log, by kind.

    `holes`: number of places whose bytes belong to no message; `lost_bytes`: length of all holes; `first`:
    offset of the first. `tail`: bytes after the last message.
    """

    forms: dict[int, Form]
    offsets: "dict[int, array[int]]"
    holes: int
    lost_bytes: int
    first: int
    tail: bytes


def messages_in(content: mmap) -> Found:
    """Find all messages of a log."""
    scan = _LogScan(content)
    scan.run()
    return scan.found()


class _LogScan:
    def __init__(self, content: mmap) -> None:
        self._content, self._size = content, len(content)
        fields = Form(
            "FMT", HEAD_BYTES + FORMAT.size, "BBnNZ", ["Type", "Length", "Name", "Format", "Columns"]
        )
        self._forms = {FORMAT_KIND: fields}
        self._lengths = {FORMAT_KIND: fields.length}
        self._offsets: dict[int, array[int]] = {}
        self._holes: list[tuple[int, int]] = []
        self._searched = (0, -1)

    def found(self) -> Found:
        """Return the messages that were found."""
        end = self._holes.pop()[0] if self._holes and self._holes[-1][1] == self._size else self._size
        lost, first = sum(end - at for at, end in self._holes), self._holes[0][0] if self._holes else 0
        return Found(self._forms, self._offsets, len(self._holes), lost, first, self._content[end:])

    def run(self) -> None:
        """Go through the log from message to message, and search for the next one where none follows."""
        at = 0
        while at < self._size:
            end = self._end(at)
            if end and self._follows(end):
                self._take(at)
                at = end
                continue
            following = self._search(at + 1)
            if end and end <= following and self._is_sure(at, end, following):
                self._take(at)
                at = end
                continue
            if self._holes and self._holes[-1][1] == at:
                at = self._holes.pop()[0]
            self._holes.append((at, following))
            at = following

    def _follows(self, end: int) -> bool:
        """Return whether another message, padding or the end of the log follows at byte `end`."""
        begin = self._content[end : end + len(HEAD)]
        if begin == HEAD or HEAD.startswith(begin):
            return True
        return self._size - end < MOST_PADDING and not self._content[end:].strip(b"\0\xff")

    def _is_sure(self, at: int, end: int, following: int) -> bool:
        """Return whether a message is whole although no message follows on it, but first at `following`.

        It is if only the head of the next message is damaged, which fills the bytes between. Otherwise bytes
        of this message may be missing, or the number of its kind may be wrong, so that it would be read with
        bytes of another one. Descriptions of formats are checked by themselves.
        """
        known = self._lengths.values()
        is_next = following - end in known and following - at not in known
        return self._content[at + 2] == FORMAT_KIND or is_next

    def _take(self, at: int) -> None:
        kind = self._content[at + 2]
        self._offsets.setdefault(kind, array("q")).append(at)
        if kind == FORMAT_KIND and (told := self._form(at)):
            self._searched = (0, -1)
            self._forms[told[0]] = told[1]
            self._lengths[told[0]] = told[1].length

    def _end(self, at: int) -> int:
        """Return where the message at `at` ends; 0 if there is no whole message."""
        content = self._content
        if content[at : at + len(HEAD)] != HEAD or at + HEAD_BYTES > self._size:
            return 0
        kind = content[at + 2]
        end = at + self._lengths.get(kind, self._size + 1)
        if end > self._size or (kind == FORMAT_KIND and not self._form(at)):
            return 0
        return end

    def _form(self, at: int) -> tuple[int, Form] | None:
        """Return the kind and the format that the message at `at` describes; None if it is damaged."""
        kind, length, *texts = FORMAT.unpack_from(self._content, at + HEAD_BYTES)
        name, fields, columns = (one.split(b"\0")[0].decode("latin-1") for one in texts)
        names = columns.split(",") if columns else []
        is_known = all(letter in BYTES for letter in fields)
        if is_known and HEAD_BYTES + sum(BYTES[letter] for letter in fields) != length:
            return None
        if len(names) != len(fields) or not (name.isalnum() and length > HEAD_BYTES):
            return None
        return kind, Form(name, length, fields, names)

    def _search(self, at: int) -> int:
        """Return the next offset at which a message begins that another one follows, or the log's end."""
        if self._searched[0] <= at <= self._searched[1]:
            return self._searched[1]
        begin = at
        while (at := self._content.find(HEAD, at)) >= 0:
            end = self._end(at)
            if end and self._follows(end):
                break
            at += 1
        self._searched = begin, at if at >= 0 else self._size
        return self._searched[1]
