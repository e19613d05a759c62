"""`fltea fleet` as a whole: messages in, a look every few seconds, history, alerts, and a summary."""

import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from fltea.fleet.alerts import Alerts
from fltea.fleet.databases import Database, Postgres, Sqlite
from fltea.fleet.history import TABLES, History
from fltea.fleet.listener import Listener
from fltea.fleet.roll import MOST_SENSORS, SILENT_S, Roll
from fltea.fleet.summary import Look, counts, look
from fltea.settings.outputs import MqttConfig

JUMP_S = 60.0
"""The wall clock is taken as set again if it differs from the steady one by more."""

ASK_AT_ONCE, ASK_TIMES, ASK_EVERY_S = 200, 3, 30.0
"""So many sensors a turn; so often for one of which the broker retains nothing."""

LONG_JUMP_S = 86_400.0
"""After such a jump nothing is pruned: nobody knows how old the rows are."""


TURN_S = 0.2


class Plan(NamedTuple):
    """What a fleet does. history: a file, postgres: a server in its place; keep_s: how long rows are kept."""

    mqtt: MqttConfig
    history: Path | None = None
    postgres: str | None = None
    history_every_s: float = 600.0
    keep_s: float = 30 * 86_400.0
    silent_s: float = SILENT_S
    look_every_s: float = 5.0
    most: int = MOST_SENSORS


class Clock:
    """Unix time that does not jump with the wall clock by itself, but follows it, and counts the jumps."""

    def __init__(
        self, wall: Callable[[], float] = time.time, steady: Callable[[], float] = time.monotonic
    ) -> None:
        self._wall, self.steady = wall, steady
        self._offset = wall() - steady()
        self.jumps = 0
        self.long_jump = False

    def unix_s(self) -> float:
        """Now."""
        offset = self._wall() - self.steady()
        if abs(offset - self._offset) > JUMP_S:
            self.jumps += 1
            self.long_jump |= abs(offset - self._offset) > LONG_JUMP_S
            self._offset = offset
        return self.steady() + self._offset


def _database(plan: Plan) -> Database:
    if plan.postgres is not None:
        return Postgres(plan.postgres, TABLES)
    return Sqlite(plan.history or ":memory:", TABLES)


class Fleet:
    """The program. All state is behind `lock`; `turn` is called every `TURN_S` by whoever runs it.

    Raises:
        UsageError: settings, or a history, that cannot be used.
    """

    def __init__(self, plan: Plan, say: Callable[[str], None] | None = None) -> None:
        self.plan = plan
        self.lock = threading.Lock()
        self.clock = Clock()
        self.roll = Roll(plan.mqtt.prefix, plan.most)
        self.seen = Look([], {})
        self.alerts = Alerts(plan.silent_s)
        self.history = History(_database(plan), plan.history_every_s)
        self.pruned = 0
        self.look_s = 0.0
        self._say = say or (lambda text: print(text, file=sys.stderr, flush=True))
        self._look_due = 0.0
        self._asked: dict[str, tuple[int, float]] = {}
        self._told = ""
        self.listener = Listener(plan.mqtt, self.take, self._tell, lambda: self._say("the broker is back."))

    def start(self) -> None:
        """Connect to the broker."""
        self.listener.start()

    def take(self, topic: str, payload: bytes) -> None:
        """One message, from the listener's thread."""
        with self.lock:
            now = self.clock.steady()
            before = self.roll.fits
            sensor = self.roll.take(topic, payload, now)
            if sensor is not None and self.roll.fits > before:
                unix_s = self.clock.unix_s()
                for name, axis in sensor.axes.items():
                    self.history.add(unix_s, sensor.device_id, name, axis)

    def turn(self) -> None:
        """What is due: a look, alerts, history, and what the broker retains of sensors that are new."""
        now = self.clock.steady()
        if self.listener.is_up.is_set():
            self.listener.fetch(self._lacking(now))
        if now < self._look_due:
            return
        self._look_due = now + self.plan.look_every_s
        self.look_now()
        with self.lock:
            self.history.flush()
            unix_s = self.clock.unix_s()
            if not self.clock.long_jump:
                self.pruned += self.history.prune(unix_s - self.plan.keep_s)
            for name in self.roll.forget(now - self.plan.keep_s):
                self._asked.pop(name, None)
            trouble = self.history.trouble
        if trouble and trouble != self._told:
            self._tell("disk_full", trouble)
        self._told = trouble

    def _lacking(self, now: float) -> list[str]:
        """Sensors of which no fit or no HELLO came yet, some of them."""
        found: list[str] = []
        with self.lock:
            for name, sensor in self.roll.sensors.items():
                if sensor.axes and sensor.hello is not None:
                    continue
                times, due = self._asked.get(name, (0, 0.0))
                if times < ASK_TIMES and now >= due:
                    self._asked[name] = times + 1, now + ASK_EVERY_S
                    found.append(name)
                    if len(found) == ASK_AT_ONCE:
                        break
        return found

    @property
    def is_complete(self) -> bool:
        """Whether all that the broker retains has been asked for."""
        with self.lock:
            return all(
                name in self._asked
                for name, sensor in self.roll.sensors.items()
                if not sensor.axes or sensor.hello is None
            )

    def look_now(self) -> None:
        """Compare all sensors, and publish what has begun or ended."""
        with self.lock:
            begin = time.perf_counter()
            now, unix_s = self.clock.steady(), self.clock.unix_s()
            self.seen = look(self.roll, now, self.plan.silent_s)
            told = self.alerts.update(self.roll, self.seen, now, unix_s)
            for alert in told:
                self.history.add_alert(unix_s, alert.state, alert.kind, alert.device_id, alert.text)
            self.look_s = time.perf_counter() - begin
        encode = msgspec.json.encode
        for alert in told:
            self.listener.publish("fleet/alert", encode(alert), retain=False)
        if told:
            self.listener.publish("fleet/alerts", encode(self.raised()), retain=True)

    def raised(self) -> list[dict[str, str]]:
        """The alerts that are on."""
        with self.lock:
            return [
                {"kind": kind, "device_id": device_id, "axis": axis, "quantity": quantity, "text": text}
                for (kind, device_id, axis, quantity), text in self.alerts.raised()
            ]

    def summary(self) -> dict[str, Any]:
        """The fleet in numbers, with its odd sensors and alerts."""
        raised = self.raised()
        with self.lock:
            found = counts(self.roll, self.clock.steady(), self.plan.silent_s)
            found |= {
                "class": "fleet",
                "unix_s": self.clock.unix_s(),
                "connected": self.listener.is_up.is_set(),
                "outages": self.listener.outages,
                "odd": [msgspec.to_builtins(one) for one in self.seen.odd[:200]],
                "odd_count": len(self.seen.odd),
                "alerts": raised[:200],
                "alert_count": len(raised),
                "history": {
                    "lost": self.history.lost,
                    "pruned": self.pruned,
                    "trouble": self.history.trouble,
                    "clock_jumps": self.clock.jumps,
                },
                "look_ms": round(self.look_s * 1e3, 1),
            }
        return found

    def close(self) -> None:
        """Disconnect, and write what waits."""
        self.listener.close()
        with self.lock:
            self.history.close()

    def _tell(self, kind: str, text: str) -> None:
        self._say(f"{kind}: {text}")
