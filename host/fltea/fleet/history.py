"""What sensors said earlier: a small database, pruned by age, whole after kill -9.

SQLite: in Python, one file, a writer and readers at a time; with its log ahead of the file (WAL) a
transaction is there whole or not at all. DuckDB reads the file as it is: ATTACH 'fleet.db' (TYPE sqlite).
"""

import sqlite3
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from fltea.fleet.figures import QUANTITIES, Figure
from fltea.fleet.roll import Axis
from fltea.records.errors import UsageError

FIGURES = [f"{quantity.name}{end}" for quantity in QUANTITIES for end in ("", "_low", "_high")]
COLUMNS = ["unix_s", "device_id", "axis", "verdict", "samples", *FIGURES]
SCHEMA_VERSION = 1
AT_ONCE = 5_000
"""Rows that one pruning deletes, so that the page does not wait for it."""

_CREATE = f"""
CREATE TABLE IF NOT EXISTS fit (
    unix_s REAL NOT NULL, device_id TEXT NOT NULL, axis TEXT NOT NULL, verdict TEXT NOT NULL,
    samples INTEGER NOT NULL, {", ".join(f"{name} REAL" for name in FIGURES)});
CREATE INDEX IF NOT EXISTS fit_of_device ON fit (device_id, unix_s);
CREATE INDEX IF NOT EXISTS fit_by_age ON fit (unix_s);
CREATE TABLE IF NOT EXISTS alert (
    unix_s REAL NOT NULL, state TEXT NOT NULL, kind TEXT NOT NULL, device_id TEXT NOT NULL,
    text TEXT NOT NULL);
CREATE INDEX IF NOT EXISTS alert_by_age ON alert (unix_s);
"""


class History:
    """The database file. every_s: an axis's fits are kept this far apart, and whenever its verdict changes.

    kept: rows that wait for `flush`. lost: rows that could not be written, as on a full disk.

    Raises:
        UsageError: the file is no such database, or cannot be written.
    """

    def __init__(self, path: Path | str, every_s: float) -> None:
        self.path, self.every_s = path, every_s
        self.lost = 0
        self.trouble = ""
        self._last: dict[tuple[str, str], tuple[float, str]] = {}
        self._rows: list[tuple[Any, ...]] = []
        self._alerts: list[tuple[Any, ...]] = []
        try:
            self._db = sqlite3.connect(path, isolation_level=None, check_same_thread=False, timeout=5.0)
            version = self._db.execute("PRAGMA user_version").fetchone()[0]
            if version not in (0, SCHEMA_VERSION):
                raise UsageError(
                    f"{path}: is a history of another version of fltea ({version}). Take a new file."
                )
            self._db.execute("PRAGMA journal_mode = WAL")
            self._db.execute("PRAGMA synchronous = NORMAL")
            self._db.executescript(_CREATE)
            self._db.execute(f"PRAGMA user_version = {SCHEMA_VERSION}")
        except sqlite3.Error as error:
            raise UsageError(
                f"{path}: cannot be used as a history ({error}). Is it a file of fltea fleet, in a folder "
                "that may be written?"
            ) from error

    def add(self, unix_s: float, device_id: str, name: str, axis: Axis) -> None:
        """Keep a fit, if it is due."""
        key = device_id, name
        at, verdict = self._last.get(key, (-1e18, ""))
        if 0 <= unix_s - at < self.every_s and verdict == axis.verdict:  # below 0: the clock was set back
            return
        self._last[key] = unix_s, axis.verdict
        figures = [axis.figures.get(quantity.name, (None, None, None)) for quantity in QUANTITIES]
        numbers = [number for figure in figures for number in figure]
        self._rows.append((unix_s, device_id, name, axis.verdict, axis.samples, *numbers))

    def add_alert(self, unix_s: float, state: str, kind: str, device_id: str, text: str) -> None:
        """Keep an alert."""
        self._alerts.append((unix_s, state, kind, device_id, text))

    def flush(self) -> None:
        """Write what waits, in one transaction. What cannot be written is counted, and told in `trouble`."""
        if not self._rows and not self._alerts:
            return
        rows, self._rows = self._rows, []
        alerts, self._alerts = self._alerts, []
        places = ", ".join("?" * len(COLUMNS))
        try:
            self._db.execute("BEGIN")
            self._db.executemany(f"INSERT INTO fit ({', '.join(COLUMNS)}) VALUES ({places})", rows)
            self._db.executemany("INSERT INTO alert VALUES (?, ?, ?, ?, ?)", alerts)
            self._db.execute("COMMIT")
            self.trouble = ""
        except sqlite3.Error as error:
            if self._db.in_transaction:
                self._db.execute("ROLLBACK")
            self.lost += len(rows) + len(alerts)
            self.trouble = f"{self.path}: the history cannot be written ({error}); is the disk full?"

    def prune(self, before_unix_s: float) -> int:
        """Delete what is older, some at a time; how many rows went."""
        gone = 0
        try:
            for name in ("fit", "alert"):
                chosen = f"SELECT rowid FROM {name} WHERE unix_s < ? LIMIT {AT_ONCE}"
                gone += self._db.execute(
                    f"DELETE FROM {name} WHERE rowid IN ({chosen})", (before_unix_s,)
                ).rowcount
        except sqlite3.Error as error:
            self.trouble = f"{self.path}: the history cannot be pruned ({error}); is the disk full?"
        return gone

    def of_device(self, device_id: str, most: int = 2000) -> list[dict[str, Any]]:
        """The newest rows of a sensor, the oldest of them first."""
        found = self._db.execute(
            f"SELECT {', '.join(COLUMNS)} FROM fit WHERE device_id = ? ORDER BY unix_s DESC LIMIT ?",
            (device_id, most),
        ).fetchall()
        return [dict(zip(COLUMNS, row, strict=True)) for row in reversed(found)]

    def alerts(self, most: int = 200) -> list[dict[str, Any]]:
        """The newest alerts, the newest first."""
        names = ("unix_s", "state", "kind", "device_id", "text")
        found = self._db.execute("SELECT * FROM alert ORDER BY unix_s DESC LIMIT ?", (most,)).fetchall()
        return [dict(zip(names, row, strict=True)) for row in found]

    def rows(self) -> Iterator[tuple[Any, ...]]:
        """All fits, in the order of `COLUMNS`, as they were kept."""
        yield from self._db.execute(f"SELECT {', '.join(COLUMNS)} FROM fit ORDER BY rowid")

    def close(self) -> None:
        """Write what waits, and close the file."""
        self.flush()
        self._db.close()


def figure_of(row: dict[str, Any], name: str) -> Figure | None:
    """A figure of a row of `of_device`."""
    values = row[name], row[f"{name}_low"], row[f"{name}_high"]
    return None if None in values else Figure(*values)
