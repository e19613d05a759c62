"""Where a large file may be cut so that each piece is a recording by itself.

A piece is a head, a range of the file's bytes and a tail, or of Parquet some row groups. What a format has no
place for is read whole: .npz, .db3 and what is packed as a whole, NDJSON, and files that were cut off.
"""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import BinaryIO

import msgspec

from fltea.cluster.fetch import COPY_BYTES, check_room
from fltea.cluster.listing import File, file_system
from fltea.recording.kind import KINDS, MAGIC, Kind
from fltea.records.errors import FlteaError


class Cut(msgspec.Struct, frozen=True):
    """One piece. begin, end: bytes of the file between head and tail; of Parquet numbers of row groups."""

    begin: int
    end: int
    head: bytes = b""
    tail: bytes = b""


class Ranges:
    """Ranges of a file's bytes, each read when it is asked for."""

    def __init__(self, file: File, stream: BinaryIO) -> None:
        self.file, self.size, self._stream = file, file.size, stream

    def read(self, begin: int, end: int) -> bytes:
        """The bytes begin … end - 1, as far as there are any."""
        self._stream.seek(begin)
        return self._stream.read(max(0, min(end, self.size) - begin))

    def are_there(self) -> bool:
        """False of a web server that sends files from their beginning only."""
        try:
            return len(self.read(self.size - 1, self.size)) == 1
        except ValueError:
            return False


def open_bytes(file: File) -> BinaryIO:
    """The file, for ranges; nothing is read ahead."""
    if file.protocol == "file":
        return Path(file.path).open("rb", buffering=0)
    stream: BinaryIO = file_system(file.protocol).open(file.path, "rb", cache_type="none")
    return stream


def kind_of(file: File, begin: bytes) -> Kind | None:
    """By its ending, or without one by its first bytes."""
    if file.suffix:
        return KINDS.get(file.suffix)
    return next((kind for magic, kind in MAGIC.items() if begin.startswith(magic)), None)


def even_pieces(places: Sequence[int], end: int, block_bytes: int) -> list[tuple[int, int]]:
    """Join what begins at `places` (rising) and ends at `end` to pieces of one size, of a block at most.

    A piece whose parts are larger than a block is as large as they are.
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


def write_piece(file: File, cut: Cut, folder: Path) -> Path:
    """A piece as a recording in `folder`.

    Raises:
        FlteaError: the file is shorter than it was, or there is no room.
        OSError: and whatever its file system raises.
    """
    if KINDS.get(file.suffix) == "parquet":
        from fltea.cluster.cut_parquet import write_groups

        return write_groups(file, cut, folder)
    check_room(file, cut.end - cut.begin, folder)
    path = folder / f"piece{file.suffix}"
    with open_bytes(file) as source, path.open("wb") as out:
        out.write(cut.head)
        source.seek(cut.begin)
        left = cut.end - cut.begin
        while left:
            data = source.read(min(left, COPY_BYTES))
            if not data:
                raise FlteaError(f"{file.url}: ends {left} bytes before it did when it was listed.")
            out.write(data)
            left -= len(data)
        out.write(cut.tail)
    return path
