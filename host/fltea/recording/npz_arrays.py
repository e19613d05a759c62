"""Reads arrays from an .npz file. The size that each array declares is checked before memory is used."""

import contextlib
import io
import math
import shutil
import struct
import zipfile
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from typing import IO, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fltea.records.errors import FlteaError, UsageError
from fltea.records.temporary import nameless_file
from fltea.settings.limits import Limits

SUFFIX = ".npy"
MAGIC = b"\x93NUMPY"
LENGTHS = {1: struct.Struct("<H"), 2: struct.Struct("<I"), 3: struct.Struct("<I")}
"""Binary format in which an array's file states the length of its header, by the version of the .npy format.
"""

LONGEST_HEADER = 10_000
"""Longest header of an array [characters]. numpy has the same limit, but checks it only after reading the
header.
"""

KINDS = "biuf"
"""Accepted numpy types (letters of `dtype.kind`): booleans and real numbers. They are converted to 8-byte
numbers for calculations.
"""

UNPACKED = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
"""Accepted compression methods: those that numpy writes. With other methods, Python decompresses without a
size limit.
"""

NUMBER_BYTES = 8
COPY_BYTES = 1 << 20


class Header(NamedTuple):
    """What an array's file declares about the array. `length`: bytes before the data."""

    shape: tuple[int, ...]
    columns_first: bool
    """Whether columns are stored one after the other (Fortran order)."""
    dtype: "np.dtype[Any]"
    length: int


class NpzArrays:
    """The wanted arrays of an .npz file. They are decompressed to temporary files.

    `names`: names of all arrays in the file.

    Raises:
        UsageError: the file is no .npz file or is damaged, or an array holds no numbers or is too large.
    """

    def __init__(self, path: Path, wanted: Collection[str], limits: Limits) -> None:
        with _archive_of(path) as archive:
            members = {info.filename.removesuffix(SUFFIX): info for info in archive.infolist()}
            self.names = list(members)
            self._headers = {name: _header(archive, members[name]) for name in members if name in wanted}
            _check_sizes(path, self._headers, members, limits)
            self._arrays = {
                name: _unpacked(archive, members[name], header) for name, header in self._headers.items()
            }

    def __contains__(self, name: str) -> bool:
        return name in self._headers

    def shape(self, name: str) -> tuple[int, ...]:
        """Return the shape that the array `name` declares."""
        return self._headers[name].shape

    def whole(self, name: str) -> NDArray[Any]:
        return self._arrays[name]

    def rows(self, names: Sequence[str], at_once: int) -> Iterator[dict[str, NDArray[Any]]]:
        """Yield the arrays `names`, which have equal lengths, in blocks of `at_once` rows."""
        for begin in range(0, self.shape(names[0])[0], at_once):
            yield {name: self._arrays[name][begin : begin + at_once] for name in names}


def _unpacked(archive: zipfile.ZipFile, info: zipfile.ZipInfo, header: Header) -> NDArray[Any]:
    """Return an array, decompressed to a temporary file, as a memory map.

    Its rows are loaded into memory only when used.
    """
    if not math.prod(header.shape):
        return np.empty(header.shape, header.dtype)
    with archive.open(info) as packed, nameless_file() as file:
        shutil.copyfileobj(packed, file, COPY_BYTES)
        order: Literal["F", "C"] = "F" if header.columns_first else "C"
        return np.memmap(file, header.dtype, "r", header.length, header.shape, order)


@contextlib.contextmanager
def _archive_of(path: Path) -> Iterator[zipfile.ZipFile]:
    try:
        with path.open("rb") as file:
            if not zipfile.is_zipfile(file):
                raise ValueError("it is no zip archive, or was cut short")
            with zipfile.ZipFile(file) as archive:
                yield archive
    except FlteaError:
        raise
    except Exception as error:  # zipfile, zlib and numpy raise various errors for damaged bytes
        reason = str(error) or type(error).__name__
        raise UsageError(f"{path}: cannot be read as .npz ({reason}).") from error


def _check_sizes(
    path: Path, headers: dict[str, Header], members: dict[str, zipfile.ZipInfo], limits: Limits
) -> None:
    needed = 0
    for name, header in headers.items():
        info = members[name]
        if header.dtype.hasobject:
            raise ValueError(f"{name} holds pickled objects, which could run a stranger's program")
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
        raise ValueError(f"{info.filename} is compressed in a way that numpy does not use")
    with archive.open(info) as file:
        return read_header(file, info.filename)


def read_header(file: IO[bytes], name: str) -> Header:
    """Read the header of an array; raise ValueError if the header is invalid."""
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
    except (MemoryError, RecursionError) as error:  # these errors mean that the header is nested too deeply
        raise ValueError(f"{name} has a broken header") from error
    return Header(shape, columns_first, dtype, len(begin) + len(packed) + length)
