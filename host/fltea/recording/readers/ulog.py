"""Checks each message in a PX4 log (ULog) before PX4's library reads the log.

A message begins with its length and has no checksum. After a wrong length, PX4's library stops, or continues
at a later message, and does not report all that it left out. This module treats the damaged bytes as a hole,
which ends where valid messages begin again, and counts the bytes of the hole.
"""

import re
import struct
from collections import Counter
from collections.abc import Callable, Mapping
from mmap import mmap
from typing import NamedTuple

HEAD = struct.Struct("<HB")
"""Binary format of a message's header: length of the body, and kind of the message."""

FILE_HEAD_BYTES = 16
"""Length of the log's header, which holds magic bytes, version and time [bytes]."""

SYNC = bytes.fromhex("2f731320250cbb12")
"""Content of a message of the kind S, which helps to find messages after damage."""

SIZES = {
    **dict.fromkeys(("int8_t", "uint8_t", "bool", "char"), 1),
    **dict.fromkeys(("int16_t", "uint16_t"), 2),
    **dict.fromkeys(("int32_t", "uint32_t", "float"), 4),
    **dict.fromkeys(("int64_t", "uint64_t", "double"), 8),
}
"""Size of a message's field [bytes], by the type of the field."""

MOST_BYTES = 1 << 16
LONGEST_NAME = 256
MOST_NESTED = 16
"""Largest number of levels to which formats of messages may contain each other."""

FORMAT = re.compile(rb"([\w/-]+):((?:[\w/-]+(?:\[\d{1,5}\])? [\w/-]+;)+)")
FIELD = re.compile(r"([\w/-]+)(?:\[(\d+)\])? ([\w/-]+);")
KEY = re.compile(rb"(\w+)(?:\[(\d{1,5})\])? [!-~]+")
"""Matches the key of an information or parameter message: the type and the name of the message's value."""

KINDS = re.compile(rb"[ACDFILMOPQRS]")
"""Matches a letter that is, by PX4's documentation, a kind of message."""

SURE, ANY_LENGTH, TELLING = b"ADIMPQS", b"CL", b"AF"
"""Three sets of kinds of messages. SURE: random bytes rarely look like such a message. ANY_LENGTH: such a
message holds a text of any length. TELLING: such a message describes later messages.
"""

PADDING = "_padding"

FLAGS_AT = FILE_HEAD_BYTES + HEAD.size
APPENDED_AT, APPENDED = FLAGS_AT + 8, struct.Struct("<B7x3Q")
"""After a crash of the logger, data may have been appended to the log. If so, flags in the log say this, and
are followed by the offsets of the appended data. APPENDED_AT is the offset of the flags in the log. APPENDED
is the binary format of flags and offsets.
"""


class Mended(NamedTuple):
    """Result of the check of a log.

    `data`: copy of the log without its damaged parts; b"" if the log is intact. `holes`: number of damaged
    parts; `lost_bytes`: their total length; `first`: offset of the first one. `cut_bytes`: length of a
    truncated last message. `odd`: number of messages that cannot be read, such as those of an unknown kind.
    `counts`: number of messages by topic and sensor. `twice`: names of formats that the log declares again
    with other fields. `is_settled`: whether the length of the messages tells which declaration is right.
    """

    data: bytes
    holes: int
    lost_bytes: int
    first: int
    cut_bytes: int
    odd: int
    counts: Mapping[tuple[str, int], int]
    twice: tuple[str, ...] = ()
    is_settled: bool = True

    @property
    def is_whole(self) -> bool:
        """Whether the log is intact and can be read as it is."""
        return not self.data


def mended(content: bytes | mmap) -> Mended:
    """Check all messages of a log.

    Return the result, which contains a copy of the log without its damaged parts.
    """
    first, last = (_LogScan(content, keeps_first=keeps_first) for keeps_first in (True, False))
    first.run()
    found = first.found()
    if not found.twice:
        return found
    last.run()
    other = last.found()
    if found.counts == other.counts:
        return found._replace(is_settled=False)
    return max(found, other, key=lambda one: sum(one.counts.values()))


