"""Receive frames of many devices from NATS JetStream, shared by several workers (host/docs/guide/ingest.md).

The server assigns each device to a partition by a mapping of subjects. The subject `fltea.NAME.frames`
becomes `fltea.frames.PARTITION.NAME`, and a stream keeps the messages of the latter subjects. For each
partition, one worker has the lease. This worker pulls the partition's messages in order, and stores snapshots
of the devices, each with the number of the last message processed before the snapshot. If another worker
takes the partition over, it continues from these snapshots.
"""

import asyncio
import os
import secrets
import ssl
import threading
import time
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, NamedTuple

from nats.aio.client import Client
from nats.errors import Error as NatsError

from fltea.diagnostics.addresses import answers
from fltea.diagnostics.asked import AskedSource
from fltea.diagnostics.finding import Finding
from fltea.records.errors import UsageError
from fltea.records.ports import Report
from fltea.service.ingest import mapping
from fltea.service.ingest.inbox import Inbox
from fltea.service.ingest.leases import LEASE_S, RENEW_S
from fltea.service.ingest.nats_reports import PASSWORD, USER, Reports
from fltea.service.ingest.partitions import Partitions
from fltea.service.ingest.receiver import Receiver
from fltea.service.ingest.store import Store, Unfit
from fltea.settings.config import Config
from fltea.settings.ingest import nats_servers

POLL_S = 0.5
AGAIN_S = 1.0
"""Time between two attempts to connect [s]."""

PROBE_S = 60.0
"""Time between two checks of the server's mapping of NATS subjects to partitions [s]. It is checked again and
again, since the server may load other settings at any time.
"""


class _Login(NamedTuple):
    """Addresses and credentials of the NATS server.

    `servers`: one URL, or several for a cluster of servers.
    """

    servers: list[str]
    user: str | None
    password: str | None
    tls: ssl.SSLContext | None


class NatsFrames:
    """Receives the messages of this worker's share of the partitions, in a separate thread.

    `url`: URL of the first server. `worker`: unique name of this process. `partitions`: this worker's part of
    the partitions.
    """

    def __init__(self, config: Config, inbox: Inbox, report: Report) -> None:
        self._settings, self._login = config.ingest, _login(config)
        self.url = self._login.servers[0]
        self.worker = f"{config.name}-{secrets.token_hex(4)}"
        self.connected = False
        self._reports = Reports(self.url, report)
        self.partitions = Partitions(self.worker, config.ingest.partitions, inbox, self._reports)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="nats", daemon=True)

    def start(self) -> None:
        """Start the thread that receives messages."""
        self._thread.start()

    def close(self) -> None:
        """Give all partitions back, and end the thread."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join(2.0)

    def _run(self) -> None:
        while not self._stop.is_set():
            try:
                asyncio.run(self._serve())
            # whatever error the network, TLS or the server cause, the connection is tried again
            except Exception as error:
                self.connected = False
                if not self._stop.is_set():
                    self._reports.down(error)
            self.partitions.let_go_of_all()
            self._stop.wait(AGAIN_S)

    async def _serve(self) -> None:
        asyncio.get_running_loop().set_exception_handler(_on_library_error)
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
                flush_timeout=LEASE_S,
                allow_reconnect=False,
                # this limit also applies to the first connection, for which the library would make 60
                # attempts
                max_reconnect_attempts=1,
                error_cb=self._heard,
            )
            self._reports.on_server()
            serving = asyncio.create_task(self._serve_over(client))
            # The connection is checked here, since the library lets requests wait forever after the
            # connection has broken.
            while not (serving.done() or client.is_closed):
                await asyncio.wait([serving], timeout=POLL_S)
            if client.is_closed:
                raise ConnectionError("the connection was lost")
            serving.result()
        finally:
            self.connected = False
            await _end_others()
            self.partitions.let_go_of_all()
            await client.close()

    async def _heard(self, error: Exception) -> None:
        """Note an error that the library reports.

        Errors of the connection are also raised elsewhere.
        """
        self._reports.refused(error)

    async def _serve_over(self, client: Client) -> None:
        """Serve partitions over one connection, until `close` is called."""
        # A request fails if the server has not answered after `LEASE_S`, the life of a lease. It makes no
        # sense to wait longer: after that time this worker's leases have ended, and others may take its
        # partitions.
        store = Store(self._settings, client.jetstream(timeout=LEASE_S))
        await store.prepare()
        self._reports.differences(store.differs)
        self.partitions.begin(store)
        # If the server's store is full, renew() raises an error, and the end of the outage is not reported.
        await self.partitions.renew()
        renewed_s, probed_s = time.monotonic(), -PROBE_S
        self.connected = True
        if self._reports.is_down:
            self.partitions.wait_for_others()
        while not self._stop.is_set():
            if time.monotonic() - renewed_s >= RENEW_S:
                renewed_s = time.monotonic()
                await self.partitions.renew()
            if time.monotonic() - probed_s >= PROBE_S:
                probed_s = time.monotonic()
                self._reports.mapping(await mapping.check(client, self.worker, self._settings.partitions))
            if await self.partitions.share_out():
                self._reports.back()
            await asyncio.sleep(POLL_S)
        await self.partitions.give_all_back()


async def _end_others() -> None:
    """Cancel all other tasks of the event loop. Repeat this until they have ended.

    This is needed since a task of the library may ignore a cancellation while it waits.
    """
    while others := asyncio.all_tasks() - {asyncio.current_task()}:
        for task in others:
            task.cancel()
        await asyncio.wait(others, timeout=AGAIN_S / 10)


def _on_library_error(loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
    """Ignore an error of a task that no code waits for, if a broken connection explains the error."""
    if not isinstance(context.get("exception"), OSError | NatsError | Unfit):
        loop.default_exception_handler(context)


def _login(config: Config) -> _Login:
    ca, tls = config.ingest.ca, None
    if ca is not None:
        try:
            tls = ssl.create_default_context(cafile=ca)
        except OSError as error:
            raise UsageError(f"ingest.ca {ca}: cannot be used ({error.strerror or error}).") from error
    user, password = os.environ.get(USER) or None, os.environ.get(PASSWORD) or None
    return _Login((config.source or "").split(","), user, password, tls)


def receiver_of(config: Config) -> Callable[[Inbox, Report], Receiver]:
    """Return a function that makes the receiver for the servers of the source's URL.

    Raises:
        UsageError: the URL is not the address of NATS servers.
    """
    nats_servers(config.source or "")
    return partial(NatsFrames, config)


def check_source(asked: AskedSource) -> Iterator[Finding]:
    """Yield for each server whether something answers at its address."""
    for server in nats_servers(asked.url or ""):
        yield answers("source", "NATS server", server.host, server.port)
