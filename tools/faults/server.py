"""Starts and stops servers, such as an MQTT broker, on this machine."""

import os
import re
import shutil
import signal
import socket
import subprocess
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tools.faults.program import PATIENCE_S, Skip, wait_until

RECEIVED = re.compile(r"Received PUBLISH from fltea-\S+ \(.*'fltea/[^/]+/(\w+)'")


def free_port() -> int:
    """Return a TCP port of this machine that no program uses."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def listens(port: int) -> bool:
    """Return whether a program listens at a TCP port of this machine."""
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


def installed(name: str) -> str:
    """Return the path of a program.

    Raises:
        Skip: the program is not installed.
    """
    found = shutil.which(name, path=f"{os.environ['PATH']}:/usr/sbin")
    if found is None:
        raise Skip(f"{name} is not installed: sudo apt-get install {name}")
    return found


class Server:
    """A server process. After construction, it listens at all its TCP ports.

    `log`: file to which the server writes its log. `how`: further arguments for `subprocess.Popen`.
    """

    def __init__(self, command: Sequence[str | Path], ports: Sequence[int], log: Path, **how: Any) -> None:
        self._command, self._ports, self._log, self._how = command, ports, log, how
        self.port = ports[0]
        self.start()

    def start(self) -> None:
        """Start the server, and wait until it listens."""
        with self._log.open("ab") as log:
            self.process = subprocess.Popen(self._command, stdout=log, stderr=log, **self._how)

        def listening() -> bool:
            if self.process.poll() is not None:
                raise RuntimeError(f"{self._command[0]} ended: {self.said()}")
            return all(map(listens, self._ports))

        wait_until(listening, str(self._command[0]))

    def stop(self, number: signal.Signals = signal.SIGTERM) -> None:
        """Send a signal to the server, and wait for its end."""
        self.process.send_signal(number)
        self.process.wait(PATIENCE_S)

    def kill(self) -> None:
        """Kill the server with SIGKILL."""
        self.stop(signal.SIGKILL)

    def pause(self) -> None:
        """Suspend the process until `go_on` is called. Its connections stay open, but pass no data."""
        self.process.send_signal(signal.SIGSTOP)
        os.waitid(os.P_PID, self.process.pid, os.WSTOPPED | os.WNOWAIT)

    def go_on(self) -> None:
        """Let the process continue after `pause`."""
        self.process.send_signal(signal.SIGCONT)

    def said(self) -> str:
        """Return the server's log so far."""
        return self._log.read_text(errors="replace")


class Broker(Server):
    """The MQTT broker mosquitto on a TCP port of its own.

    `persistent`: whether the broker saves retained messages once a second. `logs`: whether the broker logs
    everything, so that `received` works. `settings`: more lines for its configuration.

    Raises:
        Skip: mosquitto is not installed.
    """

    def __init__(
        self, folder: Path, *, persistent: bool = False, logs: bool = True, settings: Sequence[str] = ()
    ) -> None:
        port, file = free_port(), folder / "mosquitto.conf"
        self.url = f"mqtt://127.0.0.1:{port}"
        lines = ["allow_anonymous true", f"listener {port} 127.0.0.1", *settings]
        if persistent:
            lines += ["persistence true", f"persistence_location {folder}/", "autosave_interval 1"]
            lines += ["user root"] if os.geteuid() == 0 else []
        file.write_text("\n".join([*lines, f"log_type {'all' if logs else 'none'}"]) + "\n")
        super().__init__([installed("mosquitto"), "-c", file], [port], folder / "mosquitto.log")

    @property
    def mqtt_port(self) -> int:
        """TCP port to which boards publish."""
        return self.port

    def is_heard(self) -> bool:
        """Return whether any program has subscribed since the broker's first start."""
        return "Sending SUBACK to" in self.said()

    def received(self) -> Counter[str]:
        """Return how many messages the broker has received, for each last part of a topic, such as `fit`."""
        return Counter(RECEIVED.findall(self.said()))
