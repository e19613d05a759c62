"""The program `fltea fleet`: it receives messages, compares sensors regularly, and keeps the history.

It also publishes alerts and makes the summary for the page.
"""

import math
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from fltea.fleet.alert_post import AlertPost
from fltea.fleet.alerts import AlertList, Alerts
from fltea.fleet.clock import Clock
from fltea.fleet.databases import Database, Postgres, Sqlite
from fltea.fleet.history import TABLES, History
from fltea.fleet.listener import Listener
from fltea.fleet.requests import Requests
from fltea.fleet.roll import MOST_SENSORS, SILENT_S, Roll
from fltea.fleet.summary import Comparison, compare, counts
from fltea.settings.mqtt import MqttConfig

TURN_S = 0.2


class Plan(NamedTuple):
    """Settings of a fleet.

    `mqtt`: settings of the connection to the broker.
    `history`: database file of the history; None: in memory. `postgres`: URL of a server used instead of a
    file.
    `history_every_s`: least time between two stored fits of an axis [s].
    `keep_s`: time after which rows of the history and silent sensors are dropped [s].
    `silent_s`: time without messages after which a sensor is silent [s].
    `compare_every_s`: time between comparisons of all sensors [s].
    `most`: largest number of sensors.
    """

    mqtt: MqttConfig
    history: Path | None = None
    postgres: str | None = None
    history_every_s: float = 600.0
    keep_s: float = 30 * 86_400.0
    silent_s: float = SILENT_S
    compare_every_s: float = 5.0
    most: int = MOST_SENSORS


def _database(plan: Plan) -> Database:
    if plan.postgres is not None:
        return Postgres(plan.postgres, TABLES)
    return Sqlite(plan.history, TABLES)


class _Problems:
    """Writes lines of text about problems for the user. `write`: writes one line."""

    def __init__(self, write: Callable[[str], None] | None) -> None:
        self.write = write or (lambda text: print(text, file=sys.stderr, flush=True))
        self._of_history = ""

    def report(self, kind: str, text: str) -> None:
        """Write a line about a problem; any thread may call this."""
        self.write(f"{kind}: {text}")

    def report_history(self, history: History) -> None:
        """Write a line if a problem of the history has begun or ended since the last call."""
        kind, trouble = history.trouble_kind, history.trouble
        if kind and kind != self._of_history:
            self.report(kind, f"{trouble} Rows that wait: {history.waiting}; lost: {history.lost}.")
        elif self._of_history and not kind:
            self.report("history_back", f"the history is written again. Rows lost: {history.lost}.")
        self._of_history = kind


class Fleet:
    """The program. `lock` protects all its data. The caller must call `turn` every `TURN_S` seconds.

    Raises:
        UsageError: the settings or the history database cannot be used.
    """

    def __init__(self, plan: Plan, write: Callable[[str], None] | None = None) -> None:
        self.plan = plan
        self.lock = threading.Lock()
        self.clock = Clock()
        self.roll = Roll(plan.mqtt.prefix, plan.most)
        self.seen = Comparison([], {})
        self.alerts = Alerts(plan.silent_s)
        self.history = History(_database(plan), plan.history_every_s)
        self._problems = problems = _Problems(write)
        self._comparison_due = 0.0
        self._requests = Requests()
        self.listener = Listener(
            plan.mqtt, self.take, self.report, lambda: problems.write("the broker is back.")
        )
        self._post = AlertPost(self.listener)

    def start(self) -> None:
        """Connect to the broker."""
        self.listener.start()

    def take(self, topic: str, payload: bytes) -> None:
        """Process one message; the listener's thread calls this."""
        with self.lock:
            before = self.roll.fits
            sensor = self.roll.take(topic, payload, self.clock.hearing())
            if sensor is not None and self.roll.fits > before:
                self.history.add(self.clock.unix_s(), sensor.device_id, sensor.axes)

    def turn(self) -> None:
        """Do the work that is due: compare sensors, publish alerts, write the history, request messages."""
        now, is_up = self.clock.steady(), self.listener.is_up.is_set()
        with self.lock:
            self.clock.hear(is_up)
        if is_up:
            with self.lock:
                due = self._requests.due(self.roll.everybody(), self.listener.connections, now)
            self.listener.fetch(due)
        if now < self._comparison_due:
            return
        self._comparison_due = now + self.plan.compare_every_s
        self.look_now()
        with self.lock:
            unix_s = self.clock.unix_s()
            gone = self.roll.forget(self.clock.hearing(), self.plan.keep_s)
            self.history.forget(gone)
            self._requests.keep_only({one.device_id for one in self.roll.everybody()})
        self.history.work(-math.inf if self.clock.long_jump else unix_s - self.plan.keep_s)
        self._problems.report_history(self.history)

    @property
    def is_complete(self) -> bool:
        """Whether the retained messages of all sensors have been asked for."""
        with self.lock:
            return self._requests.has_all(self.roll.everybody())

    def look_now(self) -> None:
        """Compare all sensors, and publish the alerts that have begun or ended."""
        with self.lock:
            begin = time.perf_counter()
            now, unix_s = self.clock.hearing(), self.clock.unix_s()
            self.seen = compare(self.roll, now, self.plan.silent_s)
            new = self.alerts.update(self.roll, self.seen, now, unix_s)
            for alert in new:
                self.history.add_alert(unix_s, alert.state, alert.kind, alert.device_id, alert.text)
            self.seen = self.seen._replace(took_s=time.perf_counter() - begin)
            self._post.add(new)
        if self.listener.is_up.is_set():
            self._post.publish(self._listed)

    def _listed(self) -> AlertList:
        with self.lock:
            return self.alerts.listed()

    def summary(self) -> dict[str, Any]:
        """Return the counts of the fleet, its outliers and its alerts."""
        with self.lock:
            listed = self.alerts.listed()
            found = counts(self.roll, self.clock.hearing(), self.plan.silent_s)
            found |= {
                "class": "fleet",
                "unix_s": self.clock.unix_s(),
                "connected": self.listener.is_up.is_set(),
                "outages": self.listener.outages,
                "odd": [msgspec.to_builtins(one) for one in self.seen.odd[:200]],
                "odd_count": len(self.seen.odd),
                "alerts": listed.alerts[:200],
                "alert_count": listed.count,
                "alerts_by_kind": self.alerts.counts(),
                "alerts_dropped": listed.dropped + self._post.unsent,
                "history": {
                    "waiting": self.history.waiting,
                    "lost": self.history.lost,
                    "pruned": self.history.pruned,
                    "trouble": self.history.trouble,
                    "clock_jumps": self.clock.jumps,
                },
                "comparison_ms": round(self.seen.took_s * 1e3, 1),
            }
        return found

    def close(self) -> None:
        """Disconnect, and write the waiting rows of the history."""
        self.listener.close()
        lost = self.history.lost
        self.history.close()
        if self.history.lost > lost:
            rows = self.history.lost - lost
            self.report("history_lost", f"{self.history.trouble} Rows that waited and are lost: {rows}.")

    def report(self, kind: str, text: str) -> None:
        """Write a line of text about a problem for the user; any thread may call this."""
        self._problems.report(kind, text)
