"""Finds the whole parts of a LabVIEW file (TDMS), so that damage costs only the parts that it is in.

A TDMS file is a row of segments, called parts here. A part begins with its length, and may use the
description of its channels in the parts before it. The library for TDMS reads nothing of a file in which one
part is damaged. It is given the whole parts alone, as one file.
"""

import re
import struct
from bisect import bisect_right
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from io import RawIOBase
from mmap import ACCESS_READ, mmap
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

TAG = b"TDSm"
LEAD_IN = struct.Struct("<4sI")
LENGTHS = "IQQ"
LEAD_IN_BYTES = 28
"""A part's first bytes: TAG, flags, then version, length of all that follows, and length of the description.

Source: ni.com, "TDMS File Format Internal Structure".
"""

VERSIONS = 4712, 4713
HAS_DESCRIPTION, IS_NEW_LIST, IS_BIG_ENDIAN = 1 << 1, 1 << 2, 1 << 6
STILL_WRITTEN = (1 << 64) - 1
NO_DATA, AS_BEFORE = 0xFFFFFFFF, 0
OF_DAQMX = 0x1269, 0x126A, 0x69120000, 0x69130000
"""Values in place of the length of a channel's index. Data of DAQmx are not checked."""

SIZES = {**dict(enumerate((0, 1, 2, 4, 8, 1, 2, 4, 8, 4, 8))), 25: 4, 26: 8, 33: 1, 68: 16, 0x08000C: 8}
SIZES[0x10000D] = 16
"""Length of one value [bytes], by the number of its type."""

LETTERS = dict(enumerate("bhiqBHIQfd", 1)) | {25: "f", 26: "d"}
"""Letter of `struct` for the types that are numbers, by the number of the type."""

NAME = re.compile(rb"/|(/'([^']|'')*'){1,2}", re.DOTALL)
"""Matches the name of an object: the file, a group, or a channel of a group."""

LONGEST_BLOCK = 1 << 48
"""Longest block of data that a description may claim [bytes]."""

TEXT = 32
"""Type of texts, each of which begins with its length."""


class Part(NamedTuple):
    """A part of the file: its begin and its end. `is_cut`: whether the file ends before the part does."""

    begin: int
    end: int
    is_cut: bool = False


class Parts(NamedTuple):
    """Parts of a file. `lost`: begin and end of the stretches between them that cannot be read.

    `missing_bytes`: number of bytes by which the last part is longer than the file; 0 if this is unknown.
    """

    whole: list[Part]
    lost: list[tuple[int, int]]
    missing_bytes: int = 0

    @property
    def is_cut(self) -> bool:
        """Whether the last part was never finished or is cut off."""
        return bool(self.whole) and self.whole[-1].is_cut


def parts_of(path: Path) -> Parts:
    """Return the parts of a file, as the lengths in it tell them, and as a search finds them after damage."""
    with path.open("rb") as file, mmap(file.fileno(), 0, access=ACCESS_READ) as content:
        found = _chained(content)
        return found if found is not None else _searched(content)


def checked(path: Path) -> Parts:
    """Return the parts of a file whose description of channels and length of data agree."""
    with path.open("rb") as file, mmap(file.fileno(), 0, access=ACCESS_READ) as content:
        return _searched(content)


class Stated(NamedTuple):
    """What a part states.

    `properties`: values by object (b"/" is the file) and name. `has_data`: whether the part holds data.
    """

    properties: Mapping[tuple[bytes, bytes], str | float | None]
    has_data: bool


def stated_in(path: Path, parts: Sequence[Part]) -> Iterator[Stated]:
    """Yield what each part states, except about data of DAQmx."""
    with path.open("rb") as file, mmap(file.fileno(), 0, access=ACCESS_READ) as content:
        for part in parts:
            head, found = _lead_in(content, part.begin), dict[tuple[bytes, bytes], str | float | None]()
            if head is not None and head[0] & HAS_DESCRIPTION and head[1] <= part.end:
                order = ">" if head[0] & IS_BIG_ENDIAN else "<"
                with suppress(struct.error, ValueError):
                    for name, _, _, properties in _described(
                        content[part.begin + LEAD_IN_BYTES : head[1]], order
                    ):
                        found.update({(name, key): value for key, value in properties.items()})
            yield Stated(found, head is not None and head[1] < part.end)


