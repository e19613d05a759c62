"""Databases for the history: a file of SQLite, or an existing PostgreSQL server."""

import contextlib
import logging
import os
import socket
import sqlite3
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

from fltea.records.errors import UsageError
from fltea.records.own_file import open_own
from fltea.records.secret import refuse_secret
from fltea.settings.extras import load

SCHEMA_VERSION = 2
APPLICATION_ID = 0x464C5445
"""Number that marks an SQLite file as one of fltea (the pragma application_id); in ASCII it reads "FLTE"."""

MEMORY_ROWS = 200_000
"""Largest number of rows of a table that is kept in memory if there is no file; they take about 100 MB."""

CONNECT_S = 5
AGAIN_S = 5.0
"""Pause after a failed connection, before the next attempt [s]."""

OPTIONS = "-c statement_timeout=10s -c lock_timeout=5s"
"""Options of PostgreSQL for this program's session: longest times for a command and for the wait for a lock.
"""

SILENT_MS = 10_000
"""Time without acknowledgement from the server after which the connection is closed [ms]."""

MAKING = 0x464C5445
"""Number of the server's advisory lock: two programs that create the tables at once would hinder each
other."""

SAYS = {
    "53100": ("disk_full", "is the server's disk full?"),
    "25006": ("history_lost", "is the server a standby now, or was it made read only?"),
    "42501": ("history_lost", "may this account still write to its tables?"),
    "42": ("history_lost", "was a table dropped or changed? A missing table is created at the next start."),
    "55P03": ("history_lost", "does another program hold the tables?"),
    "57014": ("history_lost", "is the server too busy, or does another program hold the tables?"),
}
"""Kind of an error and a question for the user, by PostgreSQL's error code or its first two characters."""

Row = tuple[Any, ...]


class Sqlite:
    """A database in a file, used by one thread at a time.

    The database's write-ahead log (WAL) guarantees that a transaction is complete or absent after a crash.

    `path`: the database file; None keeps at most `MEMORY_ROWS` rows of each table in memory.
    `name`: name of the database for messages, without secrets.
    `failures`: base class of the exceptions that the methods raise.
    `of_a_row`: exceptions that the values of a row cause. After any other exception, for instance because of
    a full disk, the same command may succeed later.

    Raises:
        UsageError: the file is not a database of fltea fleet, cannot be written, or is a link or a pipe.
    """

    failures: type[Exception] = sqlite3.Error
    of_a_row: tuple[type[Exception], ...] = (sqlite3.DataError, sqlite3.IntegrityError)

    def __init__(self, path: Path | None, tables: Sequence[str]) -> None:
        self.name = str(path or "in memory")
        self._is_file = path is not None
        try:
            if path is not None:
                # SQLite would follow a link, and would fill the file to which it leads
                os.close(open_own(path, 0o644))
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
        except (sqlite3.Error, OSError) as error:
            why = getattr(error, "strerror", None) or error
            raise UsageError(
                f"{path}: cannot be used as a history ({why}). Is it a file of fltea fleet, in a folder "
                "that may be written?"
            ) from error

    def _check_owner(self) -> None:
        """Refuse a database of another program, or of another version of fltea, without changing it."""
        version, owner = (
            self.connection.execute(f"PRAGMA {name}").fetchone()[0]
            for name in ("user_version", "application_id")
        )
        tables = self.connection.execute("SELECT name FROM sqlite_master").fetchall()
        if owner != APPLICATION_ID and (tables or owner):
            raise UsageError(
                f"{self.name}: is a database of another program, and was not changed. Check the name, or "
                "give the name of a new file, which is then created."
            )
        _check_version(self.name, version)

    def cause(self, error: Exception) -> tuple[str, str]:
        """Return the kind of an error, and a question that tells the user what to check."""
        name = getattr(error, "sqlite_errorname", "")
        if name == "SQLITE_FULL" or name.startswith("SQLITE_IOERR"):
            return "disk_full", "is the disk full?"
        return "history_lost", "is the file still there, and does another program hold it?"

    def rows(self, query: str, parameters: Sequence[Any] = ()) -> Iterator[Row]:
        """Yield the rows of a query, whose parameters are written as `?`."""
        yield from self.connection.execute(query, parameters)

    def write(self, commands: Sequence[tuple[str, Sequence[Row]]]) -> None:
        """Run commands, each for many rows of parameters, in one transaction.

        After an exception that is not in `of_a_row`, the same commands may be given again; no row is then
        written twice.
        """
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
        """Delete at most `most` rows older than `before_unix_s`; return the number of deleted rows."""
        chosen = f"SELECT rowid FROM {table} WHERE unix_s < ? LIMIT {most}"
        done = self.connection.execute(f"DELETE FROM {table} WHERE rowid IN ({chosen})", (before_unix_s,))
        return done.rowcount + (0 if self._is_file else self._delete_beyond(table))

    def _delete_beyond(self, table: str) -> int:
        newest = f"(SELECT max(rowid) FROM {table})"
        return self.connection.execute(
            f"DELETE FROM {table} WHERE rowid <= {newest} - ?", (MEMORY_ROWS,)
        ).rowcount

    def interrupt(self) -> None:
        """Abort the command that another thread is running. The command then raises one of `failures`."""
        self.connection.interrupt()

    def close(self) -> None:
        """Close the connection."""
        self.connection.close()


