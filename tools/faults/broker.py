"""A real MQTT broker that can go and come back; what it received it says in its own log."""

import os
import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from tools.faults.server import Server, free_port, installed

RECEIVED = re.compile(r"Received PUBLISH from fltea-\S+ \(.*'fltea/[^/]+/(\w+)'")


class Broker(Server):
    """mosquitto on a port of its own.

    persistent: it saves once a second what it retains. logs: all that it does, which `received` needs.
    settings: more lines of its configuration.

    Raises:
        Skip: it is not installed.
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
        """Where boards publish."""
        return self.port

    def is_heard(self) -> bool:
        """Whether anybody has subscribed since it was first started."""
        return "Sending SUBACK to" in self.said()

    def received(self) -> Counter[str]:
        """Messages so far, by the last part of their topic."""
        return Counter(RECEIVED.findall(self.said()))