_Field = tuple[str, int, str]
"""A field of a format: its type, the number of values, and its name."""


class _Topic(NamedTuple):
    """A topic to which the log has given a number.

    `size`: length of one of its messages without padding [bytes]. `padded`: this length with padding [bytes].
    """

    name: str
    sensor: int
    size: int
    padded: int


class _Formats:
    """The formats of messages that the log has declared so far: the fields of each, by the format's name.

    `keeps_first`: whether the first of two declarations of a format is kept, or the last. `twice`: formats
    that are declared again with other fields.
    """

    def __init__(self, *, keeps_first: bool) -> None:
        self._fields: dict[str, list[_Field]] = {}
        self._lengths = dict(SIZES)
        self._keeps_first = keeps_first
        self.twice: dict[str, None] = {}

    def add(self, name: str, fields: list[_Field]) -> bool:
        """Add a format. Return False if an earlier declaration is kept instead."""
        if self._fields.get(name, fields) != fields:
            self.twice[name] = None
            if self._keeps_first:
                return False
        self._fields[name] = fields
        self._lengths = dict(SIZES)
        return True

    def sizes(self, name: str) -> tuple[int, int]:
        """Return two lengths of a format's messages: without the padding at their end, and with the padding.

        Both include the two bytes of the topic number [bytes].

        Both lengths are 0 if the length is unknown.
        """
        fields = self._fields.get(name, [])
        sizes = [self._length(kind, MOST_NESTED) * many for kind, many, _ in fields]
        if not fields or 0 in sizes or sum(sizes) > MOST_BYTES:
            return 0, 0
        padded = 2 + sum(sizes)
        while sizes and fields[len(sizes) - 1][2].startswith(PADDING):
            sizes.pop()
        return 2 + sum(sizes), padded

    def _length(self, kind: str, most_nested: int) -> int:
        """Return the length of a field of the type `kind` [bytes].

        Return 0 if the type is unknown or contains itself.
        """
        if kind not in self._lengths:
            self._lengths[kind] = 0  # if a format contains itself, the inner call returns this 0
            fields = self._fields.get(kind, []) if most_nested else []
            sizes = [self._length(inner, most_nested - 1) * many for inner, many, _ in fields]
            self._lengths[kind] = 0 if 0 in sizes or sum(sizes) > MOST_BYTES else sum(sizes)
        return self._lengths[kind]


class _Damage:
    """The parts of the log that are left out of its copy.

    `holes`: begin and end of each hole. `odd`, `cut_bytes`: as in `Mended`.
    """

    def __init__(self) -> None:
        self.holes: list[tuple[int, int]] = []
        self.odd = self.cut_bytes = 0

    def __bool__(self) -> bool:
        return bool(self.holes or self.odd or self.cut_bytes)

    def skip(self, at: int, end: int) -> int:
        """Leave the bytes from `at` to `end` out as a hole, and return `end`.

        Adjacent holes become one hole.
        """
        if self.holes and self.holes[-1][1] == at:
            at = self.holes.pop()[0]
        self.holes.append((at, end))
        return end


