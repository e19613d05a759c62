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
from dataclasses import dataclass

import msgspec
from nats.aio.client import Client
from nats.errors import Error as NatsError
from nats.js.errors import KeyWrongLastSequenceError

from fltea.records.clock import host_ns, unix_offset_ns
from fltea.records.errors import UsageError
from fltea.records.ports import Report
from fltea.records.repeat import OnceAMinute
from fltea.service.ingest import mapping
from fltea.service.ingest.inbox import Inbox, Left, Resumed, Served
from fltea.service.ingest.leases import RENEW_S, STOP_S, Lease, Sightings, is_free, lease_of, share, surplus
from fltea.service.ingest.nats_texts import PASSWORD, USER, describe_taken, explain, explain_no_connection
from fltea.service.ingest.pull import pull
from fltea.service.ingest.store import Store, Unfit
from fltea.settings.config import Config

LOOK_S = 0.5
AGAIN_S = 1.0
"""From one attempt to connect to the next."""

GRACE_S = 2 * RENEW_S
"""After an outage of the server: who comes back first would else take all, and give it back at once."""

PROBE_S = 60.0
"""From one look at the server's mapping to the next: its settings may be loaded again at any time."""

PUTS = 64
"""Snapshots on their way to the store; further ones wait for their next turn."""

STEADY_NS = 50_000_000
"""A change of the server's clock against ours that is smaller is how long the question took."""

APART_NS = 5 * 10**9
"""Clocks that differ by more are told."""


@dataclass
class _Held:
    """A partition that this worker serves. before: the last message that the one before it had walked.

    lapsed: it was not renewed in time, so messages are left out, until those that follow the last one walked
    come again. resuming: they have been asked for.
    """

    revision: int
    renewed_s: float
    before: int
    lapsed: bool = False
    resuming: bool = False
    task: "asyncio.Task[None] | None" = None

    def is_fresh(self) -> bool:
        """Whether nobody else can have it yet."""
        return time.monotonic() - self.renewed_s < STOP_S


