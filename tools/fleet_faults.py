"""Every fault of a fleet, one after the other, on a real broker: what was told, and where each fit went.

    python -m tools.fleet_faults             a table in Markdown
    python -m tools.fleet_faults disk        only those whose names hold a word

Needs mosquitto. Exit code 1: something does not add up.
"""

import argparse
import contextlib
import json
import os
import shutil
import signal
import socket
import sqlite3
import struct
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from tools.fault_script.small_disk import SmallDisk
from tools.fleet_load import Publisher, Sensor, sensor

SENSORS, AXES = 40, 3
PATIENCE_S = 30.0
DAY_NS = 86_400 * 10**9


class Outcome(NamedTuple):
    """What a fault led to. fits: that the broker acknowledged. wrong: what does not add up.

    of, due, where: what is counted, how many there were, and what became of how many.
    """

    name: str
    told: list[str]
    fits: int
    taken: int
    account: str
    wrong: list[str]
    of: str
    due: int
    where: dict[str, int]


class Stage:
    """A broker, a fleet and its sensors. before: what starts the fleet's program."""

    def __init__(self, folder: Path, *flags: str | Path, disk: SmallDisk | None = None) -> None:
        self._folder, self._flags, self._disk = folder, flags, disk
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            self.port = int(probe.getsockname()[1])
        user = "user root\n" if os.geteuid() == 0 else ""
        (folder / "conf").write_text(
            f"listener {self.port} 127.0.0.1\nallow_anonymous true\npersistence true\n"
            f"persistence_location {folder}/\nautosave_interval 1\n{user}"
        )
        self.clock = folder / "clock"
        self.clock.write_bytes(bytes(8))
        self.start_broker()
        self.publisher = Publisher("127.0.0.1", self.port, "fltea")
        self.sensors = [sensor(place, []) for place in range(SENSORS)]
        self.turn = self.fits = 0
        for one in self.sensors:
            self.publisher.send(one.device_id, "hello", one.hello)
            self.publisher.send(one.device_id, "status", one.status)
        self.start_fleet()

    def start_broker(self) -> None:
        """Start it, or start it again."""
        program = shutil.which("mosquitto", path=f"{os.environ['PATH']}:/usr/sbin")
        if program is None:
            raise SystemExit("no mosquitto: sudo apt-get install mosquitto")
        command = [program, "-c", str(self._folder / "conf")]
        self.broker = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        self.until(lambda: _listens(self.port), "the broker")

    def start_fleet(self) -> None:
        """Start it, or start it again."""
        self._log = self._folder / "fleet.log"
        before = () if self._disk is None else self._disk.before
        command = [*before, sys.executable, "-m", "tools.fault_script.shim", "fleet"]
        command += ["--mqtt", f"127.0.0.1:{self.port}", "--listen", "0", "--look-every", "200ms"]
        environment = {**os.environ, "FLTEA_SHIM_CLOCK": str(self.clock)}
        with self._log.open("ab") as log:
            log.write(b"---\n")
            self.fleet = subprocess.Popen([*command, *map(str, self._flags)], stderr=log, env=environment)
        self.until(lambda: "the fleet is at" in self.said(), "the fleet")
        self.url = self.said().rpartition("the fleet is at ")[2].split()[0]
        self.until(lambda: self.summary()["connected"], "the connection")

    def said(self) -> str:
        """What the fleet's program has said since it was started."""
        return self._log.read_text().rpartition("---\n")[2]

    def summary(self) -> dict[str, Any]:
        """The fleet in numbers."""
        with urllib.request.urlopen(f"{self.url}api/summary", timeout=PATIENCE_S) as answer:
            found: dict[str, Any] = json.load(answer)
        return found

    def publish(self, rounds: int, sensors: list[Sensor] | None = None) -> None:
        """Let each sensor say so many fits; comes back when the broker has them all."""
        for _ in range(rounds):
            self.turn += 1
            for one in self.sensors if sensors is None else sensors:
                self.publisher.send(one.device_id, "fit", str(self.turn).encode().join(one.fit))
                self.fits += 1
        self.until(lambda: self.publisher.acknowledged >= self.publisher.published, "acknowledgements")

    def newest(self) -> int:
        """Axes of which the newest fit is there."""
        with urllib.request.urlopen(f"{self.url}api/table?count=500", timeout=PATIENCE_S) as answer:
            return sum(row["samples"] == self.turn for row in json.load(answer)["rows"])

    def kept(self) -> int:
        """Rows of history, as the page shows them."""
        rows = 0
        for one in self.sensors:
            url = f"{self.url}api/sensor?device={one.device_id}"
            with urllib.request.urlopen(url, timeout=PATIENCE_S) as answer:
                rows += len(json.load(answer)["history"])
        return rows

    def is_up_to_date(self) -> bool:
        """Whether the newest fit of every axis is there."""
        return self.newest() == SENSORS * AXES

    def kinds(self) -> list[str]:
        """What was told, in order."""
        lines = [line.partition(": ")[0] for line in self.said().splitlines() if ": " in line]
        return [kind for kind in lines if kind.isidentifier()]

    def until(self, condition: Callable[[], bool], what: str) -> None:
        """Wait, but not for ever."""
        end = time.monotonic() + PATIENCE_S
        while not condition():
            if time.monotonic() > end:
                raise SystemExit(f"{what} did not come within {PATIENCE_S:g} s: {self.said()}")
            time.sleep(0.05)

    def close(self) -> None:
        """End all."""
        self.publisher.close()
        for process in (self.fleet, self.broker):
            process.kill()
            process.wait()

    def outcome(
        self,
        name: str,
        account: str,
        *wrong: tuple[bool, str],
        of: str = "fits",
        due: int | None = None,
        where: dict[str, int] | None = None,
    ) -> Outcome:
        """What came of it; wrong: what must not be, and its name. where: of all `due`; else of the fits."""
        taken = self.summary()["fits"]
        texts = [text for bad, text in wrong if bad]
        due = self.fits if due is None else due
        return Outcome(
            name, self.kinds(), self.fits, taken, account, texts, of, due, where or {"taken": taken}
        )


