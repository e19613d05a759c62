"""Starts a nats-server on the loopback interface, for benchmarks and faults."""

import asyncio
import json
from collections import Counter
from collections.abc import Callable, Coroutine, Sequence
from pathlib import Path
from typing import Any, TypeVar

import nats
from fltea.service.ingest import mapping
from nats.js import JetStreamContext
from nats.js.errors import NotFoundError, ServiceUnavailableError

from tools.faults.program import PATIENCE_S
from tools.faults.server import Server, free_port, installed

BUCKET, STREAM = "fltea_lanes", "FLTEA_FRAMES"
BALLAST = "BALLAST"
BALLAST_BYTES = 500_000
T = TypeVar("T")


class NatsServer(Server):
    """A NATS server with JetStream, MQTT, and the mapping of boards to partitions (groups of boards).

    It can be killed and restarted.

    `store`: largest size of the server's files, in the syntax of its settings. `before`: a command that
    starts the server.

    Raises:
        Skip: nats-server is not installed.
    """

    def __init__(
        self, folder: Path, partitions: int, *, store: str = "8GB", before: Sequence[str] = ()
    ) -> None:
        port, self.mqtt_port = free_port(), free_port()
        settings = folder / "nats.conf"
        settings.write_text(
            f"listen: 127.0.0.1:{port}\nserver_name: one\nmax_payload: 2MB\n"
            f'jetstream {{ store_dir: "{folder}/js", max_file_store: {store} }}\n'
            f"mqtt {{ listen: 127.0.0.1:{self.mqtt_port} }}\n"
            f"{mapping.line(partitions)}\n"
        )
        self._partitions = partitions
        self.url = f"nats://127.0.0.1:{port}"
        command = [*before, installed("nats-server"), "-c", str(settings)]
        super().__init__(command, [port, self.mqtt_port], folder / "nats.log")

    def _ask(self, question: Callable[[JetStreamContext], Coroutine[Any, Any, T]]) -> T:
        """Ask the server over a new connection.

        The timeout is long, because the answer comes late when the disk is busy.
        """

        async def asked() -> T:
            client = await nats.connect(self.url, allow_reconnect=False, connect_timeout=PATIENCE_S)
            try:
                return await question(client.jetstream(timeout=PATIENCE_S))
            finally:
                await client.close()

        return asyncio.run(asked())

    def is_heard(self) -> bool:
        """Return whether a worker has created the stream. Messages that are published earlier are lost."""
        try:
            return bool(self._ask(lambda stream: stream.stream_info(STREAM)))
        except NotFoundError:
            return False

    def is_shared_by(self, workers: int) -> bool:
        """Return whether the partitions (groups of boards) are shared evenly by this number of workers."""
        try:
            shares = self._ask(self._shares)
        except NotFoundError:
            return False
        return sorted(shares.values()) == [self._partitions // workers] * workers

    async def _shares(self, stream: JetStreamContext) -> Counter[str]:
        bucket = await stream.key_value(BUCKET)
        entries = [await bucket.get(f"lease.{number}") for number in range(self._partitions)]
        return Counter(json.loads(entry.value or b"{}").get("owner", "") for entry in entries)

    def fill_store(self) -> None:
        """Fill the server's store with a stream that is not the workers', up to the server's limit."""

        async def fill(stream: JetStreamContext) -> None:
            await stream.add_stream(name=BALLAST, subjects=["ballast"])
            size = BALLAST_BYTES
            while size:
                try:
                    await stream.publish("ballast", bytes(size))
                except ServiceUnavailableError:
                    size //= 8

        self._ask(fill)

    def empty_store(self) -> None:
        """Delete the stream that `fill_store` made."""
        self._ask(lambda stream: stream.delete_stream(BALLAST))
