"""Describes the pieces of a large file, and reads ranges of its bytes to find where it can be cut.

A piece is a range of the file's bytes, with a header before it and an end after it, so that it can be read
like a file. A piece of a Parquet file is some of its row groups.
"""

import math
from collections.abc import Sequence
from typing import BinaryIO

import msgspec

from fltea.cluster.listing import File


class Cut(msgspec.Struct, frozen=True):
    """One piece of a file; a worker reads it like a recording.

    `begin`, `end`: byte offsets in the file between which the piece lies; for Parquet, indices of row groups.
    """

    begin: int
    end: int
    head: bytes = b""
    tail: bytes = b""


class Ranges:
    """Reads ranges of a file's bytes on demand."""

    def __init__(self, file: File, stream: BinaryIO) -> None:
        self.file, self.size, self._stream = file, file.size, stream

    def read(self, begin: int, end: int) -> bytes:
        """Return the bytes from `begin` to `end` - 1, as far as the file has them."""
        self._stream.seek(begin)
        return self._stream.read(max(0, min(end, self.size) - begin))

    def are_there(self) -> bool:
        """Return whether ranges can be read. Some web servers can send a file only from its beginning."""
        try:
            return len(self.read(self.size - 1, self.size)) == 1
        except ValueError:
            return False


def even_pieces(places: Sequence[int], end: int, block_bytes: int) -> list[tuple[int, int]]:
    """Join neighbouring parts of a file into pieces of nearly equal size, each of at most `block_bytes`.

    `places`: offsets at which the parts begin, in rising order. `end`: offset at which the last part ends. A
    part larger than `block_bytes` is not cut, so its piece is larger too.
    """
    if not places:
        return []
    count = max(1, math.ceil((end - places[0]) / block_bytes))
    size = (end - places[0]) / count
    begins = [places[0]]
    for place in places[1:]:
        if place - places[0] >= len(begins) * size:
            begins.append(place)
    return list(zip(begins, [*begins[1:], end], strict=True))
