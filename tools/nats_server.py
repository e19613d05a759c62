"""A nats-server of our own on the loopback, as benchmarks and faults need it."""

import asyncio
import contextlib
import json
import shutil
import subprocess
from collections import Counter
from collections.abc import AsyncIterator
from pathlib import Path

import nats
from fltea.service.ingest import mapping
from nats.js import JetStreamContext
from nats.js.errors import NotFoundError

from tools.fault_script.ports import free_port, listens
from tools.fault_script.program import PATIENCE_S, wait_until
from tools.fault_script.stage import Skip

BUCKET, STREAM = "fltea_lanes", "FLTEA_FRAMES"


class Server:
    """With JetStream, the mapping that makes partitions, and MQTT.

    Raises:
        Skip: it is not installed.
    """

    def __init__(self, folder: Path, partitions: int) -> None:
        program = shutil.which("nats-server", path="/usr/sbin:/usr/bin:/usr/local/bin")
        if program is None:
            raise Skip("nats-server is not installed: sudo apt-get install nats-server")
        self.port, self.mqtt_port = free_port(), free_port()
        settings = folder / "nats.conf"
        settings.write_text(
            f"listen: 127.0.0.1:{self.port}\nserver_name: one\nmax_payload: 2MB\n"
            f'jetstream {{ store_dir: "{folder}/js", max_file_store: 8GB }}\n'
            f"mqtt {{ listen: 127.0.0.1:{self.mqtt_port} }}\n"
            f"{mapping.line(partitions)}\n"
        )
        self._command = [program, "-c", str(settings)]
        self._partitions = partitions
        self.url = f"nats://127.0.0.1:{self.port}"
        self.start()

    def start(self) -> None:
        """Start it, or start it again."""
        self.process = subprocess.Popen(self._command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        wait_until(self._listens, "nats-server")

    def _listens(self) -> bool:
        return listens(self.port) and listens(self.mqtt_port)

    @contextlib.asynccontextmanager
    async def jetstream(self) -> AsyncIterator[JetStreamContext]:
        """A connection of our own."""
        client = await nats.connect(self.url, allow_reconnect=False)
        try:
            yield client.jetstream()
        finally:
            await client.close()

    def has_stream(self) -> bool:
        """Whether a worker has made it; what is published before goes nowhere."""
        return asyncio.run(self._has_stream())

    async def _has_stream(self) -> bool:
        async with self.jetstream() as stream:
            try:
                return bool(await stream.stream_info(STREAM))
            except NotFoundError:
                return False

    def is_shared_by(self, workers: int) -> bool:
        """Whether so many workers have all partitions, each as many."""
        return sorted(asyncio.run(self._shares()).values()) == [self._partitions // workers] * workers

    async def _shares(self) -> Counter[str]:
        async with self.jetstream() as stream:
            try:
                bucket = await stream.key_value(BUCKET)
                entries = [await bucket.get(f"lease.{number}") for number in range(self._partitions)]
            except NotFoundError:
                return Counter()
        return Counter(json.loads(entry.value or b"{}").get("owner", "") for entry in entries)

    def kill(self) -> None:
        """By `kill -9`."""
        self.process.kill()
        self.process.wait(PATIENCE_S)