def _lead_in(content: mmap, at: int) -> tuple[int, int, int] | None:
    """Return flags, end of the description, and end of the part at `at`; None if no part begins there."""
    if content[at : at + len(TAG)] != TAG or at + LEAD_IN_BYTES > len(content):
        return None
    _, flags = LEAD_IN.unpack_from(content, at)
    order = ">" if flags & IS_BIG_ENDIAN else "<"
    version, length, described = struct.unpack_from(order + LENGTHS, content, at + LEAD_IN.size)
    if version not in VERSIONS or (described > length and length != STILL_WRITTEN):
        return None
    begin = at + LEAD_IN_BYTES
    return flags, begin + described, STILL_WRITTEN if length == STILL_WRITTEN else begin + length


def _chained(content: mmap) -> Parts | None:
    """Return the parts of a file if each begins where the one before it ends, else None.

    Also return None if one is not described as it should be. The library would read other values for it.
    """
    found, known, at, size = list[Part](), _Channels(), 0, len(content)
    while size - at >= LEAD_IN_BYTES:
        head = _lead_in(content, at)
        if head is None:
            return None
        _, data, end = head
        is_cut = end > size
        if is_cut and _next(content, at + LEAD_IN_BYTES) < size:
            return None
        if data <= size and not known.take(content, at + LEAD_IN_BYTES, *head, is_checked=False):
            return None
        found.append(Part(at, min(end, size), is_cut))
        if is_cut:
            return Parts(found, [], 0 if end == STILL_WRITTEN else end - size)
        at = end
    return Parts(found, []) if at == size else Parts([*found, Part(at, size, True)], [])


def _searched(content: mmap) -> Parts:
    """Return the parts that are whole, and the stretches that are not."""
    found, lost, known, at, size = list[Part](), list[tuple[int, int]](), _Channels(), 0, len(content)
    missing = 0
    while at < size:
        if found and size - at < LEAD_IN_BYTES and (not lost or lost[-1][1] < at):
            found.append(Part(at, size, True))
            break
        head = _lead_in(content, at)
        following = _next(content, at + 1)
        if head is not None:
            end = min(head[2], size)
            is_last = head[2] > size
            # a part that begins within this one shows that bytes of this one are gone
            begin, is_checked = at + LEAD_IN_BYTES, not is_last
            if following >= end and known.take(content, begin, *head, is_checked=is_checked):
                found.append(Part(at, end, is_last))
                missing = head[2] - size if is_last and head[2] != STILL_WRITTEN else 0
                at = end
                continue
        if lost and lost[-1][1] == at:
            at = lost.pop()[0]
        lost.append((at, following))
        at = following
    return Parts(found, lost, missing)


def _next(content: mmap, at: int) -> int:
    """Return the next offset at which a part begins, or the end of the file."""
    while (at := content.find(TAG, at)) >= 0:
        if _lead_in(content, at):
            return at
        at += 1
    return len(content)


class _Channels:
    """The channels that the parts so far describe: the length of the data of each in one block [bytes].

    A length of None is unknown.
    """

    def __init__(self) -> None:
        self._lengths: dict[bytes, int | None] = {}
        self._now: dict[bytes, int | None] | None = None

    def take(self, content: mmap, at: int, flags: int, data: int, end: int, *, is_checked: bool) -> bool:
        """Read the description of a part, which begins at `at`; return whether its length fits it.

        `data`, `end`: begin and end of its data. `is_checked`: whether a length that
        does not fit makes it false.
        """
        if data > len(content):
            return not is_checked
        now = self._now
        if flags & HAS_DESCRIPTION:
            now = {} if flags & IS_NEW_LIST or now is None else dict(now)
            try:
                for name, index, length, _ in _described(
                    content[at:data], ">" if flags & IS_BIG_ENDIAN else "<"
                ):
                    now[name] = length
                    if index == NO_DATA:
                        now[name] = 0
                    elif index == AS_BEFORE:
                        now[name] = self._lengths[name] if None not in self._lengths.values() else None
                    if index != NO_DATA:
                        self._lengths[name] = now[name]
            except (struct.error, ValueError, KeyError):
                return False
        if now is None:
            return False
        block = sum(one or 0 for one in now.values())
        # only of a part that is cut may a block be longer than the file
        if block > (len(content) if end <= len(content) else LONGEST_BLOCK):
            return False
        if None not in now.values() and is_checked and ((end - data) % block if block else end - data):
            return False
        self._now = now
        return True


