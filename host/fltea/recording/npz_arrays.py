"""Arrays out of an .npz file: what each says of itself is checked before memory is taken for it."""

import io
import math
import struct
import zipfile
from collections.abc import Collection
from pathlib import Path
from typing import Any, NamedTuple

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


class _Header(NamedTuple):
    shape: tuple[int, ...]
    dtype: "np.dtype[Any]"
    length: int


def read_arrays(
    path: Path, wanted: Collection[str], limits: Limits
) -> tuple[dict[str, NDArray[Any]], list[str]]:
    """Those of the wanted arrays that the file has, and the names of all that it has.

    Raises:
        UsageError: no such file, a damaged one, arrays that are no numbers, or larger ones than allowed.
    """
    try:
        with path.open("rb") as file:
            if not zipfile.is_zipfile(file):
                raise ValueError("it is no zip archive, or was cut short")
            with zipfile.ZipFile(file) as archive:
                members = {info.filename.removesuffix(SUFFIX): info for info in archive.infolist()}
                chosen = {name: info for name, info in members.items() if name in wanted}
                _check_sizes(path, archive, chosen, limits)
                return {name: _array(archive, info) for name, info in chosen.items()}, list(members)
    except UsageError:
        raise
    except Exception as error:  # whatever zipfile, zlib and numpy raise on damaged bytes
        reason = str(error) or type(error).__name__
        raise UsageError(f"{path}: cannot be read as .npz ({reason}).") from error


def _check_sizes(
    path: Path, archive: zipfile.ZipFile, chosen: dict[str, zipfile.ZipInfo], limits: Limits
) -> None:
    needed = 0
    for name, info in chosen.items():
        header = _header(archive, info)
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


def _header(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> _Header:
    if info.compress_type not in UNPACKED:
        raise ValueError(f"{info.filename} is packed in a way that numpy does not use")
    with archive.open(info) as file:
        begin = file.read(len(MAGIC) + 2)
        if not begin.startswith(MAGIC) or begin[-2] not in LENGTHS:
            raise ValueError(f"{info.filename} is no array of numpy")
        size = LENGTHS[begin[-2]]
        (length,) = size.unpack(packed := file.read(size.size))
        if length > LONGEST_HEADER:
            raise ValueError(f"{info.filename} has a header of {length} bytes; {LONGEST_HEADER} are allowed")
        text = file.read(length)
    whole = io.BytesIO(packed + text)
    read = np.lib.format.read_array_header_1_0 if size.size == 2 else np.lib.format.read_array_header_2_0
    try:
        shape, _, dtype = read(whole)
    except (MemoryError, RecursionError) as error:  # brackets in brackets
        raise ValueError(f"{info.filename} has a broken header") from error
    return _Header(shape, dtype, len(begin) + len(packed) + length)


def _array(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> NDArray[Any]:
    with archive.open(info) as file:
        found: NDArray[Any] = np.lib.format.read_array(file, allow_pickle=False)
        return found
