"""The table of results: a folder of Parquet files, as Spark and Dask write it, with a journal of new rows.

The rows of a finished recording are written at once, as one line of the journal. When the journal is long,
its rows are moved to a Parquet file, which gets its final name only when it is complete. So kill -9 loses
only the results of recordings that are being read.
"""

import fcntl
import hashlib
import os
import types
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, Union, get_args, get_origin, get_type_hints

import msgspec
import pyarrow as pa
from pyarrow import compute, parquet

from fltea.cluster.listing import JOURNAL, File
from fltea.cluster.rows import VALUE_COLUMNS, Row
from fltea.records.errors import FlteaError, UsageError
from fltea.records.own_file import open_own
from fltea.records.whole_file import make_folder, whole_file

JOURNAL_BYTES = 8_000_000
"""Longest journal [bytes], about ten thousand rows; the next start of the program reads it into memory."""
KEY = ["file", "size", "stamp", "settings"]

TYPES = {str: pa.string(), int: pa.int64(), float: pa.float64(), bool: pa.bool_()}

_rows = msgspec.json.Decoder(list[Row])


def schema() -> pa.Schema:
    """Return the columns of the table: the fields of `Row`."""
    fields = {name: _type(hint) for name, hint in get_type_hints(Row).items() if name != "values"}
    return pa.schema([*fields.items(), *((name, pa.float64()) for name in VALUE_COLUMNS)])


def _type(hint: Any) -> pa.DataType:
    if get_origin(hint) in (Union, types.UnionType):
        hint = next(one for one in get_args(hint) if one is not type(None))
    if get_origin(hint) is list:
        return pa.list_(_type(get_args(hint)[0]))
    return TYPES[hint]