def _described(
    data: bytes, order: str
) -> Iterator[tuple[bytes, int, int | None, Mapping[bytes, str | float | None]]]:
    """Yield the objects of a description: name, index, length of its data in one block [bytes], properties.

    Raises:
        ValueError, struct.error: the description is damaged.
    """
    (count,), at = struct.unpack_from(f"{order}I", data), 4
    for _ in range(count):
        name, at = _text(data, at, order)
        if not NAME.fullmatch(name):
            raise ValueError
        (index,), at = struct.unpack_from(f"{order}I", data, at), at + 4
        length: int | None = None
        if index in OF_DAQMX:
            yield name, index, None, {}
            return  # what follows is not checked
        if index not in (NO_DATA, AS_BEFORE):
            kind, dimensions, values = struct.unpack_from(f"{order}IIQ", data, at)
            at += 16
            if dimensions != 1 or (kind != TEXT and kind not in SIZES):
                raise ValueError
            length = values * SIZES.get(kind, 0)
            if kind == TEXT:
                (length,), at = struct.unpack_from(f"{order}Q", data, at), at + 8
        properties, at = _properties(data, at, order)
        yield name, index, length, properties


def _properties(data: bytes, at: int, order: str) -> tuple[dict[bytes, str | float | None], int]:
    """Return the properties of an object, which begin at `at`, and where they end.

    A value is None if it is neither a text nor a number.
    """
    found = dict[bytes, str | float | None]()
    (count,), at = struct.unpack_from(f"{order}I", data, at), at + 4
    for _ in range(count):
        name, at = _text(data, at, order)
        (kind,), at = struct.unpack_from(f"{order}I", data, at), at + 4
        if kind == TEXT:
            text, at = _text(data, at, order)
            found[name] = text.decode(errors="replace")
        elif kind in SIZES:
            is_number = kind in LETTERS and at + SIZES[kind] <= len(data)
            found[name] = struct.unpack_from(order + LETTERS[kind], data, at)[0] if is_number else None
            at += SIZES[kind]
        else:
            raise ValueError
        if at > len(data):
            raise ValueError
    return found, at


def _text(data: bytes, at: int, order: str) -> tuple[bytes, int]:
    (length,) = struct.unpack_from(f"{order}I", data, at)
    end = at + 4 + length
    if end > len(data):
        raise ValueError
    return data[at + 4 : end], end


class Joined(RawIOBase):
    """Some parts of a file, read as one file. `parts`: begin and end of each."""

    def __init__(self, file: BinaryIO, parts: Sequence[Part]) -> None:
        self._file, self._parts = file, parts
        self._at = [0]
        for part in parts:
            self._at.append(self._at[-1] + part.end - part.begin)
        self._place = 0

    def readable(self) -> bool:
        """Return True, as `RawIOBase` requires."""
        return True

    def seekable(self) -> bool:
        """Return True, as `RawIOBase` requires."""
        return True

    def seek(self, offset: int, whence: int = 0) -> int:
        """Go to a place, and return it."""
        self._place = offset + (0, self._place, self._at[-1])[whence]
        return self._place

    def readinto(self, buffer: Any) -> int:
        """Read as many bytes as there are in one part, at most as many as `buffer` holds; return how many."""
        place = bisect_right(self._at, self._place) - 1
        if place >= len(self._parts):
            return 0
        inside = self._place - self._at[place]
        self._file.seek(self._parts[place].begin + inside)
        left = self._parts[place].end - self._parts[place].begin - inside
        data = self._file.read(min(len(buffer), left))
        count = len(data)
        buffer[:count] = data
        self._place += count
        return count