class NatsFrames:
    """Serves its share of the partitions, in a thread of its own, until closed.

    url: one server, or several with commas between. worker: name of this process, unlike all others'.
    """

    def __init__(self, config: Config, inbox: Inbox, report: Report) -> None:
        self._settings = config.ingest
        self._servers = (config.source or "").split(",")
        self._tls = _tls(config)
        self._user, self._password = os.environ.get(USER) or None, os.environ.get(PASSWORD) or None
        self._inbox, self._report = inbox, report
        self.url = self._servers[0]
        self.worker = f"{config.name}-{secrets.token_hex(4)}"
        self.connected = False
        self.done: dict[int, int] = {}
        self.unix_offset_ns = unix_offset_ns()
        self._held: dict[int, _Held] = {}
        self._sightings = Sightings()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._stop = threading.Event()
        self._puts: set[concurrent.futures.Future[None]] = set()
        self._told_down: set[bool] = set()
        self._takes_from_s = 0.0
        self._thread = threading.Thread(target=self._run, name="nats", daemon=True)
        self._told = OnceAMinute()
        self._told_settings: set[str] = set()
        self._told_clock = self._reached = False
        self._nc: Client
        self._store: Store

    def start(self) -> None:
        """Begin to serve."""
        self._thread.start()

    def close(self) -> None:
        """Give all partitions back."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join(2.0)

    def serves(self, partition: int) -> bool:
        """Whether this worker may still walk messages of a partition; asked for each one."""
        held = self._held.get(partition)
        if held is None:
            return False
        if not held.is_fresh():
            held.lapsed = True
        return not held.lapsed

    def resume(self, partition: int) -> None:
        """From here on come the messages that were left out."""
        held = self._held.get(partition)
        if held is not None:
            held.lapsed, held.resuming = not held.is_fresh(), False

    def walked(self, partition: int, mark: int) -> None:
        """Take note of the last message that was walked."""
        self.done[partition] = mark

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
            if data is not None and self._told.is_due("snapshot", host_ns()):
                self._report("snapshot_failed", f"{self.url}: {key} cannot be kept: {explain(error)}")

    # --- the connection ---

    def _run(self) -> None:
        while not self._stop.is_set():
            try:
                asyncio.run(self._serve())
            except Exception as error:  # whatever network, TLS and server raise: tried again
                self.connected = False
                if not self._stop.is_set():
                    self._tell_down(error)
            for partition in list(self._held):
                self._let_go(partition)
            self._stop.wait(AGAIN_S)

    def _tell_down(self, error: Exception) -> None:
        """Of an outage each reason once: no server, or one that is not fit."""
        unfit = isinstance(error, Unfit)
        if unfit in self._told_down:
            return
        self._told_down.add(unfit)
        text = explain(error) if self._reached else explain_no_connection(error)
        self._report(
            "nats_settings" if unfit else "nats_lost",
            f"{self.url}: {text} It is tried again.",
        )

    async def _serve(self) -> None:
        self._loop, self._reached = asyncio.get_running_loop(), False
        self._nc = Client()
        try:
            await self._nc.connect(
                servers=self._servers,
                name=f"fltea {self.worker}",
                user=self._user,
                password=self._password,
                tls=self._tls,
                connect_timeout=5,
                allow_reconnect=False,
                max_reconnect_attempts=1,  # at the first connection too, where the library tries 60 times
                error_cb=_ignore,
            )
            self._reached = True
            self._store = Store(self._settings, self._nc.jetstream(timeout=STOP_S / 2))
            await self._store.prepare()
            self._tell_differences()
            await self._renew()  # a server whose store is full fails here, and is not back
            renewed_s, probed_s = time.monotonic(), -PROBE_S
            self.connected = True
            if self._told_down:
                self._told_down = set()
                self._takes_from_s = time.monotonic() + GRACE_S
                self._report("nats_back", f"{self.url} is back; devices go on from their snapshots.")
            while not self._stop.is_set():
                if self._nc.is_closed:
                    raise ConnectionError("the connection was lost")
                if time.monotonic() - renewed_s >= RENEW_S:
                    renewed_s = time.monotonic()
                    await self._renew()
                if time.monotonic() - probed_s >= PROBE_S:
                    probed_s = time.monotonic()
                    wrong = await mapping.look(self._nc, self.worker, self._settings.partitions)
                    if wrong:
                        self._report("nats_mapping", f"{self.url}: {wrong}")
                await self._share_out()
                await asyncio.sleep(LOOK_S)
            await self._give_all_back()
        finally:
            self.connected, self._loop = False, None
            for partition in list(self._held):
                self._let_go(partition)
            await self._nc.close()

    def _tell_differences(self) -> None:
        """Once: what exists on the server otherwise than the settings have it."""
        new = set(self._store.differs) - self._told_settings
        if not new:
            return
        self._told_settings |= new
        text = (
            f"{self.url}: {'; '.join(self._store.differs)}, as these settings would have it. It stays as it "
            "is: start one worker with --set ingest.change_limits=true to change it (smaller limits throw "
            "away what is beyond them)."
        )
        self._report("nats_settings", text)

    # --- leases ---

    async def _renew(self) -> None:
        """Say that we live, and that our partitions are served."""
        began_s = time.monotonic()
        await self._look_at_clock()
        for partition, held in list(self._held.items()):
            lease = msgspec.json.encode(Lease(self.worker, self._done_of(partition, held)))
            try:
                held.revision = await self._store.leases.update(
                    f"lease.{partition}", lease, last=held.revision
                )
                held.renewed_s = began_s
            except KeyWrongLastSequenceError:
                self._let_go(partition)

    async def _look_at_clock(self) -> None:
        """Write our own entry, and see what time the server gives it: our clock need not agree with it."""
        key, before_ns = f"worker.{self.worker}", host_ns()
        await self._store.leases.put(key, b"")
        written_ns = (before_ns + host_ns()) // 2
        offset_ns = await self._store.clock_ns(key) - written_ns
        if abs(offset_ns - self.unix_offset_ns) > STEADY_NS:
            self.unix_offset_ns = offset_ns
        apart_ns = offset_ns - unix_offset_ns()
        if abs(apart_ns) > APART_NS and not self._told_clock:
            self._told_clock = True
            side = "ahead of" if apart_ns > 0 else "behind"
            text = (
                f"{self.url}: the server's clock is {abs(apart_ns) * 1e-9:.0f} s {side} this machine's. "
                "Times of records are the server's; set both by NTP."
            )
            self._report("nats_clock", text)

    def _done_of(self, partition: int, held: _Held) -> int:
        """The last message that anybody has walked."""
        return max(held.before, self.done.get(partition, 0))

    async def _share_out(self) -> None:
        """Let go of what is not ours any more or too much; take what is free, up to our share."""
        for partition, held in list(self._held.items()):
            failed = held.task.exception() if held.task is not None and held.task.done() else None
            if failed is not None:
                text = f"{self.url}: partition {partition} is given back: {explain(failed)}"
                self._report("partition_left", text)
                await self._give_back(partition)
            elif held.lapsed and held.is_fresh() and not held.resuming:
                await self._pull_again(partition, held)
        entries = await self._store.held()
        now_s = time.monotonic()
        self._sightings.look(entries, now_s)
        workers = len(self._sightings.fresh("worker.", now_s))
        partitions = self._settings.partitions
        for partition in surplus(self._held, partitions, workers):
            await self._give_back(partition)
        if now_s < self._takes_from_s:
            return
        for partition in range(partitions):
            if len(self._held) >= share(partitions, workers):
                break
            seen = self._sightings.of(f"lease.{partition}")
            if partition not in self._held and is_free(seen, now_s):
                await self._take(
                    partition, lease_of(seen.value) if seen else Lease(""), seen and seen.revision
                )

    async def _take(self, partition: int, before: Lease, revision: int | None) -> None:
        """Take a lease, load the snapshots, and begin to pull behind the oldest of them."""
        began_s = time.monotonic()
        lease = msgspec.json.encode(Lease(self.worker, before.done))
        try:
            new = await self._store.leases.update(f"lease.{partition}", lease, last=revision or 0)
        except KeyWrongLastSequenceError:  # another was first
            return
        held = self._held[partition] = _Held(new, began_s, before.done)
        kept, unreadable = await self._store.devices_of(partition)
        held.revision = await self._store.leases.update(f"lease.{partition}", lease, last=held.revision)
        held.renewed_s = time.monotonic()
        marks = [one.mark for one in kept.values()]
        first, last = await self._store.ends()
        start = (min(marks) if marks else before.done) + 1
        if start > last + 1:  # another stream than that of the snapshots
            held.before = 0
            start, kept = 1, {name: msgspec.structs.replace(one, mark=0) for name, one in kept.items()}
        self.done[partition] = start - 1
        self._inbox.post(Served(partition, kept, before.done, start - 1))
        held.task = self._pull(partition, start)
        if before.owner or kept or unreadable:
            gone = range(start, first if marks else start)
            text = describe_taken(self.worker, partition, before, start, len(kept), gone, unreadable)
            self._report("partition_taken", text)

    def _pull(self, partition: int, start: int) -> "asyncio.Task[None]":
        return asyncio.create_task(
            pull(self._store, self._inbox, partition, start, lambda: self.unix_offset_ns)
        )

    async def _pull_again(self, partition: int, held: _Held) -> None:
        """The lease was late, and nobody took it: go on behind the last message that was walked."""
        if held.task is not None:
            held.task.cancel()
            await asyncio.wait([held.task])
        held.resuming = True
        self._inbox.post(Resumed(partition))
        held.task = self._pull(partition, self.done.get(partition, held.before) + 1)

    async def _give_back(self, partition: int) -> None:
        held = self._held[partition]
        self._let_go(partition)
        lease = msgspec.json.encode(Lease("", self._done_of(partition, held)))
        try:
            await self._store.leases.update(f"lease.{partition}", lease, last=held.revision)
        except KeyWrongLastSequenceError:
            return

    async def _give_all_back(self) -> None:
        for partition in list(self._held):
            await self._give_back(partition)
        await self._store.leases.delete(f"worker.{self.worker}")

    def _let_go(self, partition: int) -> None:
        """Serve a partition no more."""
        held = self._held.pop(partition)
        if held.task is not None:
            held.task.cancel()
            held.task.add_done_callback(_look_at)
        self._inbox.post(Left(partition))


async def _ignore(error: Exception) -> None:
    """What the library tells here, it raises as well."""


def _look_at(task: "asyncio.Task[None]") -> None:
    """How a task ended that nobody waits for; asyncio would write it to the log."""
    if not task.cancelled():
        task.exception()


def _tls(config: Config) -> ssl.SSLContext | None:
    ca = config.ingest.ca
    if ca is None:
        return None
    try:
        return ssl.create_default_context(cafile=ca)
    except OSError as error:
        raise UsageError(f"ingest.ca {ca}: cannot be used ({error.strerror or error}).") from error
