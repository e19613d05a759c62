"""What sensors said earlier: pruned by age, whole after kill -9.

Usually in a file of SQLite, which is in Python; DuckDB reads it as it is: ATTACH 'fleet.db' (TYPE sqlite).
"""

from collections.abc import Iterator
from typing import Any

from fltea.fleet.databases import Database
from fltea.fleet.figures import QUANTITIES
from fltea.fleet.roll import Axis

FIGURES = [f"{quantity.name}{end}" for quantity in QUANTITIES for end in ("", "_low", "_high")]
COLUMNS = ["unix_s", "device_id", "axis", "verdict", "samples", *FIGURES]
AT_ONCE = 5_000
"""Rows that one pruning deletes, so that the page does not wait for it."""

TABLES = (
    "CREATE TABLE IF NOT EXISTS fit (unix_s REAL NOT NULL, device_id TEXT NOT NULL, axis TEXT NOT NULL, "
    f"verdict TEXT NOT NULL, samples BIGINT NOT NULL, {', '.join(f'{name} REAL' for name in FIGURES)})",
    "CREATE INDEX IF NOT EXISTS fit_of_device ON fit (device_id, unix_s)",
    "CREATE INDEX IF NOT EXISTS fit_by_age ON fit (unix_s)",
    "CREATE TABLE IF NOT EXISTS alert (unix_s REAL NOT NULL, state TEXT NOT NULL, kind TEXT NOT NULL, "
    "device_id TEXT NOT NULL, text TEXT NOT NULL)",
    "CREATE INDEX IF NOT EXISTS alert_by_age ON alert (unix_s)",
)


class History:
    """The fits and alerts of the past. every_s: how far apart fits of an axis are; new verdicts are all kept.

    lost: rows that could not be written, as on a full disk; trouble: why, "" when all is well.
    """

    def __init__(self, database: Database, every_s: float) -> None:
        self._database, self.every_s = database, every_s
        self.lost = 0
        self.trouble = ""
        self._last: dict[tuple[str, str], tuple[float, str]] = {}
        self._rows: list[tuple[Any, ...]] = []
        self._alerts: list[tuple[Any, ...]] = []

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
            self._database.write(
                [
                    (f"INSERT INTO fit ({', '.join(COLUMNS)}) VALUES ({places})", rows),
                    ("INSERT INTO alert VALUES (?, ?, ?, ?, ?)", alerts),
                ]
            )
            self.trouble = ""
        except self._database.failures as error:
            self.lost += len(rows) + len(alerts)
            self.trouble = (
                f"{self._database.name}: the history cannot be written ({error}); is the disk full?"
            )

    def prune(self, before_unix_s: float) -> int:
        """Delete what is older, some at a time; how many rows went."""
        try:
            return sum(self._database.delete_older(name, before_unix_s, AT_ONCE) for name in ("fit", "alert"))
        except self._database.failures as error:
            self.trouble = f"{self._database.name}: the history cannot be pruned ({error}); is the disk full?"
            return 0

    def of_device(self, device_id: str, most: int = 2000) -> list[dict[str, Any]]:
        """The newest rows of a sensor, the oldest of them first."""
        query = f"SELECT {', '.join(COLUMNS)} FROM fit WHERE device_id = ? ORDER BY unix_s DESC LIMIT {most}"
        found = self._answers(query, (device_id,))
        return [dict(zip(COLUMNS, row, strict=True)) for row in reversed(found)]

    def alerts(self, most: int = 200) -> list[dict[str, Any]]:
        """The newest alerts, the newest first."""
        names = ("unix_s", "state", "kind", "device_id", "text")
        found = self._answers(f"SELECT * FROM alert ORDER BY unix_s DESC LIMIT {most}", ())
        return [dict(zip(names, row, strict=True)) for row in found]

    def rows(self) -> Iterator[tuple[Any, ...]]:
        """All fits, in the order of `COLUMNS`, the oldest first."""
        yield from self._database.rows(
            f"SELECT {', '.join(COLUMNS)} FROM fit ORDER BY unix_s, device_id, axis"
        )

    def _answers(self, query: str, parameters: tuple[Any, ...]) -> list[tuple[Any, ...]]:
        try:
            return list(self._database.rows(query, parameters))
        except self._database.failures as error:
            self.trouble = f"{self._database.name}: the history cannot be read ({error})."
            return []

    def close(self) -> None:
        """Write what waits, and close the file."""
        self.flush()
        self._database.close()
