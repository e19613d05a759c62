"""Notify systemd of the state of a service of Type=notify, by a datagram to $NOTIFY_SOCKET (sd_notify(3))."""

import contextlib
import os
import socket
import time

PERIOD_S = 5.0


class ServiceManager:
    """If systemd runs the program, reports to systemd that the program is ready, works, and ends."""

    def __init__(self) -> None:
        name = os.environ.get("NOTIFY_SOCKET", "")
        self._address = "\0" + name[1:] if name.startswith("@") else name
        self._said_s = -PERIOD_S

    def ready(self) -> None:
        """Report that sources and outputs are set up."""
        self._say("READY=1")

    def alive(self) -> None:
        """Report that every device stream works. If the report is late, systemd restarts the service."""
        if time.monotonic() - self._said_s >= PERIOD_S:
            self._said_s = time.monotonic()
            self._say("WATCHDOG=1")

    def stopping(self) -> None:
        """Report that the program ends as requested."""
        self._say("STOPPING=1")

    def _say(self, state: str) -> None:
        if not self._address:
            return
        with contextlib.suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as out:
            out.sendto(state.encode(), self._address)
