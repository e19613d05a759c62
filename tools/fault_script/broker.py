"""A real MQTT broker that can go and come back; what it received it says in its own log."""

import os
import re
import shutil
import subprocess
from collections import Counter
from pathlib import Path

from tools.fault_script.ports import free_port, listens
from tools.fault_script.program import PATIENCE_S, wait_until
from tools.fault_script.stage import Skip

RECEIVED = re.compile(r"Received PUBLISH from fltea-\S+ \(.*'fltea/[^/]+/(\w+)'")


class Broker:
    """mosquitto on a port of its own.

    Raises:
        Skip: it is not installed.
    """

    def __init__(self, folder: Path) -> None:
        found = shutil.which("mosquitto", path=f"{os.environ['PATH']}:/usr/sbin")
        if found is None:
            raise Skip("mosquitto is not installed: sudo apt-get install mosquitto")
        self.port = free_port()
        self._log = folder / "mosquitto.log"
        settings = folder / "mosquitto.conf"
        settings.write_text(f"listener {self.port} 127.0.0.1\nallow_anonymous true\nlog_type all\n")
        self._command = [found, "-c", str(settings)]
        self.start()

    def start(self) -> None:
        """Listen (again)."""
        with self._log.open("ab") as log:
            self._process = subprocess.Popen(self._command, stdout=log, stderr=log)
        wait_until(lambda: listens(self.port), "the broker")

    def kill(self) -> None:
        """End at once, without a farewell."""
        self._process.kill()
        self._process.wait(PATIENCE_S)

    def has_subscriber(self) -> bool:
        """Whether anybody has subscribed since it was first started."""
        return "Sending SUBACK to" in self._log.read_text(errors="replace")

    def received(self) -> Counter[str]:
        """Messages so far, by the last part of their topic."""
        return Counter(RECEIVED.findall(self._log.read_text(errors="replace")))
