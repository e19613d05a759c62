"""Where the history is kept: a file of SQLite, or a PostgreSQL server that is there already."""

import contextlib
import os
import socket
import sqlite3
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

from fltea.records.errors import UsageError
from fltea.records.secret import refuse_secret
from fltea.settings.extras import load

SCHEMA_VERSION = 2
APPLICATION_ID = 0x464C5445
"""Marks a file of SQLite as ours: "FLTE" (the pragma application_id)."""

MEMORY_ROWS = 200_000
"""Rows of a table that are kept where there is no file: some 100 MB."""

CONNECT_S = 5
AGAIN_S = 5.0
"""A server that did not answer is not asked again for so long."""

OPTIONS = "-c statement_timeout=10s -c lock_timeout=5s"
"""For the server; and packets that nobody acknowledges end the connection after `SILENT_MS`."""

SILENT_MS = 10_000

Row = tuple[Any, ...]


class Sqlite:
    """A file; with its log ahead of the file (WAL) a transaction is there whole or not at all.

    It is used by one thread at a time. path: None keeps `MEMORY_ROWS` of each table in memory. name: for
    messages, without secrets. failures: what it raises; away: those after which the same may work later, as
    when the disk was full.

    Raises:
        UsageError: the file is no such database, or cannot be written.
    """

    failures: type[Exception] = sqlite3.Error
    away: tuple[type[Exception], ...] = (sqlite3.OperationalError,)

    def __init__(self, path: Path | None, tables: Sequence[str]) -> None:
        self.name = str(path or "in memory")
        self._is_file = path is not None
        try:
            self.connection = sqlite3.connect(
                path or ":memory:", isolation_level=None, check_same_thread=False, timeout=5.0
            )
            self._check_owner()
            self.connection.execute("PRAGMA journal_mode = WAL")
            self.connection.execute("PRAGMA synchronous = NORMAL")
            self.connection.execute("BEGIN IMMEDIATE")
            for command in tables:
                self.connection.execute(command)
            self.connection.execute(f"PRAGMA user_version = {SCHEMA_VERSION}")
            self.connection.execute(f"PRAGMA application_id = {APPLICATION_ID}")
            self.connection.execute("COMMIT")
        except sqlite3.Error as error:
            raise UsageError(
                f"{path}: cannot be used as a history ({error}). Is it a file of fltea fleet, in a folder "
                "that may be written?"
            ) from error

    def _check_owner(self) -> None:
        """Refuse a database of another program, or of another version of this one, untouched."""
        version, owner = (
            self.connection.execute(f"PRAGMA {name}").fetchone()[0]
            for name in ("user_version", "application_id")
        )
        tables = self.connection.execute("SELECT name FROM sqlite_master").fetchall()
        if owner != APPLICATION_ID and (tables or owner):
            raise UsageError(
                f"{self.name}: is a database of another program, and is left as it is. Is the name right? "
                "A file that does not exist is made."
            )
        _check_version(self.name, version)

    def cause(self, error: Exception) -> tuple[str, str]:
        """Kind of a failure, and what the user may look for."""
        name = getattr(error, "sqlite_errorname", "")
        if name == "SQLITE_FULL" or name.startswith("SQLITE_IOERR"):
            return "disk_full", "is the disk full?"
        return "history_lost", "is the file still there, and does another program hold it?"

    def rows(self, query: str, parameters: Sequence[Any] = ()) -> Iterator[Row]:
        """Answers of a query, whose parameters are written as `?`."""
        yield from self.connection.execute(query, parameters)

    def write(self, commands: Sequence[tuple[str, Sequence[Row]]]) -> None:
        """Run commands, each for many rows of parameters, in one transaction."""
        try:
            self.connection.execute("BEGIN")
            for command, rows in commands:
                self.connection.executemany(command, rows)
            self.connection.execute("COMMIT")
        except BaseException:
            if self.connection.in_transaction:
                self.connection.execute("ROLLBACK")
            raise

    def delete_older(self, table: str, before_unix_s: float, most: int) -> int:
        """Delete at most so many rows; how many went."""
        chosen = f"SELECT rowid FROM {table} WHERE unix_s < ? LIMIT {most}"
        done = self.connection.execute(f"DELETE FROM {table} WHERE rowid IN ({chosen})", (before_unix_s,))
        return done.rowcount + (0 if self._is_file else self._delete_beyond(table))

    def _delete_beyond(self, table: str) -> int:
        newest = f"(SELECT max(rowid) FROM {table})"
        return self.connection.execute(
            f"DELETE FROM {table} WHERE rowid <= {newest} - ?", (MEMORY_ROWS,)
        ).rowcount

    def interrupt(self) -> None:
        """End, from another thread, what is being done now: it fails as if the database were away."""
        self.connection.interrupt()

    def close(self) -> None:
        """Close the connection."""
        self.connection.close()


