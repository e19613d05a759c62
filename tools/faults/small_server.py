"""A nats-server whose store is a small disk, which others fill up."""

import asyncio
import re
import subprocess
from pathlib import Path

from nats.js.errors import ServiceUnavailableError

from tools.fault_script.program import wait_until
from tools.fault_script.small_disk import SmallDisk
from tools.fault_script.stage import Skip
from tools.nats_server import Server

DISK, STORE = "160m", "96MB"
"""The server's limit is less than the disk, and has room for what workers ask for."""

BALLAST = "BALLAST"
BALLAST_BYTES = 500_000


class SmallServer(Server):
    """It may be killed and started again; the disk stays.

    Raises:
        Skip: no disk can be made here.
    """

    def __init__(self, folder: Path, partitions: int) -> None:
        self.disk = SmallDisk(folder / "js", DISK)
        if not self.disk.is_mounted:
            raise Skip("no small disk can be made here (unshare, mount)")
        keep = ("sh", "-c", "echo; exec sleep infinity")
        self._keeper = subprocess.Popen([*self.disk.before, *keep], stdout=subprocess.PIPE)
        assert self._keeper.stdout is not None
        self._keeper.stdout.readline()  # it is mounted
        self.disk.attach(self._keeper.pid)
        try:
            super().__init__(folder, partitions)
        except BaseException:
            self._let_go()
            raise

    def start(self) -> None:
        """Start it, or start it again, where the disk is."""
        settings = Path(self._command[-1])
        settings.write_text(re.sub(r"max_file_store: \w+", f"max_file_store: {STORE}", settings.read_text()))
        there = ("nsenter", "-t", str(self._keeper.pid), "--user", "--mount", "--preserve-credentials")
        nothing = subprocess.DEVNULL
        self.process = subprocess.Popen([*there, *self._command], stdout=nothing, stderr=nothing)
        wait_until(self._listens, "nats-server")

    def close(self) -> None:
        """Kill it, and let the disk go."""
        self.kill()
        self._let_go()

    def _let_go(self) -> None:
        self._keeper.kill()
        self._keeper.communicate()
        self.disk.close()

    def fill_store(self) -> None:
        """With a stream of somebody else, up to the server's own limit."""
        asyncio.run(self._fill_store())

    async def _fill_store(self) -> None:
        async with self.jetstream() as stream:
            await stream.add_stream(name=BALLAST, subjects=["ballast"])
            size = BALLAST_BYTES
            while size:
                try:
                    await stream.publish("ballast", bytes(size))
                except ServiceUnavailableError:
                    size //= 8

    def empty_store(self) -> None:
        """Delete that stream."""
        asyncio.run(self._empty_store())

    async def _empty_store(self) -> None:
        async with self.jetstream() as stream:
            await stream.delete_stream(BALLAST)
