"""A real MQTT broker that can go and come back; what it received it says in its own log."""

import os
import re
import shutil
import signal
import socket
import subprocess
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from tools.faults.program import PATIENCE_S, Skip, wait_until

RECEIVED = re.compile(r"Received PUBLISH from fltea-\S+ \(.*'fltea/[^/]+/(\w+)'")


def free_port() -> int:
    """A port of this machine that nobody has."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def listens(port: int) -> bool:
    """Whether anybody listens at a port of this machine."""
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


class Broker:
    """mosquitto on a port of its own.

    persistent: it saves once a second what it retains. logs: all that it does, which `received` needs.
    settings: more lines of its configuration.

    Raises:
        Skip: it is not installed.
    """

    def __init__(
        self, folder: Path, *, persistent: bool = False, logs: bool = True, settings: Sequence[str] = ()
    ) -> None:
        found = shutil.which("mosquitto", path=f"{os.environ['PATH']}:/usr/sbin")
        if found is None:
            raise Skip("mosquitto is not installed: sudo apt-get install mosquitto")
        self.port = free_port()
        self.url = f"mqtt://127.0.0.1:{self.port}"
        self._log = folder / "mosquitto.log"
        lines = ["allow_anonymous true", f"listener {self.port} 127.0.0.1", *settings]
        if persistent:
            lines += ["persistence true", f"persistence_location {folder}/", "autosave_interval 1"]
            lines += ["user root"] if os.geteuid() == 0 else []
        lines.append(f"log_type {'all' if logs else 'none'}")
        (folder / "mosquitto.conf").write_text("\n".join(lines) + "\n")
        self._command = [found, "-c", str(folder / "mosquitto.conf")]
        self.start()

    def start(self) -> None:
        """Listen (again)."""
        with self._log.open("ab") as log:
            self.process = subprocess.Popen(self._command, stdout=log, stderr=log)
        wait_until(lambda: listens(self.port), "the broker")

    def kill(self) -> None:
        """End at once, without a farewell."""
        self.process.kill()
        self.process.wait(PATIENCE_S)

    def pause(self) -> None:
        """Stand still until `go_on`, and all lines to it with it."""
        self.process.send_signal(signal.SIGSTOP)

    def go_on(self) -> None:
        """Go on after `pause`."""
        self.process.send_signal(signal.SIGCONT)

    def has_subscriber(self) -> bool:
        """Whether anybody has subscribed since it was first started."""
        return "Sending SUBACK to" in self._log.read_text(errors="replace")

    def received(self) -> Counter[str]:
        """Messages so far, by the last part of their topic."""
        return Counter(RECEIVED.findall(self._log.read_text(errors="replace")))