def _listens(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


def broker_killed(folder: Path) -> Outcome:
    """`kill -9`, and started again."""
    with contextlib.closing(Stage(folder)) as stage:
        stage.publish(2)
        stage.until(stage.is_up_to_date, "the fits")
        time.sleep(1.5)  # it saves once a second
        stage.broker.kill()
        stage.broker.wait()
        stage.until(lambda: not stage.summary()["connected"], "the loss")
        stage.start_broker()
        stage.until(lambda: stage.summary()["connected"], "the connection")
        stage.publish(2)
        stage.until(stage.is_up_to_date, "the fits")
        missed = stage.fits - stage.summary()["fits"]
        return stage.outcome(
            "broker killed (`kill -9`) and started again",
            f"{stage.newest()} of {SENSORS * AXES} axes have their newest fit",
            (missed > 0, f"{missed} fits missed"),
            (stage.summary()["outages"] != 1, "outages"),
        )


def split(folder: Path) -> Outcome:
    """Nothing gets through for a while."""
    with contextlib.closing(Stage(folder)) as stage:
        stage.publish(1)
        stage.broker.send_signal(signal.SIGSTOP)
        for one in stage.sensors:
            stage.publisher.send(one.device_id, "fit", b"2".join(one.fit))
        time.sleep(2.0)
        stage.broker.send_signal(signal.SIGCONT)
        stage.turn, stage.fits = 2, 2 * SENSORS
        stage.until(stage.is_up_to_date, "the fits")
        found = stage.summary()["fits"]
        return stage.outcome(
            "network split for 2 s",
            "all that was held up came later",
            (found != stage.fits, f"{found} of {stage.fits} fits"),
        )


def disk_full(folder: Path) -> Outcome:
    """The history's disk, and room again."""
    with contextlib.closing(SmallDisk(folder / "disk")) as disk:
        history = disk.folder / "fleet.db"
        stage = Stage(folder, "--history", history, "--history-every", "1ms", disk=disk)
        with contextlib.closing(stage):
            disk.attach(stage.fleet.pid)
            stage.publish(1)
            stage.until(stage.is_up_to_date, "the fits")
            disk.fill()
            stage.publish(1)
            stage.until(lambda: stage.summary()["history"]["lost"] > 0, "a loss")
            stage.until(stage.is_up_to_date, "the fits")
            disk.free()
            stage.publish(1)
            stage.until(stage.is_up_to_date, "the fits")
            stage.until(lambda: not stage.summary()["history"]["trouble"], "room")
            due = stage.fits * AXES
            stage.until(lambda: stage.kept() + stage.summary()["history"]["lost"] >= due, "rows")
            rows, lost = stage.kept(), stage.summary()["history"]["lost"]
            return stage.outcome(
                "history's disk full, later room again",
                f"{due} rows due = {rows} kept + {lost} counted as lost",
                (rows + lost != due, f"{due} rows, {rows} kept, {lost} lost"),
                of="rows of history",
                due=due,
                where={"kept": rows, "counted as lost": lost},
            )


def _rows(path: Path) -> int:
    with contextlib.closing(sqlite3.connect(path, timeout=5)) as database:
        return int(database.execute("SELECT count(*) FROM fit").fetchone()[0])


def fleet_killed(folder: Path) -> Outcome:
    """`kill -9` while it writes its history, and started again."""
    history = folder / "fleet.db"
    with contextlib.closing(Stage(folder, "--history", history, "--history-every", "1ms")) as stage:
        stage.publish(3)
        stage.until(stage.is_up_to_date, "the fits")
        stage.until(lambda: _rows(history) > 0, "rows")
        before = stage.summary()["fits"]
        stage.fleet.kill()
        stage.fleet.wait()
        stage.publish(2)
        rows = _rows(history)
        stage.start_fleet()
        stage.until(stage.is_up_to_date, "the fits")
        return stage.outcome(
            "the fleet's program killed (`kill -9`) and started again",
            f"the newest fit of all {SENSORS * AXES} axes from the broker; {rows} rows in whole fits",
            (rows % AXES != 0, f"{rows} rows are no whole fits"),
            where={
                "taken before": before,
                "replaced by a newer one meanwhile": SENSORS,
                "taken afterwards": stage.summary()["fits"],
            },
        )


def clock_jumps(folder: Path) -> Outcome:
    """The wall clock two days forward, and back."""
    history = folder / "fleet.db"
    with contextlib.closing(
        Stage(folder, "--history", history, "--history-every", "1ms", "--keep", "1h")
    ) as stage:
        stage.publish(1)
        stage.until(lambda: _rows(history) == SENSORS * AXES, "rows")
        for step in (2 * DAY_NS, 0):
            stage.clock.write_bytes(struct.pack("<q", step))
            stage.publish(1)
            stage.until(stage.is_up_to_date, "the fits")
        stage.until(lambda: _rows(history) == 3 * SENSORS * AXES, "rows")
        found = stage.summary()["history"]
        return stage.outcome(
            "clock set two days forward, and back",
            f"{found['clock_jumps']} jumps counted, no row pruned, nobody silent",
            (found["clock_jumps"] != 2, f"{found['clock_jumps']} jumps"),
            (found["pruned"] != 0, f"{found['pruned']} rows pruned"),
            (stage.summary()["states"] != {"online": SENSORS}, "states"),
        )


def twins(folder: Path) -> Outcome:
    """Two programs publish under one name."""
    with contextlib.closing(Stage(folder)) as stage:
        one = stage.sensors[7]
        for turn in range(5):
            for seq in (100 + turn, 90_000 + turn):
                stage.publisher.send(one.device_id, "fit", str(seq).encode().join(one.fit))
                stage.fits += 1
        stage.until(lambda: stage.summary()["fits"] == stage.fits, "the fits")
        stage.until(lambda: stage.summary()["alert_count"] == 1, "the alert")
        (alert,) = stage.summary()["alerts"]
        return stage.outcome(
            "two devices with one id",
            f"alert `{alert['kind']}` of that one alone",
            ((alert["kind"], alert["device_id"]) != ("twins", one.device_id), str(alert)),
        )


def flood(folder: Path) -> Outcome:
    """10,000 messages, each of another device."""
    most = 500
    with contextlib.closing(Stage(folder, "--max-sensors", str(most))) as stage:
        for number in range(10_000):
            stage.publisher.send(f"made-up-{number}", "status", stage.sensors[0].status, retain=False)
        stage.until(lambda: stage.publisher.acknowledged == stage.publisher.published, "acknowledgements")
        stage.until(lambda: stage.summary()["refused"] > 0, "the flood")
        before = -1
        while before != (before := stage.summary()["messages"]):
            time.sleep(0.5)
        found = stage.summary()
        kept = found["sensors"] - SENSORS
        dropped = 10_000 - kept - found["refused"]
        return stage.outcome(
            "10,000 messages, a new device each",
            f"{kept} kept, {found['refused']} refused, {dropped} dropped by the broker; some are named",
            (found["sensors"] != most, f"{found['sensors']} sensors"),
            (kept + found["refused"] > 10_000, "counts"),
            (not found["refused_names"], "names"),
            of="status",
            due=10_000,
            where={"kept": kept, "refused": found["refused"], "dropped by the broker": dropped},
        )


CASES = (broker_killed, split, disk_full, fleet_killed, clock_jumps, twins, flood)


def play(case: Callable[[Path], Outcome]) -> Outcome:
    """One fault, in a folder of its own."""
    with tempfile.TemporaryDirectory(prefix="fleet-fault-") as folder:
        return case(Path(folder))


def line(one: Outcome) -> str:
    """A row of the table."""
    told = ", ".join(one.told) or "–"
    wrong = f" **{'; '.join(one.wrong)}**" if one.wrong else ""
    return f"| {one.name} | {told} | {one.fits} | {one.taken} | {one.account}{wrong} |"


def main() -> int:
    """Play them; 1 if something does not add up."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("words", nargs="*")
    words = parser.parse_args().words
    print("| fault | told | fits published | taken | account |\n|---|---|---|---|---|")
    wrong = 0
    for case in CASES:
        if words and not any(word in case.__name__ for word in words):
            continue
        outcome = play(case)
        wrong += len(outcome.wrong)
        print(line(outcome), flush=True)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