class VerdictTable:
    """A table of results that this program alone may write.

    When the table is opened, failures that were not the files' fault are removed, so these files are tried
    again.

    Raises:
        UsageError: `folder` is not such a table, or another program writes to it.
        FlteaError: the table cannot be written.
    """

    def __init__(self, folder: Path, settings: str) -> None:
        self._folder = folder
        self._settings = settings
        self._schema = schema()
        if folder.exists() and not folder.is_dir():
            raise UsageError(f"{folder}: is a file; the table of verdicts is a folder of Parquet files.")
        strange = [path.name for path in folder.glob("*") if not _is_ours(path)] if folder.exists() else []
        if strange:
            raise UsageError(f"{folder}: holds {strange[0]!r}, which does not belong to a table of verdicts.")
        try:
            make_folder(folder)
            self._journal = open_own(folder / JOURNAL, 0o666, append=True)
        except OSError as error:
            where = error.filename or folder / JOURNAL
            raise FlteaError(f"{folder}: cannot be written ({where}: {error.strerror}).") from error
        try:
            fcntl.flock(self._journal, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            os.close(self._journal)
            raise UsageError(f"{folder}: another program writes to it.") from error
        except OSError:  # the file system has no locks: go on without one
            pass
        self._done: set[bytes] = set()
        self._failures: dict[bytes, str] = {}
        self._numbers = [0]
        self._bytes = 0
        try:
            self._read()
        except BaseException:
            self.close(keep_journal=True)
            raise

    def __contains__(self, file: File) -> bool:
        """Return whether the table holds a file in its listed state, with the settings of this run."""
        return _digest(file.url, file.size, file.stamp, self._settings) in self._done

    def __len__(self) -> int:
        """Return the number of files in the table, counted for all settings."""
        return len(self._done)

    def failure_of(self, file: File) -> str | None:
        """Return why the table lacks the results of an axis of the file; None if no axis is missing."""
        return self._failures.get(_digest(file.url, file.size, file.stamp, self._settings))

    def add(self, rows: list[Row]) -> None:
        """Write all rows of one file to the journal and pass them to the operating system.

        Raises:
            FlteaError: the disk refuses the rows.
        """
        line = msgspec.json.encode(rows) + b"\n"
        before = self._bytes
        try:
            while line:
                taken = os.write(self._journal, line)
                self._bytes += taken
                line = line[taken:]
        except OSError as error:
            os.ftruncate(self._journal, before)  # remove what was written of this line
            self._bytes = before
            raise FlteaError(f"{self._folder}: cannot be written ({error.strerror}).") from error
        self._note(_key(rows[0]), (row.error for row in rows))
        if self._bytes > JOURNAL_BYTES:
            self._empty_journal()

    def close(self, *, keep_journal: bool = False) -> None:
        """Write the remaining rows as Parquet, and close the table."""
        if self._journal < 0:
            return
        try:
            if not keep_journal:
                self._empty_journal()
        finally:
            os.close(self._journal)
            self._journal = -1

    def _read(self) -> None:
        for path in sorted(self._folder.glob("part-*.parquet")):
            if not path.stem.removeprefix("part-").isdecimal():
                raise UsageError(
                    f"{path}: does not belong to this table. Move it away, or name another table."
                )
            self._numbers.append(int(path.stem.removeprefix("part-")))
            self._read_part(path)
        # Incomplete lines are skipped, and so are rows that a Parquet file already holds (the program was
        # killed after writing it).
        found = {_key(rows[0]): rows for rows in self._lines() if not any(row.again for row in rows)}
        self._write_part([row for key, rows in found.items() if key not in self._done for row in rows])
        for key, rows in found.items():
            self._note(key, (row.error for row in rows))
        os.ftruncate(self._journal, 0)

    def _note(self, key: bytes, errors: Iterable[str | None]) -> None:
        """Remember that the table holds the file with this key, and the first of its errors, if any."""
        self._done.add(key)
        for one in errors:
            if one is not None:
                self._failures.setdefault(key, one)

    def _lines(self) -> Iterator[list[Row]]:
        """Yield the complete lines of the journal."""
        for line in (self._folder / JOURNAL).read_bytes().split(b"\n"):
            try:
                rows = _rows.decode(line)
            except msgspec.MsgspecError:
                continue
            if rows:
                yield rows

    def _read_part(self, path: Path) -> None:
        try:
            table = parquet.read_table(path, columns=[*KEY, "again", "error"])
            if compute.any(table["again"]).as_py():
                whole = parquet.read_table(path, schema=self._schema)
                table = whole.filter(compute.invert(whole["again"]))
                self._write(path, table)
        except (OSError, ValueError, KeyError, pa.ArrowException) as error:
            raise UsageError(f"{path}: is not a valid file of a table of verdicts ({error}).") from error
        *columns, errors = (table[name].to_pylist() for name in (*KEY, "error"))
        for key, one in zip(map(_digest, *columns), errors, strict=True):
            self._note(key, [one])

    def _empty_journal(self) -> None:
        """Write the journal as a Parquet file, and empty it."""
        self._write_part([row for rows in self._lines() for row in rows])
        os.ftruncate(self._journal, 0)
        self._bytes = 0

    def _write_part(self, rows: list[Row]) -> None:
        if not rows:
            return
        number = max(self._numbers) + 1
        table = pa.Table.from_pylist(
            [msgspec.structs.asdict(row) | row.values for row in rows], schema=self._schema
        )
        self._write(self._folder / f"part-{number:06d}.parquet", table)
        self._numbers.append(number)

    def _write(self, path: Path, table: pa.Table) -> None:
        with whole_file(path) as file:
            parquet.write_table(table, file, compression="zstd")


def _is_ours(path: Path) -> bool:
    return path.name.startswith((".", "_")) or (path.name.startswith("part-") and path.suffix == ".parquet")


def _key(row: Row) -> bytes:
    return _digest(row.file, row.size, row.stamp, row.settings)


def _digest(*key: object) -> bytes:
    return hashlib.blake2b(repr(key).encode("utf-8", "surrogateescape"), digest_size=8).digest()
