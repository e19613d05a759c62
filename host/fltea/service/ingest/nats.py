"""Frames of many devices from NATS JetStream, shared among several workers (host/ingest.md).

The server puts each device into a partition, by a mapping of subjects: `fltea.NAME.frames` becomes
`fltea.frames.PARTITION.NAME`, kept in a stream. Of each partition one worker has the lease, pulls messages in
their order, and keeps snapshots of its devices in the store, with the number of the message that they follow.
Who takes over goes on from there.
"""

import asyncio
import concurrent.futures
import contextlib
import os
import secrets
import ssl
import threading
import time
from dataclasses import dataclass

import msgspec
import nats
from nats.aio.client import Client
from nats.errors import Error as NatsError
from nats.js import JetStreamContext
from nats.js.api import AckPolicy, ConsumerConfig, DeliverPolicy, KeyValueConfig, StreamConfig
from nats.js.errors import KeyNotFoundError, KeyWrongLastSequenceError, NotFoundError
from nats.js.kv import KeyValue

from fltea.records.errors import UsageError
from fltea.records.ports import Report
from fltea.service.ingest.inbox import Inbox, Left, Served
from fltea.service.ingest.kept import Kept, unpack
from fltea.service.ingest.leases import RENEW_S, STOP_S, Lease, Sightings, is_free, lease_of, share, surplus
from fltea.settings.config import Config

USER, PASSWORD = "FLTEA_NATS_USER", "FLTEA_NATS_PASSWORD"
LOOK_S = 0.5
GRACE_S = 2 * RENEW_S
"""After an outage of the server: who comes back first would else take all, and give it back at once."""

PULL, PULL_S = 64, 0.5
ROOM_BYTES = 4_000_000
"""What may wait here; the rest waits in the stream."""

PUTS = 64
"""Snapshots on their way to the store; further ones wait for their next turn."""


