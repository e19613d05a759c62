"""Keeps columns of numbers in temporary files, which are written and read in blocks.

One day at 100 Hz takes 69 MB for each column. With a `Spool`, only one block at a time is in memory.
"""

import contextlib
import secrets
import weakref
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fltea.records.temporary import TemporaryFailed, named_file, nameless_file

COPY_BYTES = 1 << 20


class _Column(NamedTuple):
    file: Any
    dtype: "np.dtype[Any]"
    shape: tuple[int, ...]
    """Shape of one row of the column, () if a row is a single number."""


class Spool(contextlib.AbstractContextManager["Spool"]):
    """Named columns of numbers in temporary files.

    The first block that is appended to a column determines the column's type and width.

    The temporary files are deleted when a `with` statement of the spool ends, or when no variable refers to
    the spool any more. This does not hold if `folder` is given: the files are then in this folder, and stay
    there.
    """

    def __init__(self, folder: Path | None = None) -> None:
        self._folder = folder
        self._columns: dict[str, _Column] = {}
        self._rows: dict[str, int] = {}
        self.close = weakref.finalize(self, _close, self._columns)

    def __exit__(self, *exception: object) -> None:
        self.close()

    def __contains__(self, name: str) -> bool:
        return name in self._columns

    def append(self, name: str, values: NDArray[Any]) -> None:
        """Append rows to a column. The first call with a name creates the column of this name.

        Raises:
            TemporaryFailed: the folder for temporary files is full or fails.
        """
        if name not in self._columns:
            self._columns[name] = _Column(self._new_file(), values.dtype, values.shape[1:])
            self._rows[name] = 0
        column = self._columns[name]
        column.file.write(np.ascontiguousarray(values, dtype=column.dtype).data)
        self._rows[name] += len(values)

    def drop(self, name: str) -> None:
        """Delete a column, if it exists."""
        if name in self._columns:
            self._columns.pop(name).file.close()

    def remove(self) -> None:
        """Delete all columns, including files that have names."""
        if self._folder is not None:
            for column in self._columns.values():
                Path(column.file.name).unlink(missing_ok=True)
        self.close()
        self._columns.clear()

    def length(self, name: str) -> int:
        """Return the number of rows of a column; 0 if the column does not exist."""
        return self._rows[name] if name in self._columns else 0

    def whole(self, name: str) -> NDArray[Any]:
        """Return a whole column in memory."""
        return self._read(name, 0, self.length(name))

    def mapped(self, name: str) -> NDArray[Any]:
        """Return a non-empty column as a memory map, which other processes may share.

        The spool must have been created with a folder.
        """
        column = self._columns[name]
        column.file.flush()
        return np.memmap(column.file.name, column.dtype, "r", shape=(self._rows[name], *column.shape))

    def blocks(self, names: Sequence[str], at_once: int) -> Iterator[list[NDArray[Any]]]:
        """Yield blocks of at most `at_once` rows of some columns, which must be equally long."""
        for begin in range(0, self.length(names[0]), at_once):
            yield [self._read(name, begin, at_once) for name in names]

    def write_npz(self, file: BinaryIO, scalars: Mapping[str, ArrayLike]) -> None:
        """Write the numbers `scalars` and all columns as numpy's `savez_compressed` would."""
        with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED, allowZip64=True) as archive:
            for name, value in scalars.items():
                with archive.open(f"{name}.npy", "w") as member:
                    np.lib.format.write_array(member, np.asanyarray(value), allow_pickle=False)
            for name, column in self._columns.items():
                shape = (self._rows[name], *column.shape)
                descr = np.lib.format.dtype_to_descr(column.dtype)
                header = {"descr": descr, "fortran_order": False, "shape": shape}
                with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                    np.lib.format.write_array_header_1_0(member, header)
                    column.file.seek(0)
                    while data := column.file.read(COPY_BYTES):
                        member.write(data)

    def _new_file(self) -> Any:
        if self._folder is None:
            return nameless_file()
        return named_file(self._folder / f"column-{secrets.token_hex(8)}")

    def _read(self, name: str, begin: int, count: int) -> NDArray[Any]:
        column = self._columns[name]
        width = int(np.prod(column.shape, dtype=int))
        row_bytes = width * column.dtype.itemsize
        column.file.seek(begin * row_bytes)
        data = column.file.read(count * row_bytes)
        return np.frombuffer(data, column.dtype).reshape(-1, *column.shape)


def _close(columns: dict[str, _Column]) -> None:
    for column in columns.values():
        # Closing the file writes what is left in the buffer, and fails if the disk is full. This failure is
        # ignored, since an earlier write has reported the full disk already.
        with contextlib.suppress(TemporaryFailed, OSError):
            column.file.close()
