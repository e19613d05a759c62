"""Earlier fits of sensors: pruned by age, bounded for each of them, whole after kill -9.

Usually in a file of SQLite, which is in Python; DuckDB reads it as it is: ATTACH 'fleet.db' (TYPE sqlite).
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
"""Rows that one transaction writes, and one pruning deletes."""

CHANGE_S = 60.0
"""New verdicts of an axis are kept this often at most, so that one that alternates does not fill the disk."""

MOST_WAITING = 50_000
"""Rows that wait while the database cannot be written: 30 MB; an hour of 5,000 sensors."""

STUCK_S = 30.0
"""Longer than a server needs that is only busy."""

LAST_S = 5.0
"""The end of the program waits so long for the last rows."""

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
    """The last row of an axis. changed_s: when a row of a new verdict was kept."""

    unix_s: float
    verdict: str
    changed_s: float


_NOTHING = _Kept(-math.inf, "", -math.inf)


class History:
    """The fits and alerts of the past. every_s: how far apart fits of an axis are; new verdicts are kept too.

    All work on the database is done in a thread of its own, so that one that is slow or away holds up nobody:
    what is due waits, `MOST_WAITING` rows at most. lost: rows that had no room there, or that the database
    refused as such; pruned: rows that were deleted by age. trouble: why the database cannot be used, "" when
    all is well; trouble_kind: of which kind that is.
    """

    def __init__(self, database: Database, every_s: float) -> None:
        self._database, self.every_s = database, every_s
        self.lost = self.pruned = 0
        self.trouble = self.trouble_kind = ""
        self._last: dict[str, dict[str, _Kept]] = {}
        self._waiting: deque[tuple[str, Row]] = deque()
        self._batch: list[tuple[str, Row]] = []
        """Rows of the transaction that is under way, or that failed and is tried again as it was."""
        self._lock = threading.Lock()
        self._thread = ThreadPoolExecutor(1, "history")
        self._work: Future[None] | None = None
        self._began_s = 0.0

    @property
    def waiting(self) -> int:
        """Rows that are due and not written yet."""
        return len(self._waiting) + len(self._batch)

    def add(self, unix_s: float, device_id: str, axes: Mapping[str, Axis]) -> None:
        """Keep the axes of a fit, those that are due."""
        last = self._last.setdefault(device_id, {})
        rows = []
        for name, axis in axes.items():
            kept = last.get(name, _NOTHING)
            is_new = axis.verdict != kept.verdict and _is_past(kept.changed_s, unix_s, CHANGE_S)
            if not is_new and not _is_past(kept.unix_s, unix_s, self.every_s):
                continue
            if name not in last and len(last) >= MOST_AXES:
                self.lost += 1  # a device has so many axes, and does not rename them
                continue
            last[name] = _Kept(unix_s, axis.verdict, unix_s if is_new else kept.changed_s)
            figures = [axis.figure(quantity.name) or (None, None, None) for quantity in SHOWN]
            numbers = [number for figure in figures for number in figure]
            rows.append((INSERT_FIT, (unix_s, device_id, name, axis.verdict, axis.samples, *numbers)))
        self._put(rows)

    def add_alert(self, unix_s: float, state: str, kind: str, device_id: str, text: str) -> None:
        """Keep an alert."""
        self._put([(INSERT_ALERT, (unix_s, state, kind, device_id, text))])

    def forget(self, device_ids: Iterable[str]) -> None:
        """Drop what is remembered of sensors that are there no more; their rows stay."""
        for name in device_ids:
            self._last.pop(name, None)

    def work(self, before_unix_s: float = -math.inf) -> None:
        """Begin to write what waits, and to delete what is older; what takes too long is broken off."""
        now_s = time.monotonic()
        if self._work is None or self._work.done():
            self.settle()
            self._began_s = now_s
            self._work = self._thread.submit(self._write_and_prune, before_unix_s)
        elif now_s - self._began_s > STUCK_S:
            self._began_s = now_s
            self._database.interrupt()

    def settle(self) -> None:
        """Wait for the work that was begun."""
        if self._work is not None:
            self._work.result()

    def of_device(self, device_id: str, most: int = 2000) -> "Future[list[dict[str, Any]]]":
        """The newest rows of a sensor, the oldest of them first."""
        query = f"SELECT {', '.join(COLUMNS)} FROM fit WHERE device_id = ? ORDER BY unix_s DESC LIMIT {most}"
        return self._thread.submit(lambda: self._answers(COLUMNS, query, (device_id,))[::-1])

    def alerts(self, most: int = 200) -> "Future[list[dict[str, Any]]]":
        """The newest alerts, the newest first."""
        query = f"SELECT {', '.join(ALERT_COLUMNS)} FROM alert ORDER BY unix_s DESC LIMIT {most}"
        return self._thread.submit(self._answers, ALERT_COLUMNS, query, ())

    def close(self) -> None:
        """Write what waits, and close the file. What a database that is away did not take is lost."""
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

    # --- in the thread of the database ---

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
        """A transaction; whole fits, since the rows of a fit are put there together."""
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
            self._write_one_by_one()  # a row is to blame: the others have to go on
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
        """Whether no row is to blame, so that the same may be written later."""
        return isinstance(error, self._database.failures) and not isinstance(error, self._database.of_a_row)

    def _answers(self, names: Iterable[str], query: str, parameters: tuple[Any, ...]) -> list[dict[str, Any]]:
        try:
            return [dict(zip(names, row, strict=True)) for row in self._database.rows(query, parameters)]
        except self._database.of_a_row:  # the name of a sensor that the database cannot hold
            return []
        except self._database.failures as error:
            self._explain(error, "read")
            return []

    def _explain(self, error: Exception, what: str) -> None:
        self.trouble_kind, question = self._database.cause(error)
        reason = str(error).partition("\n")[0]
        self.trouble = f"{self._database.name}: the history cannot be {what} ({reason}); {question}"


def _is_past(then_s: float, now_s: float, period_s: float) -> bool:
    """Whether a period is over; it is too when the clock was set back."""
    return not 0 <= now_s - then_s < period_s


def _by_command(rows: list[tuple[str, Row]]) -> list[tuple[str, list[Row]]]:
    """The rows of each command."""
    found: dict[str, list[Row]] = {}
    for command, row in rows:
        found.setdefault(command, []).append(row)
    return list(found.items())