@dataclass
class _Held:
    """A partition that this worker serves. before: the last message that the one before it had walked."""

    revision: int
    renewed_s: float
    before: int
    task: "asyncio.Task[None] | None" = None


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
        self._held: dict[int, _Held] = {}
        self._sightings = Sightings()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._stop = threading.Event()
        self._puts: set[concurrent.futures.Future[None]] = set()
        self._told_down = False
        self._takes_from_s = 0.0
        self._thread = threading.Thread(target=self._run, name="nats", daemon=True)
        self._nc: Client
        self._js: JetStreamContext
        self._kv: KeyValue

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
        return held is not None and time.monotonic() - held.renewed_s < STOP_S

    def walked(self, partition: int, mark: int) -> None:
        """Take note of the last message that was walked."""
        self.done[partition] = mark

    def keep(self, partition: int, device: str, data: bytes) -> bool:
        """Store a snapshot, in the background; False if too many are on their way."""
        self._puts = {one for one in self._puts if not one.done()}
        if self._loop is None or len(self._puts) >= PUTS or not self.serves(partition):
            return False
        put = self._put(f"lanes.{partition}.{device}", data)
        self._puts.add(asyncio.run_coroutine_threadsafe(put, self._loop))
        return True

    async def _put(self, key: str, data: bytes) -> None:
        try:
            await self._kv.put(key, data)
        except NatsError as error:
            self._report("snapshot_failed", f"{self.url}: {key} cannot be kept ({error}).")

    # --- the connection ---

    def _run(self) -> None:
        while not self._stop.is_set():
            try:
                asyncio.run(self._serve())
            except Exception as error:  # whatever network, TLS and server raise: tried again
                self.connected = False
                if not self._stop.is_set() and not self._told_down:
                    self._told_down = True
                    self._report("nats_lost", f"{self.url}: {_explain(error)} It is tried again.")
            for partition in list(self._held):
                self._let_go(partition)
            self._stop.wait(1.0)

    async def _serve(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._nc = await nats.connect(
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
        try:
            self._js = self._nc.jetstream(timeout=STOP_S / 2)
            await self._prepare()
            self.connected = True
            if self._told_down:
                self._told_down = False
                self._takes_from_s = time.monotonic() + GRACE_S
                self._report("nats_back", f"{self.url} is back; devices go on from their snapshots.")
            renewed_s = -RENEW_S
            while not self._stop.is_set():
                if self._nc.is_closed:
                    raise ConnectionError("the connection was lost")
                if time.monotonic() - renewed_s >= RENEW_S:
                    renewed_s = time.monotonic()
                    await self._renew()
                await self._share_out()
                await asyncio.sleep(LOOK_S)
            await self._give_all_back()
        finally:
            self.connected, self._loop = False, None
            for partition in list(self._held):
                self._let_go(partition)
            await self._nc.close()

    async def _prepare(self) -> None:
        """Make stream and bucket where they are missing."""
        s = self._settings
        try:
            await self._js.stream_info(s.stream)
        except NotFoundError:
            subjects = ["fltea.frames.*.*"]
            await self._js.add_stream(
                StreamConfig(name=s.stream, subjects=subjects, max_age=s.keep_s, num_replicas=s.replicas)
            )
        try:
            self._kv = await self._js.key_value(s.bucket)
        except NotFoundError:
            made = KeyValueConfig(bucket=s.bucket, history=1, ttl=s.keep_s, replicas=s.replicas)
            self._kv = await self._js.create_key_value(made)

    # --- leases ---

    async def _renew(self) -> None:
        """Say that we live, and that our partitions are served."""
        began_s = time.monotonic()
        await self._kv.put(f"worker.{self.worker}", b"")
        for partition, held in list(self._held.items()):
            lease = msgspec.json.encode(Lease(self.worker, self._done_of(partition, held)))
            try:
                held.revision = await self._kv.update(f"lease.{partition}", lease, last=held.revision)
                held.renewed_s = began_s
            except KeyWrongLastSequenceError:
                self._let_go(partition)

    def _done_of(self, partition: int, held: _Held) -> int:
        """The last message that anybody has walked."""
        return max(held.before, self.done.get(partition, 0))

    async def _share_out(self) -> None:
        """Let go of what is not ours any more or too much; take what is free, up to our share."""
        for partition, held in list(self._held.items()):
            failed = held.task.exception() if held.task is not None and held.task.done() else None
            if failed is not None:
                text = f"{self.url}: partition {partition} is given back: {_explain(failed)}"
                self._report("partition_left", text)
                await self._give_back(partition)
            elif not self.serves(partition):
                self._let_go(partition)
        entries = await self._entries("lease.*") | await self._entries("worker.*")
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

    async def _entries(self, pattern: str) -> dict[str, tuple[int, bytes]]:
        """All entries of the store below a pattern."""
        found = {}
        for key in await self._keys(pattern):
            try:
                entry = await self._kv.get(key)
                found[key] = (entry.revision or 0, entry.value or b"")
            except KeyNotFoundError:  # expired meanwhile
                continue
        return found

    async def _keys(self, pattern: str) -> list[str]:
        prefix = f"$KV.{self._settings.bucket}."
        info = await self._js.stream_info(f"KV_{self._settings.bucket}", subjects_filter=prefix + pattern)
        return [subject.removeprefix(prefix) for subject in info.state.subjects or {}]

    async def _take(self, partition: int, before: Lease, revision: int | None) -> None:
        """Take a lease, load the snapshots, and begin to pull behind the oldest of them."""
        began_s = time.monotonic()
        lease = msgspec.json.encode(Lease(self.worker, before.done))
        try:
            new = await self._kv.update(f"lease.{partition}", lease, last=revision or 0)
        except KeyWrongLastSequenceError:  # another was first
            return
        held = self._held[partition] = _Held(new, began_s, before.done)
        kept = await self._snapshots(partition)
        held.revision = await self._kv.update(f"lease.{partition}", lease, last=held.revision)
        held.renewed_s = time.monotonic()
        marks = [one.mark for one in kept.values()]
        info = await self._js.stream_info(self._settings.stream)
        first, last = info.state.first_seq, info.state.last_seq
        start = (min(marks) if marks else before.done) + 1
        if start > last + 1:  # another stream than that of the snapshots
            held.before = 0
            start, kept = 1, {name: msgspec.structs.replace(one, mark=0) for name, one in kept.items()}
        self.done[partition] = start - 1
        self._inbox.post(Served(partition, kept, before.done))
        held.task = asyncio.create_task(self._pull(partition, start))
        if before.owner or kept:
            whose = f"of {before.owner}, which has gone silent," if before.owner else "that was given back"
            gone = max(0, first - start) if marks else 0
            lost = f" The stream has let go of {gone} messages before {first}." if gone else ""
            text = (
                f"{self.worker} serves partition {partition} {whose} from message {start}: {len(kept)} "
                f"devices go on from snapshots; messages up to {before.done} had been walked before.{lost}"
            )
            self._report("partition_taken", text)

    async def _snapshots(self, partition: int) -> dict[str, Kept]:
        """Those of a partition's devices, but for devices that fell silent long before the others."""
        prefix = f"lanes.{partition}."
        found: dict[str, Kept] = {}
        for key, (_, data) in (await self._entries(prefix + "*")).items():
            if (kept := unpack(data)) is not None:
                found[key.removeprefix(prefix)] = kept
        newest_ns = max((one.unix_ns for one in found.values()), default=0)
        oldest_ns = newest_ns - int(self._settings.forget_s * 1e9)
        return {name: one for name, one in found.items() if one.unix_ns >= oldest_ns}

    async def _give_back(self, partition: int) -> None:
        held = self._held[partition]
        self._let_go(partition)
        lease = msgspec.json.encode(Lease("", self._done_of(partition, held)))
        try:
            await self._kv.update(f"lease.{partition}", lease, last=held.revision)
        except KeyWrongLastSequenceError:
            return

    async def _give_all_back(self) -> None:
        for partition in list(self._held):
            await self._give_back(partition)
        await self._kv.delete(f"worker.{self.worker}")

    def _let_go(self, partition: int) -> None:
        """Serve a partition no more."""
        held = self._held.pop(partition)
        if held.task is not None:
            held.task.cancel()
        self._inbox.post(Left(partition))

    # --- messages ---

    async def _consume(self, partition: int, start: int) -> None:
        """A consumer of our own making in place of the one before: its owner then pulls in vain."""
        name = f"fltea-{partition}"
        with contextlib.suppress(NotFoundError):
            await self._js.delete_consumer(self._settings.stream, name)
        wanted = ConsumerConfig(
            durable_name=name,
            filter_subject=f"fltea.frames.{partition}.*",
            deliver_policy=DeliverPolicy.BY_START_SEQUENCE,
            opt_start_seq=start,
            ack_policy=AckPolicy.NONE,
        )
        await self._js.add_consumer(self._settings.stream, wanted)

    async def _pull(self, partition: int, start: int) -> None:
        """Hand messages on, none left out: a pull that the library gave up may have taken some with it."""
        while True:
            await self._consume(partition, start)
            pulling = await self._js.pull_subscribe_bind(f"fltea-{partition}", self._settings.stream)
            expected, whole = 1, True
            while whole:
                while not self._inbox.has_room(ROOM_BYTES):
                    await asyncio.sleep(0.01)
                try:
                    messages = await pulling.fetch(PULL, timeout=PULL_S)
                except TimeoutError:
                    continue
                for message in messages:
                    meta = message.metadata
                    if meta.sequence.consumer != expected:
                        whole = False
                        break
                    expected, start = expected + 1, meta.sequence.stream + 1
                    name = message.subject.rpartition(".")[2]
                    unix_ns = round(meta.timestamp.timestamp() * 1e9)
                    self._inbox.put(name, message.data, partition, meta.sequence.stream, unix_ns)
            await pulling.unsubscribe()


async def _ignore(error: Exception) -> None:
    """What the library tells here, it raises as well."""


def _explain(error: BaseException) -> str:
    if isinstance(error, ConnectionRefusedError | nats.errors.NoServersError):
        return "no server answers: is it running, and is the port right?"
    if isinstance(error, ssl.SSLError):
        return f"TLS could not be agreed on ({error.reason or error}); is ingest.ca the right authority?"
    if isinstance(error, NatsError) and "authorization" in str(error).lower():
        return f"the server refuses user or password; they come from {USER} and {PASSWORD}."
    return f"{type(error).__name__}: {error}."


def _tls(config: Config) -> ssl.SSLContext | None:
    ca = config.ingest.ca
    if ca is None:
        return None
    try:
        return ssl.create_default_context(cafile=ca)
    except OSError as error:
        raise UsageError(f"ingest.ca {ca}: cannot be used ({error.strerror or error}).") from error
