"""Where faults of a fleet are played: a broker, the fleet's program, and sensors that publish their fits."""

import json
import os
import shutil
import subprocess
import sys
import time
import urllib.request
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from tools.fault_script.cut_line import CutLine
from tools.fault_script.ports import free_port, listens
from tools.fault_script.small_disk import SmallDisk
from tools.fault_script.stage import Skip
from tools.fleet_load import Publisher, sensor

SENSORS, AXES = 40, 3
PATIENCE_S = 30.0


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
    """A broker, a fleet and its sensors.

    disk: that the fleet's program has. behind_line: the fleet reaches the broker by `line`, which can be cut.

    Raises:
        Skip: mosquitto is not installed.
    """

    def __init__(
        self, folder: Path, *flags: str | Path, disk: SmallDisk | None = None, behind_line: bool = False
    ) -> None:
        self._folder, self._flags, self._disk = folder, flags, disk
        self.port = free_port()
        user = "user root\n" if os.geteuid() == 0 else ""
        (folder / "conf").write_text(
            f"listener {self.port} 127.0.0.1\nallow_anonymous true\npersistence true\n"
            f"persistence_location {folder}/\nautosave_interval 1\n{user}"
        )
        self.clock = folder / "clock"
        self.clock.write_bytes(bytes(8))
        self.start_broker()
        self.line = CutLine(self.port)
        self._fleet_port = self.line.port if behind_line else self.port
        self.publisher = Publisher("127.0.0.1", self.port, "fltea")
        self.sensors = [sensor(place, []) for place in range(SENSORS)]
        self.turn = self.fits = 0
        for one in self.sensors:
            self.publisher.send(one.device_id, "hello", one.hello)
            self.publisher.send(one.device_id, "status", one.status)
        try:
            self.start_fleet()
        except BaseException:
            self.close()
            raise

    def start_broker(self) -> None:
        """Start it, or start it again."""
        program = shutil.which("mosquitto", path=f"{os.environ['PATH']}:/usr/sbin")
        if program is None:
            raise Skip("mosquitto is not installed: sudo apt-get install mosquitto")
        command = [program, "-c", str(self._folder / "conf")]
        self.broker = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        self.until(lambda: listens(self.port), "the broker")

    def start_fleet(self) -> None:
        """Start it, or start it again."""
        self._log = self._folder / "fleet.log"
        before = () if self._disk is None else self._disk.before
        command = [*before, sys.executable, "-m", "tools.fault_script.shim", "fleet"]
        command += ["--mqtt", f"127.0.0.1:{self._fleet_port}", "--listen", "0", "--look-every", "200ms"]
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

    def publish(self, rounds: int) -> None:
        """Let each sensor say so many fits; comes back when the broker has them all."""
        for _ in range(rounds):
            self.send()
        self.until_acknowledged()

    def send(self) -> None:
        """Let each sensor say a fit, and wait for nothing."""
        self.turn += 1
        for one in self.sensors:
            self.publisher.send(one.device_id, "fit", str(self.turn).encode().join(one.fit))
            self.fits += 1

    def until_acknowledged(self) -> None:
        """Wait until the broker has all that was sent."""
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

    def until(self, condition: Callable[[], bool], what: str, patience_s: float = PATIENCE_S) -> None:
        """Wait, but not for ever.

        Raises:
            TimeoutError: it did not come.
        """
        end = time.monotonic() + patience_s
        while not condition():
            if time.monotonic() > end:
                raise TimeoutError(f"{what} did not come within {patience_s:g} s: {self.said()}")
            time.sleep(0.05)

    def close(self) -> None:
        """End all."""
        self.publisher.close()
        for process in (self.fleet, self.broker):
            process.kill()
            process.wait()
        self.line.close()

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
