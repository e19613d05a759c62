"""The program `fltea fleet`: it receives messages, compares sensors regularly, and keeps the history.

It also publishes alerts and makes the summary for the page.
"""

import math
import sys
import threading
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from fltea.fleet.alerts import Alert, Alerts
from fltea.fleet.clock import Clock
from fltea.fleet.databases import Database, Postgres, Sqlite
from fltea.fleet.history import TABLES, History
from fltea.fleet.listener import Listener
from fltea.fleet.roll import MOST_SENSORS, SILENT_S, Roll
from fltea.fleet.summary import Comparison, compare, counts
from fltea.settings.mqtt import MqttConfig

ASK_AT_ONCE, ASK_TIMES, ASK_EVERY_S = 200, 3, 30.0
"""Limits for requests to the broker to send retained messages again.

The limits are the number of sensors in one call of `turn`, the number of requests for a sensor whose messages
do not come, and the time between such requests [s].
"""

MOST_UNSENT = 10_000
"""Largest number of alerts that wait while the broker is away; further alerts are only counted."""

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
        self.comparison_s = 0.0
        self.alerts_unsent = 0
        self._write = write or (lambda text: print(text, file=sys.stderr, flush=True))
        self._comparison_due = 0.0
        self._asked: dict[str, tuple[int, float]] = {}
        self._asked_over = 0
        self._reported_trouble = ""
        self._unsent: deque[Alert] = deque()
        self._list_sent = 0
        self.listener = Listener(
            plan.mqtt, self.take, self.report, lambda: self._write("the broker is back.")
        )

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
            self.listener.fetch(self._lacking(now))
        if now < self._comparison_due:
            return
        self._comparison_due = now + self.plan.compare_every_s
        self.look_now()
        with self.lock:
            unix_s = self.clock.unix_s()
            gone = self.roll.forget(self.clock.hearing(), self.plan.keep_s)
            self.history.forget(gone)
            known = {one.device_id for one in self.roll.everybody()}
            self._asked = {name: asked for name, asked in self._asked.items() if name in known}
        self.history.work(-math.inf if self.clock.long_jump else unix_s - self.plan.keep_s)
        self._report_history()

    def _report_history(self) -> None:
        kind, trouble = self.history.trouble_kind, self.history.trouble
        if kind and kind != self._reported_trouble:
            self.report(kind, f"{trouble} Rows that wait: {self.history.waiting}; lost: {self.history.lost}.")
        elif self._reported_trouble and not kind:
            self.report("history_back", f"the history is written again. Rows lost: {self.history.lost}.")
        self._reported_trouble = kind

    def _lacking(self, now: float) -> list[str]:
        """Return the sensors whose retained messages are to be requested now.

        These sensors were not yet requested on this connection, or their fit or HELLO did not arrive.
        """
        lacking: list[str] = []
        with self.lock:
            if self._asked_over != self.listener.connections:
                self._asked_over = self.listener.connections
                self._asked.clear()
            for sensor in self.roll.everybody():
                name, is_whole = sensor.device_id, bool(sensor.axes) and sensor.hello is not None
                times, due = self._asked.get(name, (0, 0.0))
                if times < (1 if is_whole else ASK_TIMES) and now >= due:
                    self._asked[name] = times + 1, now + ASK_EVERY_S
                    lacking.append(name)
                    if len(lacking) == ASK_AT_ONCE:
                        break
        return lacking

    @property
    def is_complete(self) -> bool:
        """Whether the retained messages of all sensors have been asked for."""
        with self.lock:
            return all(one.device_id in self._asked for one in self.roll.everybody())

    def look_now(self) -> None:
        """Compare all sensors, and publish the alerts that have begun or ended."""
        with self.lock:
            begin = time.perf_counter()
            now, unix_s = self.clock.hearing(), self.clock.unix_s()
            self.seen = compare(self.roll, now, self.plan.silent_s)
            new = self.alerts.update(self.roll, self.seen, now, unix_s)
            for alert in new:
                self.history.add_alert(unix_s, alert.state, alert.kind, alert.device_id, alert.text)
            self.comparison_s = time.perf_counter() - begin
            room = MOST_UNSENT - len(self._unsent)
            self._unsent.extend(new[:room])
            self.alerts_unsent += len(new[room:])
        if self.listener.is_up.is_set():
            self._publish_alerts()

    def _publish_alerts(self) -> None:
        # The broker may still retain the list of an earlier run, or a list from before an outage.
        if self._unsent or self._list_sent != self.listener.connections:
            self._list_sent = self.listener.connections
            with self.lock:
                listed = self.alerts.listed()
            self.listener.publish("fleet/alerts", msgspec.json.encode(listed), retain=True)
        while self._unsent:
            alert = self._unsent.popleft()
            self.listener.publish("fleet/alert", msgspec.json.encode(alert), retain=False)

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
                "alerts_dropped": listed.dropped + self.alerts_unsent,
                "history": {
                    "waiting": self.history.waiting,
                    "lost": self.history.lost,
                    "pruned": self.history.pruned,
                    "trouble": self.history.trouble,
                    "clock_jumps": self.clock.jumps,
                },
                "comparison_ms": round(self.comparison_s * 1e3, 1),
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
        self._write(f"{kind}: {text}")
