"""The history of sensors' fits and of alerts in a database, from which old rows are deleted.

The database is usually an SQLite file. SQLite is part of Python, and the file stays intact after kill -9.
DuckDB can read it: ATTACH 'fleet.db' (TYPE sqlite).
"""

import math
import threading
import time
from collections import deque
from collections.abc import Iterable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor, wait
from typing import Any, NamedTuple

from fltea.fleet.databases import Database
from fltea.fleet.figures import SHOWN
from fltea.fleet.messages import MOST_AXES
from fltea.fleet.roll import Axis

FIGURES = [f"{quantity.name}{end}" for quantity in SHOWN for end in ("", "_low", "_high")]
COLUMNS = ["unix_s", "device_id", "axis", "verdict", "samples", *FIGURES]
ALERT_COLUMNS = ("unix_s", "state", "kind", "device_id", "text")
AT_ONCE = 5_000
"""Largest number of rows that one transaction writes or deletes."""

CHANGE_S = 60.0
"""Two changes of an axis's result are both stored only if at least this time lies between them [s]. So a
flickering result does not fill the disk.
"""

MOST_WAITING = 50_000
"""Largest number of rows that wait while the database cannot be written: 30 MB, or one hour of 5,000 sensors.
"""

STUCK_S = 30.0
"""Time after which a command to the database is interrupted [s]; a busy server needs less time."""

LAST_S = 5.0
"""Longest time for which the program, at its end, waits until the last rows are written [s]."""

TABLES = (
    "CREATE TABLE IF NOT EXISTS fit (unix_s REAL NOT NULL, device_id TEXT NOT NULL, axis TEXT NOT NULL, "
    f"verdict TEXT NOT NULL, samples BIGINT NOT NULL, {', '.join(f'{name} REAL' for name in FIGURES)})",
    "CREATE INDEX IF NOT EXISTS fit_of_device ON fit (device_id, unix_s)",
    "CREATE INDEX IF NOT EXISTS fit_by_age ON fit (unix_s)",
    "CREATE TABLE IF NOT EXISTS alert (unix_s REAL NOT NULL, state TEXT NOT NULL, kind TEXT NOT NULL, "
    "device_id TEXT NOT NULL, text TEXT NOT NULL)",
    "CREATE INDEX IF NOT EXISTS alert_by_age ON alert (unix_s)",
)

INSERT_FIT = f"INSERT INTO fit ({', '.join(COLUMNS)}) VALUES ({', '.join('?' * len(COLUMNS))})"
INSERT_ALERT = f"INSERT INTO alert ({', '.join(ALERT_COLUMNS)}) VALUES (?, ?, ?, ?, ?)"

Row = tuple[Any, ...]


class _Kept(NamedTuple):
    """The last stored row of an axis. `changed_s`: Unix time of the last stored change of the result [s]."""

    unix_s: float
    verdict: str
    changed_s: float


_NOTHING = _Kept(-math.inf, "", -math.inf)


class LastRows:
    """The last stored row of each axis. It decides whether the next fit of the axis is stored, too.

    `every_s`: least time between two stored fits of an axis [s]; changes of the result are stored in
    addition.
    """

    def __init__(self, every_s: float) -> None:
        self.every_s = every_s
        self._last: dict[str, dict[str, _Kept]] = {}

    def take(self, unix_s: float, device_id: str, axes: Mapping[str, Axis]) -> tuple[list[str], int]:
        """Return the axes whose fits are stored now, and how many are refused: a device has too many axes."""
        last = self._last.setdefault(device_id, {})
        stored, surplus = [], 0
        for name, axis in axes.items():
            kept = last.get(name, _NOTHING)
            is_new = axis.verdict != kept.verdict and _is_past(kept.changed_s, unix_s, CHANGE_S)
            if not is_new and not _is_past(kept.unix_s, unix_s, self.every_s):
                continue
            if name not in last and len(last) >= MOST_AXES:
                surplus += 1  # a real device has fewer axes, and does not give them new names all the time
                continue
            last[name] = _Kept(unix_s, axis.verdict, unix_s if is_new else kept.changed_s)
            stored.append(name)
        return stored, surplus

    def forget(self, device_ids: Iterable[str]) -> None:
        """Release the memory for sensors that were dropped."""
        for name in device_ids:
            self._last.pop(name, None)


