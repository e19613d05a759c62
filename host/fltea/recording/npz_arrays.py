"""Arrays out of an .npz file: what each says of itself is checked before memory is taken for it."""

import contextlib
import io
import math
import struct
import zipfile
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from typing import IO, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fltea.records.errors import UsageError
from fltea.settings.limits import Limits

SUFFIX = ".npy"
MAGIC = b"\x93NUMPY"
LENGTHS = {1: struct.Struct("<H"), 2: struct.Struct("<I"), 3: struct.Struct("<I")}
"""Of the header, by the version of the format."""

LONGEST_HEADER = 10_000
"""Characters, as numpy's own limit; numpy reads a longer one before it looks at its length."""

KINDS = "biuf"
"""Of numpy's types: truths and numbers. What is done with them is done in 8 bytes each."""

UNPACKED = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
"""What numpy writes; Python unpacks the others without a limit."""

NUMBER_BYTES = 8


class Header(NamedTuple):
    """What an array says of itself. length: of all that, in bytes."""

    shape: tuple[int, ...]
    columns_first: bool
    """columns stand one after the other, as Fortran has them"""
    dtype: "np.dtype[Any]"
    length: int


class NpzArrays:
    """Those of the wanted arrays that a file has, read a block of rows at a time.

    names: of all that it has.

    Raises:
        UsageError: no such file, a damaged one, arrays that are no numbers, or larger ones than allowed.
    """

    def __init__(self, path: Path, wanted: Collection[str], limits: Limits) -> None:
        self._path = path
        with _archive_of(path) as archive:
            members = {info.filename.removesuffix(SUFFIX): info for info in archive.infolist()}
            self.names = list(members)
            self._members = {name: info for name, info in members.items() if name in wanted}
            self._headers = {name: _header(archive, info) for name, info in self._members.items()}
            _check_sizes(path, self._headers, self._members, limits)

    def __contains__(self, name: str) -> bool:
        return name in self._members

    def shape(self, name: str) -> tuple[int, ...]:
        """The shape that an array declares."""
        return self._headers[name].shape

    def whole(self, name: str) -> NDArray[Any]:
        """One array."""
        with _archive_of(self._path) as archive, archive.open(self._members[name]) as file:
            found: NDArray[Any] = np.lib.format.read_array(file, allow_pickle=False)
            return found

    def rows(self, names: Sequence[str], at_once: int) -> Iterator[dict[str, NDArray[Any]]]:
        """So many rows at a time of arrays that are alike in length.

        Raises:
            UsageError: damaged bytes.
        """
        with _archive_of(self._path) as archive, contextlib.ExitStack() as stack:
            columns = {
                name: _Rows(archive, self._members[name], self._headers[name], stack) for name in names
            }
            samples = self.shape(names[0])[0]
            for begin in range(0, samples, at_once):
                count = min(at_once, samples - begin)
                yield {name: column.read(count) for name, column in columns.items()}
            for column in columns.values():
                column.end()


class _Rows:
    """An array as it comes out of its archive, a few rows at a time."""

    def __init__(
        self, archive: zipfile.ZipFile, info: zipfile.ZipInfo, header: Header, stack: contextlib.ExitStack
    ) -> None:
        shape, by_columns, self._dtype, length = header
        by_columns = by_columns and len(shape) > 1
        streams, self._width = (math.prod(shape[1:]), 1) if by_columns else (1, math.prod(shape[1:]))
        self._shape = (-1, *shape[1:])
        self._streams = []
        for i in range(streams):
            stream = stack.enter_context(archive.open(info))
            stream.seek(length + i * shape[0] * self._dtype.itemsize)
            self._streams.append(stream)

    def read(self, count: int) -> NDArray[Any]:
        """The next rows."""
        size = count * self._width * self._dtype.itemsize
        columns = []
        for stream in self._streams:
            if len(data := stream.read(size)) != size:
                raise ValueError("an array ends too early")
            columns.append(np.frombuffer(data, self._dtype))
        if len(columns) == 1:
            return columns[0].reshape(self._shape)
        return np.stack(columns, axis=1)

    def end(self) -> None:
        """At its end the archive compares checksums."""
        self._streams[-1].read(1)


@contextlib.contextmanager
def _archive_of(path: Path) -> Iterator[zipfile.ZipFile]:
    try:
        with path.open("rb") as file:
            if not zipfile.is_zipfile(file):
                raise ValueError("it is no zip archive, or was cut short")
            with zipfile.ZipFile(file) as archive:
                yield archive
    except UsageError:
        raise
    except Exception as error:  # whatever zipfile, zlib and numpy raise on damaged bytes
        reason = str(error) or type(error).__name__
        raise UsageError(f"{path}: cannot be read as .npz ({reason}).") from error


def _check_sizes(
    path: Path, headers: dict[str, Header], members: dict[str, zipfile.ZipInfo], limits: Limits
) -> None:
    needed = 0
    for name, header in headers.items():
        info = members[name]
        if header.dtype.hasobject:
            raise ValueError(f"{name} holds pickled objects, which could run a program of a stranger's")
        if header.dtype.kind not in KINDS:
            raise UsageError(f"{path}: {name} does not hold numbers.")
        if any(n < 0 for n in header.shape):
            raise ValueError(f"{name} declares the shape {header.shape}")
        numbers = math.prod(header.shape)
        needed += numbers * max(NUMBER_BYTES, header.dtype.itemsize)
        if needed > limits.whole_bytes:
            raise limits.whole_too_large(f"{path}: {name} declares the shape {header.shape}", needed)
        if info.file_size != header.length + numbers * header.dtype.itemsize:
            raise ValueError(f"{name} declares the shape {header.shape}, but has {info.file_size} bytes")


def _header(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> Header:
    if info.compress_type not in UNPACKED:
        raise ValueError(f"{info.filename} is packed in a way that numpy does not use")
    with archive.open(info) as file:
        return read_header(file, info.filename)


def read_header(file: IO[bytes], name: str) -> Header:
    """Read what an array says of itself; ValueError if it makes no sense."""
    begin = file.read(len(MAGIC) + 2)
    if not begin.startswith(MAGIC) or begin[-2] not in LENGTHS:
        raise ValueError(f"{name} is no array of numpy")
    size = LENGTHS[begin[-2]]
    (length,) = size.unpack(packed := file.read(size.size))
    if length > LONGEST_HEADER:
        raise ValueError(f"{name} has a header of {length} bytes; {LONGEST_HEADER} are allowed")
    text = file.read(length)
    whole = io.BytesIO(packed + text)
    read = np.lib.format.read_array_header_1_0 if size.size == 2 else np.lib.format.read_array_header_2_0
    try:
        shape, columns_first, dtype = read(whole)
    except (MemoryError, RecursionError) as error:  # brackets in brackets
        raise ValueError(f"{name} has a broken header") from error
    return Header(shape, columns_first, dtype, len(begin) + len(packed) + length)
