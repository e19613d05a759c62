"""A broker, the fleet's program, and sensors that publish their fits."""

import contextlib
import json
import sqlite3
import urllib.request
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tools.faults.outcome import Outcome
from tools.faults.program import PATIENCE_S, wait_until
from tools.faults.small_disk import SmallDisk
from tools.faults.stage import Stage
from tools.fleet_load import Publisher, sensor

SENSORS, AXES = 40, 3
HISTORY = "fleet.db"
EVERY_S = 0.05
"""Time between two requests to the fleet's page."""


class FleetScene:
    """A broker, a fleet and its sensors.

    `flags`: options of `fltea fleet`. `history`: folder of the fleet's history, if it keeps one. `disk`: the
    small disk on which this folder is, if any. `behind_line`: whether the fleet is connected to the broker by
    `line`, a connection that can be cut.

    Raises:
        Skip: mosquitto is not installed.
    """

    def __init__(
        self,
        stage: Stage,
        *flags: str | Path,
        history: Path | None = None,
        disk: SmallDisk | None = None,
        behind_line: bool = False,
    ) -> None:
        self._stage, self._disk = stage, disk
        self.broker = stage.broker(persistent=True, logs=False)
        self.line = stage.line(self.broker.port)
        port = self.line.port if behind_line else self.broker.port
        if history is not None:
            flags = ("--history", history / HISTORY, "--history-every", "1ms", *flags)
        self._folder = history
        self._flags = ("--mqtt", f"127.0.0.1:{port}", "--listen", "0", "--compare-every", "200ms", *flags)
        self.publisher = stage.closing(Publisher("127.0.0.1", self.broker.port, "fltea"))
        self.sensors = [sensor(place, []) for place in range(SENSORS)]
        self.turn = self.fits = 0
        for one in self.sensors:
            self.publisher.send(one.device_id, "hello", one.hello)
            self.publisher.send(one.device_id, "status", one.status)
        self.start_fleet()

    def start_fleet(self) -> None:
        """Start the fleet, or start it again."""
        before = () if self._disk is None else self._disk.before
        self.fleet = self._stage.program("fleet", *self._flags, clock=self._stage.clock, before=before)
        self.until(lambda: "the fleet is at" in self.fleet.stderr, "the fleet")
        self.url = self.fleet.stderr.rpartition("the fleet is at ")[2].split()[0]
        self.until(self.is_connected, "the connection")

    def summary(self) -> dict[str, Any]:
        """Return the summary that the fleet's page shows."""
        found: dict[str, Any] = self._ask("summary")
        return found

    def is_connected(self) -> bool:
        """Return whether the fleet says that it is connected to the broker."""
        return bool(self.summary()["connected"])

    def publish(self, rounds: int, *, arrive: bool = True) -> None:
        """Let each sensor publish `rounds` fits; return after the broker has acknowledged all of them.

        `arrive`: whether to wait also until the fleet has the newest fit of every axis.
        """
        for _ in range(rounds):
            self.send()
        self.until_acknowledged()
        if arrive:
            self.until_up_to_date()

    def send(self) -> None:
        """Let each sensor publish a fit, without waiting."""
        self.turn += 1
        for one in self.sensors:
            self.publisher.send(one.device_id, "fit", str(self.turn).encode().join(one.fit))
            self.fits += 1

    def until_acknowledged(self) -> None:
        """Wait until the broker has acknowledged all messages."""
        wait_until(lambda: self.publisher.acknowledged >= self.publisher.published, "acknowledgements")

    def newest(self) -> int:
        """Return the number of axes whose newest fit the fleet has received."""
        return sum(row["samples"] == self.turn for row in self._ask("table?count=500")["rows"])

    def rows(self) -> int:
        """Return the number of rows in the fleet's history.

        Return 0 if the file of the history does not exist yet.
        """
        assert self._folder is not None
        with contextlib.closing(sqlite3.connect(self._folder / HISTORY, timeout=5)) as database:
            return int(database.execute("SELECT count(*) FROM fit").fetchone()[0])

    def shown(self) -> int:
        """Return the number of rows of history that the page shows.

        This works even if this process cannot read the file of the history.
        """
        return sum(len(self._ask(f"sensor?device={one.device_id}")["history"]) for one in self.sensors)

    def until_up_to_date(self) -> None:
        """Wait until the fleet has the newest fit of every axis."""
        self.until(lambda: self.newest() == SENSORS * AXES, "the newest fits")

    def kinds(self) -> list[str]:
        """Return the kinds of errors that the fleet's program has reported since its start, in order."""
        lines = [line.partition(": ")[0] for line in self.fleet.stderr.splitlines() if ": " in line]
        return [kind for kind in lines if kind.isidentifier()]

    def until(self, condition: Callable[[], bool], what: str) -> None:
        """Wait for a condition, but only as long as the fleet runs; see `Program.wait_for`."""
        self.fleet.wait_for(condition, what, every_s=EVERY_S)

    def outcome(
        self,
        more: str,
        *wrong: tuple[bool, str],
        of: str = "fits",
        due: int | None = None,
        where: dict[str, int] | None = None,
    ) -> Outcome:
        """Return the outcome.

        `wrong`: pairs of a condition that must not be true, and the text to report if it is. `due`: number of
        records that were published, by default the number of fits. `where`: for each thing that can become of
        a record, the number of such records; by default only `taken`, the fits that the fleet received.
        """
        return Outcome(
            self.kinds(),
            self.fits if due is None else due,
            where or {"taken": self.summary()["fits"]},
            of,
            more,
            wrong=[text for bad, text in wrong if bad],
        )

    def _ask(self, what: str) -> Any:
        with urllib.request.urlopen(f"{self.url}api/{what}", timeout=PATIENCE_S) as answer:
            return json.load(answer)
