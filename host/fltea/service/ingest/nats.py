"""Frames of many devices from NATS JetStream, shared among several workers (host/docs/guide/ingest.md).

The server puts each device into a partition, by a mapping of subjects: `fltea.NAME.frames` becomes
`fltea.frames.PARTITION.NAME`, kept in a stream. Of each partition one worker has the lease, pulls messages in
their order, and keeps snapshots of its devices in the store, with the number of the message that they follow.
Who takes over goes on from there.
"""

import asyncio
import concurrent.futures
import os
import secrets
import ssl
import threading
import time
from typing import NamedTuple

from nats.aio.client import Client
from nats.errors import Error as NatsError

from fltea.records.errors import UsageError
from fltea.records.ports import Report
from fltea.service.ingest import mapping
from fltea.service.ingest.inbox import Inbox
from fltea.service.ingest.leases import RENEW_S, STOP_S
from fltea.service.ingest.nats_reports import PASSWORD, USER, Reports
from fltea.service.ingest.partitions import Partitions
from fltea.service.ingest.store import Store
from fltea.settings.config import Config

LOOK_S = 0.5
AGAIN_S = 1.0
"""From one attempt to connect to the next."""

PROBE_S = 60.0
"""From one look at the server's mapping to the next: its settings may be loaded again at any time."""

PUTS = 64
"""Snapshots on their way to the store; further ones wait for their next turn."""


class _Login(NamedTuple):
    """What it takes to reach the server; servers: one, or several of a cluster."""

    servers: list[str]
    user: str | None
    password: str | None
    tls: ssl.SSLContext | None


class NatsFrames:
    """Serves its share of the partitions, in a thread of its own, until closed.

    url: one server, or several with commas between. worker: name of this process, unlike all others'.
    """

    def __init__(self, config: Config, inbox: Inbox, report: Report) -> None:
        self._settings, self._login = config.ingest, _login(config)
        self.url = self._login.servers[0]
        self.worker = f"{config.name}-{secrets.token_hex(4)}"
        self.connected = False
        self._reports = Reports(self.url, report)
        self._partitions = Partitions(self.worker, config.ingest.partitions, inbox, self._reports)
        self._store: Store
        self._loop: asyncio.AbstractEventLoop | None = None
        self._puts: set[concurrent.futures.Future[None]] = set()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="nats", daemon=True)

    def start(self) -> None:
        """Begin to serve."""
        self._thread.start()

    def close(self) -> None:
        """Give all partitions back."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join(2.0)

    @property
    def done(self) -> dict[int, int]:
        """The last message of each partition that was walked."""
        return self._partitions.done

    @property
    def unix_offset_ns(self) -> int:
        """From `host_ns` to the server's time."""
        return self._partitions.unix_offset_ns

    def serves(self, partition: int) -> bool:
        """Return whether this worker may still walk messages of a partition; asked for each one."""
        return self._partitions.serves(partition)

    def resume(self, partition: int) -> None:
        """Take note that from here on come the messages that were left out."""
        self._partitions.resume(partition)

    def walked(self, partition: int, mark: int) -> None:
        """Take note of the last message that was walked."""
        self._partitions.walked(partition, mark)

    def keep(self, partition: int, device: str, data: bytes) -> bool:
        """Store a snapshot, in the background; False if too many are on their way."""
        return self.serves(partition) and self._in_background(f"{partition}.{device}", data)

    def drop(self, partition: int, device: str) -> None:
        """Delete a snapshot, in the background. If that fails, who is next finds the device silent."""
        if self.serves(partition):
            self._in_background(f"{partition}.{device}", None)

    def _in_background(self, key: str, data: bytes | None) -> bool:
        self._puts = {one for one in self._puts if not one.done()}
        loop = self._loop
        if loop is None or len(self._puts) >= PUTS:
            return False
        put = self._put(key, data)
        try:
            self._puts.add(asyncio.run_coroutine_threadsafe(put, loop))
        except RuntimeError:  # the connection has just ended
            put.close()
            return False
        return True

    async def _put(self, key: str, data: bytes | None) -> None:
        snapshots = self._store.snapshots
        try:
            await (snapshots.delete(key) if data is None else snapshots.put(key, data))
        except NatsError as error:
            if data is not None:
                self._reports.snapshot(key, error)

    # --- the connection ---

    def _run(self) -> None:
        while not self._stop.is_set():
            try:
                asyncio.run(self._serve())
            except Exception as error:  # whatever network, TLS and server raise: tried again
                self.connected = False
                if not self._stop.is_set():
                    self._reports.down(error)
            self._partitions.let_go_of_all()
            self._stop.wait(AGAIN_S)

    async def _serve(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._reports.begin()
        client = Client()
        try:
            await client.connect(
                servers=self._login.servers,
                name=f"fltea {self.worker}",
                user=self._login.user,
                password=self._login.password,
                tls=self._login.tls,
                connect_timeout=5,
                allow_reconnect=False,
                max_reconnect_attempts=1,  # at the first connection too, where the library tries 60 times
                error_cb=_ignore,
            )
            self._reports.on_server()
            self._store = self._partitions.store = Store(self._settings, client.jetstream(timeout=STOP_S / 2))
            await self._store.prepare()
            self._reports.differences(self._store.differs)
            await self._partitions.renew()  # a server whose store is full fails here, and is not back
            renewed_s, probed_s = time.monotonic(), -PROBE_S
            self.connected = True
            if self._reports.back():
                self._partitions.wait_for_others()
            while not self._stop.is_set():
                if client.is_closed:
                    raise ConnectionError("the connection was lost")
                if time.monotonic() - renewed_s >= RENEW_S:
                    renewed_s = time.monotonic()
                    await self._partitions.renew()
                if time.monotonic() - probed_s >= PROBE_S:
                    probed_s = time.monotonic()
                    self._reports.mapping(await mapping.look(client, self.worker, self._settings.partitions))
                await self._partitions.share_out()
                await asyncio.sleep(LOOK_S)
            await self._partitions.give_all_back()
        finally:
            self.connected, self._loop = False, None
            self._partitions.let_go_of_all()
            await client.close()


async def _ignore(error: Exception) -> None:
    """Ignore an error that the library raises as well."""


def _login(config: Config) -> _Login:
    ca, tls = config.ingest.ca, None
    if ca is not None:
        try:
            tls = ssl.create_default_context(cafile=ca)
        except OSError as error:
            raise UsageError(f"ingest.ca {ca}: cannot be used ({error.strerror or error}).") from error
    user, password = os.environ.get(USER) or None, os.environ.get(PASSWORD) or None
    return _Login((config.source or "").split(","), user, password, tls)
