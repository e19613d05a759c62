"""Readers of the live page: one that goes away in the middle, and one that stays and does not read."""

import base64
import contextlib
import os
import re
import shutil
import signal
import socket
import subprocess
from pathlib import Path
from urllib.request import urlopen

from tools.faults.program import PATIENCE_S, Skip

QUIET_S = 0.15
"""Half the time between two updates of a page."""


class Browser:
    """Chromium on the page.

    Raises:
        Skip: it is not installed.
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
        """End it and all its children at once."""
        if self._process.poll() is None:
            os.killpg(self._process.pid, signal.SIGKILL)
            self._process.wait(PATIENCE_S)


def open_page_and_read_nothing(url: str) -> socket.socket:
    """Do as a browser does until the page begins to come, and then stop."""
    page = urlopen(url, timeout=PATIENCE_S).read().decode()
    token = re.search(r'"token":"([^"]+)"', page)
    assert token is not None, "the page has no session"
    host, port = url.removeprefix("http://").rstrip("/").split(":")
    client = socket.socket()
    client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    client.connect((host, int(port)))
    request = (
        "GET /ws HTTP/1.1",
        f"Host: {host}:{port}",
        f"Origin: http://{host}:{port}",
        "Upgrade: websocket",
        "Connection: Upgrade",
        f"Sec-WebSocket-Key: {base64.b64encode(os.urandom(16)).decode()}",
        "Sec-WebSocket-Version: 13",
        f"Sec-WebSocket-Protocol: bokeh, {token[1]}",
        "",
        "",
    )
    client.sendall("\r\n".join(request).encode())
    assert b" 101 " in client.recv(256).split(b"\r\n")[0], "the page took no connection"
    return client


def bytes_sent(page: socket.socket) -> int:
    """Read what has been sent to a page all the while; how much it is."""
    found = 0
    page.settimeout(QUIET_S)
    with contextlib.suppress(TimeoutError):
        while data := page.recv(1 << 16):
            found += len(data)
    return found


def connections(pid: int, port: int) -> int:
    """Established connections of a process to its port."""
    rows = [line.split() for line in Path(f"/proc/{pid}/net/tcp").read_text().splitlines()[1:]]
    return sum(row[1].endswith(f":{port:04X}") and row[3] == "01" for row in rows)