class Postgres:
    """A database of a server, used as `Sqlite` is; a lost connection is opened again by what is asked next.

    Raises:
        UsageError: it cannot be reached, the account may not use it, or its tables are of another version.
    """

    def __init__(self, url: str, tables: Sequence[str]) -> None:
        refuse_secret("--postgres", url, "postgresql")
        self._library: ModuleType = load("psycopg", "psycopg", "postgres", "--postgres needs")
        self.failures: type[Exception] = self._library.Error
        self.away: tuple[type[Exception], ...] = (
            self._library.OperationalError,
            self._library.InterfaceError,
        )
        self._url = url
        self._connection: Any = None
        self._failure = ""
        self._again_s = 0.0
        try:
            info = self._library.conninfo.conninfo_to_dict(url)
            self._options = f"{info.get('options', '')} {OPTIONS}".strip()
            self.name = f"postgres {info.get('dbname', '')}@{info.get('host', 'local')}"
            connection = self._connected()
            with connection.transaction():
                connection.execute("CREATE TABLE IF NOT EXISTS fltea_fleet (version INTEGER NOT NULL)")
                found = connection.execute("SELECT version FROM fltea_fleet").fetchone()
                _check_version(self.name, 0 if found is None else found[0])
                for command in tables:
                    connection.execute(command.replace(" REAL", " DOUBLE PRECISION"))
                if found is None:
                    connection.execute("INSERT INTO fltea_fleet VALUES (%s)", (SCHEMA_VERSION,))
        except UsageError:
            self.close()
            raise
        except self.failures as error:
            reason = str(error).partition("\n")[0]
            raise UsageError(
                f"--postgres: cannot be used ({reason}). Does the server run, is there such a "
                "database, and may this account make tables in it?"
            ) from error

    def cause(self, error: Exception) -> tuple[str, str]:
        """See `Sqlite`."""
        if isinstance(error, self.away):
            return "history_lost", "is the server away? It is tried again."
        return "history_lost", "may this account still write to its tables?"

    def rows(self, query: str, parameters: Sequence[Any] = ()) -> Iterator[Row]:
        """See `Sqlite`."""
        connection = self._connected()
        with connection.transaction(), connection.cursor(name="fltea") as cursor:
            yield from cursor.execute(query.replace("?", "%s"), parameters)

    def write(self, commands: Sequence[tuple[str, Sequence[Row]]]) -> None:
        """See `Sqlite`."""
        connection = self._connected()
        with connection.transaction(), connection.cursor() as cursor:
            for command, rows in commands:
                cursor.executemany(command.replace("?", "%s"), rows)

    def delete_older(self, table: str, before_unix_s: float, most: int) -> int:
        """See `Sqlite`."""
        chosen = f"SELECT ctid FROM {table} WHERE unix_s < %s LIMIT {most}"
        done = self._connected().execute(
            f"DELETE FROM {table} WHERE ctid = ANY(ARRAY({chosen}))", (before_unix_s,)
        )
        return int(done.rowcount)

    def interrupt(self) -> None:
        """See `Sqlite`. A server that stands still reads no request to cancel, so the line is cut."""
        with contextlib.suppress(OSError, self.failures):
            if self._connection is not None:
                with socket.socket(fileno=os.dup(self._connection.fileno())) as line:
                    line.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        """See `Sqlite`."""
        with contextlib.suppress(self.failures):
            if self._connection is not None:
                self._connection.close()

    def _connected(self) -> Any:
        if self._connection is not None and not self._connection.closed:
            return self._connection
        if self._failure and time.monotonic() < self._again_s:
            raise self.away[0](self._failure)
        try:
            self._connection = self._library.connect(
                self._url,
                autocommit=True,
                connect_timeout=CONNECT_S,
                tcp_user_timeout=SILENT_MS,
                options=self._options,
            )
        except self.failures as error:
            self._failure, self._again_s = str(error), time.monotonic() + AGAIN_S
            raise
        self._failure = ""
        return self._connection


Database = Sqlite | Postgres


def _check_version(name: str, version: int) -> None:
    if version not in (0, SCHEMA_VERSION):  # 0: a new one
        raise UsageError(f"{name}: is a history of another version of fltea ({version}). Give a new file.")
