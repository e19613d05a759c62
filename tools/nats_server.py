"""A nats-server of our own on the loopback, as benchmarks and faults need it."""

import asyncio
import json
import shutil
import socket
import subprocess
from collections import Counter
from pathlib import Path

import nats
from nats.js.errors import NotFoundError

from tools.fault_script.program import PATIENCE_S, wait_until
from tools.fault_script.stage import Skip

BUCKET, STREAM = "fltea_lanes", "FLTEA_FRAMES"


def free_port() -> int:
    """A port of this machine that nobody has."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


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
        mapping = f"fltea.frames.{{{{partition({partitions},1)}}}}.{{{{wildcard(1)}}}}"
        settings.write_text(
            f"listen: 127.0.0.1:{self.port}\nserver_name: one\nmax_payload: 2MB\n"
            f'jetstream {{ store_dir: "{folder}/js", max_file_store: 8GB }}\n'
            f"mqtt {{ listen: 127.0.0.1:{self.mqtt_port} }}\n"
            f'mappings {{ "fltea.*.frames": "{mapping}" }}\n'
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
        for port in (self.port, self.mqtt_port):
            with socket.socket() as probe:
                if probe.connect_ex(("127.0.0.1", port)) != 0:
                    return False
        return True

    def has_stream(self) -> bool:
        """Whether a worker has made it; what is published before goes nowhere."""
        return asyncio.run(self._has_stream())

    async def _has_stream(self) -> bool:
        client = await nats.connect(self.url, allow_reconnect=False)
        try:
            return bool(await client.jetstream().stream_info(STREAM))
        except NotFoundError:
            return False
        finally:
            await client.close()

    def is_shared_by(self, workers: int) -> bool:
        """Whether so many workers have all partitions, each as many."""
        return sorted(asyncio.run(self._shares()).values()) == [self._partitions // workers] * workers

    async def _shares(self) -> Counter[str]:
        client = await nats.connect(self.url, allow_reconnect=False)
        try:
            bucket = await client.jetstream().key_value(BUCKET)
            entries = [await bucket.get(f"lease.{number}") for number in range(self._partitions)]
            return Counter(json.loads(entry.value or b"{}").get("owner", "") for entry in entries)
        except NotFoundError:
            return Counter()
        finally:
            await client.close()

    def kill(self) -> None:
        """By `kill -9`."""
        self.process.kill()
        self.process.wait(PATIENCE_S)
