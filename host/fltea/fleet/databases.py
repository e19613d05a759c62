"""Where the history is kept: a file of SQLite, or a PostgreSQL server that is there already."""

import contextlib
import sqlite3
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any, Protocol

from fltea.records.errors import UsageError
from fltea.settings.extras import load

SCHEMA_VERSION = 1
CONNECT_S = 5

Row = tuple[Any, ...]


class Database(Protocol):
    """What the history asks of a database. name: for messages, without secrets. failures: what it raises."""

    name: str
    failures: type[Exception]

    def rows(self, query: str, parameters: Sequence[Any] = ()) -> Iterator[Row]:
        """Answers of a query, whose parameters are written as `?`."""

    def write(self, commands: Sequence[tuple[str, Sequence[Row]]]) -> None:
        """Run commands, each for many rows of parameters, in one transaction."""

    def delete_older(self, table: str, before_unix_s: float, most: int) -> int:
        """Delete at most so many rows; how many went."""

    def close(self) -> None:
        """Let it go."""


class Sqlite:
    """A file; with its log ahead of the file (WAL) a transaction is there whole or not at all.

    Raises:
        UsageError: the file is no such database, or cannot be written.
    """

    failures: type[Exception] = sqlite3.Error

    def __init__(self, path: Path | str, tables: Sequence[str]) -> None:
        self.name = str(path)
        try:
            self.connection = sqlite3.connect(
                path, isolation_level=None, check_same_thread=False, timeout=5.0
            )
            version = self.connection.execute("PRAGMA user_version").fetchone()[0]
            _check_version(self.name, version)
            self.connection.execute("PRAGMA journal_mode = WAL")
            self.connection.execute("PRAGMA synchronous = NORMAL")
            for table in tables:
                self.connection.execute(table)
            self.connection.execute(f"PRAGMA user_version = {SCHEMA_VERSION}")
        except sqlite3.Error as error:
            raise UsageError(
                f"{path}: cannot be used as a history ({error}). Is it a file of fltea fleet, in a folder "
                "that may be written?"
            ) from error

    def rows(self, query: str, parameters: Sequence[Any] = ()) -> Iterator[Row]:
        """See `Database`."""
        yield from self.connection.execute(query, parameters)

    def write(self, commands: Sequence[tuple[str, Sequence[Row]]]) -> None:
        """See `Database`."""
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
        """See `Database`."""
        chosen = f"SELECT rowid FROM {table} WHERE unix_s < ? LIMIT {most}"
        done = self.connection.execute(f"DELETE FROM {table} WHERE rowid IN ({chosen})", (before_unix_s,))
        return done.rowcount

    def close(self) -> None:
        """See `Database`."""
        self.connection.close()


class Postgres:
    """A database of a server; a connection that is lost is opened again with the next thing that is asked.

    Raises:
        UsageError: it cannot be reached, the account may not use it, or its tables are of another version.
    """

    def __init__(self, url: str, tables: Sequence[str]) -> None:
        self._library: ModuleType = load("psycopg", "psycopg", "postgres", "--postgres needs")
        self.failures: type[Exception] = self._library.Error
        self._url = url
        self._connection: Any = None
        try:
            info = self._library.conninfo.conninfo_to_dict(url)
            self.name = f"postgres {info.get('dbname', '')}@{info.get('host', 'local')}"
            connection = self._connected()
            with connection.transaction():
                connection.execute("CREATE TABLE IF NOT EXISTS fltea_fleet (version INTEGER NOT NULL)")
                found = connection.execute("SELECT version FROM fltea_fleet").fetchone()
                _check_version(self.name, 0 if found is None else found[0])
                for table in tables:
                    connection.execute(table.replace(" REAL", " DOUBLE PRECISION"))
                if found is None:
                    connection.execute("INSERT INTO fltea_fleet VALUES (%s)", (SCHEMA_VERSION,))
        except self.failures as error:
            raise UsageError(
                f"--postgres: cannot be used ({_first_line(error)}). Does the server run, is there such a "
                "database, and may this account make tables in it?"
            ) from error

    def rows(self, query: str, parameters: Sequence[Any] = ()) -> Iterator[Row]:
        """See `Database`."""
        connection = self._connected()
        with connection.transaction(), connection.cursor(name="fltea") as cursor:
            yield from cursor.execute(query.replace("?", "%s"), parameters)

    def write(self, commands: Sequence[tuple[str, Sequence[Row]]]) -> None:
        """See `Database`."""
        connection = self._connected()
        with connection.transaction(), connection.cursor() as cursor:
            for command, rows in commands:
                cursor.executemany(command.replace("?", "%s"), rows)

    def delete_older(self, table: str, before_unix_s: float, most: int) -> int:
        """See `Database`."""
        chosen = f"SELECT ctid FROM {table} WHERE unix_s < %s LIMIT {most}"
        done = self._connected().execute(
            f"DELETE FROM {table} WHERE ctid = ANY(ARRAY({chosen}))", (before_unix_s,)
        )
        return int(done.rowcount)

    def close(self) -> None:
        """See `Database`."""
        with contextlib.suppress(self.failures):
            if self._connection is not None:
                self._connection.close()

    def _connected(self) -> Any:
        if self._connection is None or self._connection.closed:
            self._connection = self._library.connect(self._url, autocommit=True, connect_timeout=CONNECT_S)
        return self._connection


def _check_version(name: str, version: int) -> None:
    if version not in (0, SCHEMA_VERSION):
        raise UsageError(f"{name}: is a history of another version of fltea ({version}). Take a new one.")


def _first_line(error: Exception) -> str:
    return str(error).partition("\n")[0]
