"""Clients of the live page: a browser that can be killed, and a client that never reads."""

import os
import shutil
import signal
import socket
import subprocess
from pathlib import Path

from tools.faults.program import PATIENCE_S, Skip


class Browser:
    """The browser Chromium, which shows the live page.

    Raises:
        Skip: Chromium is not installed.
    """

    def __init__(self, url: str, folder: Path) -> None:
        found = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
        if found is None:
            raise Skip("chromium is not installed: sudo apt-get install chromium")
        switches = ["--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"]
        self._process = subprocess.Popen(
            [found, *switches, f"--user-data-dir={folder}", "--remote-debugging-port=0", url],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )

    def kill(self) -> None:
        """Kill the browser and all its children."""
        if self._process.poll() is None:
            os.killpg(self._process.pid, signal.SIGKILL)
            self._process.wait(PATIENCE_S)


def open_page_and_read_nothing(url: str) -> socket.socket:
    """Request the page's largest file many times, without reading any answer."""
    host, port = url.removeprefix("http://").rstrip("/").split(":")
    client = socket.socket()
    client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    client.connect((host, int(port)))
    client.sendall(f"GET /page.js HTTP/1.1\r\nHost: {host}:{port}\r\n\r\n".encode() * 100)
    return client


def connections(pid: int, port: int) -> int:
    """Return how many established connections a process has on one of its TCP ports."""
    rows = [line.split() for line in Path(f"/proc/{pid}/net/tcp").read_text().splitlines()[1:]]
    return sum(row[1].endswith(f":{port:04X}") and row[3] == "01" for row in rows)