class _LogScan:
    def __init__(self, content: bytes | mmap, *, keeps_first: bool) -> None:
        self._content, self._size = content, len(content)
        self._formats = _Formats(keeps_first=keeps_first)
        self._topics: dict[int, _Topic] = {}
        self._is_head = True
        self._counts: Counter[tuple[str, int]] = Counter()
        self._kept: list[tuple[int, int] | bytes] = []
        self._damage = _Damage()
        self._is_changed = False
        self._searched = (0, -1)
        self._checks: Mapping[int, Callable[[int, int], bool]] = {
            ord("A"): self._is_topic,
            ord("C"): lambda at, size: size >= 11 and self._is_level(at),
            ord("D"): self._is_data,
            ord("F"): lambda at, size: self._is_head and self._form(at, size) is not None,
            ord("I"): lambda at, size: self._is_value(at, size),
            ord("L"): lambda at, size: size >= 9 and self._is_level(at),
            ord("M"): lambda at, size: self._is_value(at + 1, size - 1),
            ord("O"): lambda at, size: size == 2,
            ord("P"): lambda at, size: self._is_value(at, size),
            ord("Q"): lambda at, size: self._is_value(at + 1, size - 1),
            ord("R"): lambda at, size: size == 2,
            ord("S"): lambda at, size: size == len(SYNC) and self._read(at, size) == SYNC,
        }

    def found(self) -> Mended:
        """Return the result of the check of the log."""
        data = b"".join(self._pieces()) if self._damage or self._is_changed else b""
        holes, cut_bytes, odd = self._damage.holes, self._damage.cut_bytes, self._damage.odd
        first, lost = (holes[0][0] if holes else 0), sum(end - at for at, end in holes)
        return Mended(data, len(holes), lost, first, cut_bytes, odd, self._counts, (*self._formats.twice,))

    def _pieces(self) -> list[bytes]:
        return [one if isinstance(one, bytes) else self._content[slice(*one)] for one in self._kept]

    def run(self) -> None:
        """Check the log.

        If data was appended to the log after a crash, check each appended part separately.
        """
        at, begins = FILE_HEAD_BYTES, list[int]()
        self._keep(0, at)
        head = self._content[at:FLAGS_AT]
        if len(head) == HEAD.size and HEAD.unpack(head)[1] == ord("B"):
            at, begins = self._flags(FLAGS_AT + HEAD.unpack(head)[0])
        for end in [*begins, self._size]:
            self._part(at, end)
            at = end

    def _flags(self, end: int) -> tuple[int, list[int]]:
        """Return where the message with the log's flags ends, and where parts appended to the log begin."""
        found = self._content[APPENDED_AT : APPENDED_AT + APPENDED.size]
        if end > self._size or len(found) < APPENDED.size:
            return FILE_HEAD_BYTES, []
        flags, *begins = APPENDED.unpack(found)
        begins = sorted({one for one in begins if end < one < self._size}) if flags & 1 else []
        # In the copy of the log, damaged bytes are missing, so the offsets of the parts appended after a
        # crash would be wrong. So the copy gets no flag for appended parts, and zeros as offsets.
        if begins:
            self._is_changed = True
            self._keep(FILE_HEAD_BYTES, APPENDED_AT)
            self._kept.append(bytes([flags & ~1]) + found[1:8] + bytes(APPENDED.size - 8))
            self._keep(APPENDED_AT + APPENDED.size, end)
        else:
            self._keep(FILE_HEAD_BYTES, end)
        return end, begins

    def _part(self, at: int, end: int) -> None:
        is_one = self._is_message(at)
        while at < end:
            size, kind = self._head(at)
            after = at + HEAD.size + size
            if is_one and kind not in ANY_LENGTH and after <= end:
                tells = kind in TELLING
                if tells:
                    self._take(at, after, kind)
                is_next = after == end or self._is_message(after)
                if is_next and not tells:
                    self._take(at, after, kind)
                if is_next or tells:
                    at, is_one = after, is_next
                    continue
            # messages do not overlap, so this one ends at the latest where the next valid one begins
            following = min(self._search(at + 1), end)
            if following == end < after and (is_one or end - at < HEAD.size):
                self._cut(at, end)
                return
            if is_one and after <= following:
                self._take(at, after, kind)
                at = after
            elif kind and size and after == following:
                self._damage.odd += 1
                at = after
            else:
                at = self._damage.skip(at, following)
            is_one = self._is_message(at)

    def _cut(self, at: int, end: int) -> None:
        if end == self._size:
            self._damage.cut_bytes = end - at
        else:  # a crash of the logger interrupted this message
            self._damage.skip(at, end)

    def _keep(self, begin: int, end: int) -> None:
        last = self._kept[-1] if self._kept else b""
        if isinstance(last, tuple) and last[1] == begin:
            self._kept[-1] = last[0], end
        else:
            self._kept.append((begin, end))

    def _take(self, at: int, end: int, kind: int) -> None:
        """Keep a message of the log. If the message describes later messages, remember the description."""
        body, size = at + HEAD.size, end - at - HEAD.size
        if kind == ord("F"):
            form = self._form(body, size)
            assert form is not None
            if not self._formats.add(*form):
                self._is_changed = True
                return
        elif kind == ord("A"):
            self._is_head = False
            sensor, number = struct.unpack("<BH", self._content[body : body + 3])
            name = self._content[body + 3 : end].decode()
            topic = _Topic(name, sensor, *self._formats.sizes(name))
            if self._topics.get(number) == topic:
                # PX4's library forgets a topic's earlier messages when the log declares the topic again
                self._is_changed = True
                return
            self._topics[number] = topic
        elif kind == ord("D"):
            topic = self._topics[int.from_bytes(self._content[body : body + 2], "little")]
            self._counts[topic.name, topic.sensor] += 1
            # PX4's library rejects a message with padding at its end, so the padding is cut off
            if size > topic.size:
                self._is_changed = True
                self._kept.append(HEAD.pack(topic.size, kind) + self._content[body : body + topic.size])
                return
        self._keep(at, end)

    def _head(self, at: int) -> tuple[int, int]:
        return HEAD.unpack_from(self._content, at) if at + HEAD.size <= self._size else (0, 0)

    def _read(self, at: int, size: int) -> bytes:
        return self._content[at : at + size]

    def _search(self, begin: int) -> int:
        """Return the first offset from `begin` on at which a valid message begins, or the end of the log."""
        if self._searched[0] <= begin <= self._searched[1]:
            return self._searched[1]
        at = begin
        while (found := self._next_kind(at)) is not None:
            at = found
            if self._is_message(at):
                size, kind = self._head(at)
                after = at + HEAD.size + size
                if after == self._size or (kind in SURE and after < self._size) or self._is_message(after):
                    break
            at += 1
        else:
            at = self._size
        self._searched = begin, at
        return at

    def _next_kind(self, at: int) -> int | None:
        """Return the next offset at which a message may begin, or None.

        The letter of a message kind stands two bytes after this offset, after the message's length.
        """
        found = KINDS.search(self._content, at + 2)
        return None if found is None else found.start() - 2

    def _is_message(self, at: int) -> bool:
        """Return whether a message of a valid kind and length begins at the offset `at`."""
        if at + HEAD.size > self._size:
            return False
        size, kind = self._head(at)
        check = self._checks.get(kind)
        return check is not None and check(at + HEAD.size, size)

    def _is_topic(self, at: int, size: int) -> bool:
        if not 3 < size < LONGEST_NAME:
            return False
        return self._formats.sizes(self._read(at + 3, size - 3).decode(errors="replace"))[0] > 0

    def _is_data(self, at: int, size: int) -> bool:
        topic = self._topics.get(int.from_bytes(self._read(at, 2), "little"))
        return topic is not None and topic.size <= size <= topic.padded

    def _is_level(self, at: int) -> bool:
        return b"0" <= self._read(at, 1) <= b"7"

    def _is_value(self, at: int, size: int) -> bool:
        length = self._read(at, 1)
        found = KEY.fullmatch(self._read(at + 1, length[0])) if length else None
        if found is None:
            return False
        one = SIZES.get(found[1].decode())
        return one is not None and size == 1 + length[0] + one * int(found[2] or 1)

    def _form(self, at: int, size: int) -> tuple[str, list[_Field]] | None:
        found = FORMAT.fullmatch(self._read(at, size))
        if found is None or at + size > self._size:
            return None
        fields = FIELD.findall(found[2].decode())
        return found[1].decode(), [(kind, int(many or 1), name) for kind, many, name in fields]