class Postgres:
    """A database on a PostgreSQL server, with the methods of `Sqlite`.

    After a lost connection, the next command connects again.

    `to_write`: whether missing tables are created; without it, the account needs only the right to read.

    Raises:
        UsageError: the server cannot be reached, the account may not use it, or its tables are of another
            version.
    """

    def __init__(self, url: str, tables: Sequence[str], *, to_write: bool = True) -> None:
        refuse_secret("--postgres", url, "postgresql")
        self._library: ModuleType = load("psycopg", "psycopg", "postgres", "--postgres needs")
        # psycopg warns when a connection is closed after an error. This program reports the error itself.
        logging.getLogger("psycopg").setLevel(logging.ERROR)
        self.failures: type[Exception] = self._library.Error
        self.of_a_row: tuple[type[Exception], ...] = (self._library.DataError, self._library.IntegrityError)
        self._url = url
        self._connection: Any = None
        self._failure = ""
        self._again_s = 0.0
        self._unsure: int | None = None
        try:
            info = self._library.conninfo.conninfo_to_dict(url)
            self._options = f"{info.get('options', '')} {OPTIONS}".strip()
            self.name = f"postgres {info.get('dbname', '')}@{info.get('host', 'local')}"
            self._prepare(tables, to_write)
        except UsageError:
            self.close()
            raise
        except self.failures as error:
            self.close()
            reason = str(error).partition("\n")[0]
            raise UsageError(
                f"--postgres: cannot be used ({reason}). Does the server run, is there such a "
                "database, and may this account make tables in it?"
            ) from error

    def _prepare(self, tables: Sequence[str], to_write: bool) -> None:
        connection = self._connected()
        with connection.transaction():
            if to_write:
                connection.execute("SELECT pg_advisory_xact_lock(%s)", (MAKING,))
                connection.execute("CREATE TABLE IF NOT EXISTS fltea_fleet (version INTEGER NOT NULL)")
            found = connection.execute("SELECT version FROM fltea_fleet").fetchone()
            _check_version(self.name, 0 if found is None else found[0])
            for command in tables if to_write else ():
                connection.execute(command.replace(" REAL", " DOUBLE PRECISION"))
            if to_write and found is None:
                connection.execute("INSERT INTO fltea_fleet VALUES (%s)", (SCHEMA_VERSION,))

    def cause(self, error: Exception) -> tuple[str, str]:
        """Return the kind of an error, and a question that tells the user what to check."""
        code = getattr(error, "sqlstate", None) or ""
        kind, question = SAYS.get(code) or SAYS.get(code[:2]) or ("history_lost", "is the server away?")
        return kind, f"{question} It is tried again."

    def rows(self, query: str, parameters: Sequence[Any] = ()) -> Iterator[Row]:
        """Yield the rows of a query, as `Sqlite.rows` does."""
        connection = self._connected()
        with connection.transaction(), connection.cursor(name="fltea") as cursor:
            yield from cursor.execute(query.replace("?", "%s"), parameters)

    def write(self, commands: Sequence[tuple[str, Sequence[Row]]]) -> None:
        """Run commands in one transaction, as `Sqlite.write` does.

        If a connection breaks during a COMMIT, the server is asked afterwards whether that transaction took
        place.
        """
        connection = self._connected()
        if self._unsure is not None and self._is_committed(connection, self._unsure):
            self._unsure = None
            return
        self._unsure = None
        with connection.transaction(), connection.cursor() as cursor:
            for command, rows in commands:
                cursor.executemany(command.replace("?", "%s"), rows)
            number = cursor.execute("SELECT txid_current()").fetchone()[0]
            self._unsure = number
        self._unsure = None

    def _is_committed(self, connection: Any, number: int) -> bool:
        """Return whether transaction `number` took place.

        Raises:
            psycopg.OperationalError: the transaction is still running.
        """
        try:
            (status,) = connection.execute("SELECT txid_status(%s)", (number,)).fetchone()
        except self.of_a_row:  # this server never had a transaction of that number: it is another server
            return False
        if status == "in progress":
            raise self._library.OperationalError("the transaction that was written last is still under way")
        return bool(status == "committed")

    def delete_older(self, table: str, before_unix_s: float, most: int) -> int:
        """Delete old rows, as `Sqlite.delete_older` does."""
        chosen = f"SELECT ctid FROM {table} WHERE unix_s < %s LIMIT {most}"
        done = self._connected().execute(
            f"DELETE FROM {table} WHERE ctid = ANY(ARRAY({chosen}))", (before_unix_s,)
        )
        return int(done.rowcount)

    def interrupt(self) -> None:
        """Abort the command that another thread is running, as `Sqlite.interrupt` does.

        The connection is shut down, since a server that hangs would ignore a request to cancel.
        """
        with contextlib.suppress(OSError, self.failures):
            if self._connection is not None:
                with socket.socket(fileno=os.dup(self._connection.fileno())) as connection:
                    connection.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        """Close the connection, as `Sqlite.close` does."""
        with contextlib.suppress(self.failures):
            if self._connection is not None:
                self._connection.close()

    def _connected(self) -> Any:
        if self._connection is not None and not self._connection.closed:
            return self._connection
        if self._failure and time.monotonic() < self._again_s:
            raise self._library.OperationalError(self._failure)
        try:
            self._connection = self._library.connect(
                self._url,
                autocommit=True,
                connect_timeout=CONNECT_S,
                tcp_user_timeout=SILENT_MS,
                options=self._options,
                # With this setting the server reports an error for characters that its database cannot store.
                client_encoding="utf8",
            )
        except self.failures as error:
            self._failure, self._again_s = str(error), time.monotonic() + AGAIN_S
            raise
        self._failure = ""
        return self._connection


Database = Sqlite | Postgres


def _check_version(name: str, version: int) -> None:
    if version not in (0, SCHEMA_VERSION):  # a new database has version 0
        raise UsageError(
            f"{name}: is a history in the format of another version of fltea ({version}). Give a new file or "
            "database."
        )