class History:
    """The history of fits and alerts.

    A separate thread does all work on the database, so that a slow or absent database does not block the
    program. Until the thread has written them, at most `MOST_WAITING` rows wait.

    `every_s`: least time between two stored fits of an axis [s]; changes of the result are stored in
    addition.
    `lost`: number of rows that were lost, because too many rows were waiting or the database refused them.
    `pruned`: number of rows that were deleted because of their age.
    `trouble`: why the database cannot be used; empty if it can.
    `trouble_kind`: kind of the error for `trouble`.
    """

    def __init__(self, database: Database, every_s: float) -> None:
        self._database, self._last_rows = database, LastRows(every_s)
        self.lost = self.pruned = 0
        self.trouble = self.trouble_kind = ""
        self._waiting: deque[tuple[str, Row]] = deque()
        self._batch: list[tuple[str, Row]] = []
        """Rows of the current transaction. After a failure the same rows are tried again unchanged."""
        self._lock = threading.Lock()
        self._thread = ThreadPoolExecutor(1, "history")
        self._work: Future[None] | None = None
        self._began_s = 0.0

    @property
    def waiting(self) -> int:
        """Number of rows that are not written yet."""
        return len(self._waiting) + len(self._batch)

    def add(self, unix_s: float, device_id: str, axes: Mapping[str, Axis]) -> None:
        """Add a row for each axis of a fit whose last row is old enough, or whose result has changed."""
        stored, surplus = self._last_rows.take(unix_s, device_id, axes)
        self.lost += surplus
        rows = []
        for name in stored:
            axis = axes[name]
            figures = [axis.figure(quantity.name) or (None, None, None) for quantity in SHOWN]
            numbers = [number for figure in figures for number in figure]
            rows.append((INSERT_FIT, (unix_s, device_id, name, axis.verdict, axis.samples, *numbers)))
        self._put(rows)

    def add_alert(self, unix_s: float, state: str, kind: str, device_id: str, text: str) -> None:
        """Add an alert."""
        self._put([(INSERT_ALERT, (unix_s, state, kind, device_id, text))])

    def forget(self, device_ids: Iterable[str]) -> None:
        """Release the memory for sensors that were dropped. Their rows stay in the database."""
        self._last_rows.forget(device_ids)

    def work(self, before_unix_s: float = -math.inf) -> None:
        """Start writing waiting rows, and deleting rows older than `before_unix_s`, in the database's thread.

        Work that takes longer than `STUCK_S` is interrupted.
        """
        now_s = time.monotonic()
        if self._work is None or self._work.done():
            self.settle()
            self._began_s = now_s
            self._work = self._thread.submit(self._write_and_prune, before_unix_s)
        elif now_s - self._began_s > STUCK_S:
            self._began_s = now_s
            self._database.interrupt()

    def settle(self) -> None:
        """Wait until the writing and deleting that `work` started is done."""
        if self._work is not None:
            self._work.result()

    def of_device(self, device_id: str, most: int = 2000) -> "Future[list[dict[str, Any]]]":
        """Return a future that gives the newest `most` rows of a sensor, in order of time."""
        query = f"SELECT {', '.join(COLUMNS)} FROM fit WHERE device_id = ? ORDER BY unix_s DESC LIMIT {most}"
        return self._thread.submit(lambda: self._answers(COLUMNS, query, (device_id,))[::-1])

    def alerts(self, most: int = 200) -> "Future[list[dict[str, Any]]]":
        """Return a future that gives the newest `most` alerts, the newest first."""
        query = f"SELECT {', '.join(ALERT_COLUMNS)} FROM alert ORDER BY unix_s DESC LIMIT {most}"
        return self._thread.submit(self._answers, ALERT_COLUMNS, query, ())

    def close(self) -> None:
        """Write waiting rows and close the database. Rows that cannot be written within `LAST_S` are lost."""
        last = self._thread.submit(self._write_and_prune, -math.inf)
        while not last.done():
            if wait([last], LAST_S).not_done:
                self._database.interrupt()
        self._thread.shutdown()
        self.lost += self.waiting
        self._waiting.clear()
        self._batch.clear()
        self._database.close()

    def _put(self, rows: list[tuple[str, Row]]) -> None:
        with self._lock:
            room = max(0, MOST_WAITING - self.waiting)
            self._waiting.extend(rows[:room])
            self.lost += len(rows[room:])

    # --- The methods below run in the thread of the database. ---

    def _write_and_prune(self, before_unix_s: float) -> None:
        try:
            while self.waiting:
                self._write()
            for table in ("fit", "alert"):
                self.pruned += self._database.delete_older(table, before_unix_s, AT_ONCE)
            self.trouble = self.trouble_kind = ""
        except self._database.failures as error:
            self._explain(error, "written")

    def _write(self) -> None:
        """Write one transaction. It holds whole fits, so that all rows of a fit appear together."""
        with self._lock:
            rows = self._batch
            if not rows:
                rows += [self._waiting.popleft() for _ in range(min(AT_ONCE, len(self._waiting)))]
                while self._waiting and self._waiting[0][1][:2] == rows[-1][1][:2]:
                    rows.append(self._waiting.popleft())
        try:
            self._database.write(_by_command(rows))
        except Exception as error:
            if self._is_of_the_database(error):
                raise
            self._write_one_by_one()  # the database refuses one row; the other rows are written
        self._batch = []

    def _write_one_by_one(self) -> None:
        with self._lock:
            self._waiting.extendleft(reversed(self._batch))
            left = len(self._batch)
            self._batch = []
        for _ in range(left):
            with self._lock:
                self._batch = [self._waiting.popleft()]
            try:
                self._database.write(_by_command(self._batch))
            except Exception as error:
                if self._is_of_the_database(error):
                    raise
                self.lost += 1

    def _is_of_the_database(self, error: Exception) -> bool:
        """Return whether the error was caused by the database, and not by a row.

        The rows may then be written later.
        """
        return isinstance(error, self._database.failures) and not isinstance(error, self._database.of_a_row)

    def _answers(self, names: Iterable[str], query: str, parameters: tuple[Any, ...]) -> list[dict[str, Any]]:
        try:
            return [dict(zip(names, row, strict=True)) for row in self._database.rows(query, parameters)]
        except self._database.of_a_row:  # the sensor's name has characters that the database cannot store
            return []
        except self._database.failures as error:
            self._explain(error, "read")
            return []

    def _explain(self, error: Exception, what: str) -> None:
        self.trouble_kind, question = self._database.cause(error)
        reason = str(error).partition("\n")[0]
        self.trouble = f"{self._database.name}: the history cannot be {what} ({reason}); {question}"


def _is_past(then_s: float, now_s: float, period_s: float) -> bool:
    """Return whether `period_s` has passed since `then_s`; also True if the clock was set back since then."""
    return not 0 <= now_s - then_s < period_s


def _by_command(rows: list[tuple[str, Row]]) -> list[tuple[str, list[Row]]]:
    """Return the rows grouped by their SQL command."""
    grouped: dict[str, list[Row]] = {}
    for command, row in rows:
        grouped.setdefault(command, []).append(row)
    return list(grouped.items())
