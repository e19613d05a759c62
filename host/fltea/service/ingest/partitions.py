"""The partitions that a worker serves: their leases in the store, and who pulls their messages.

`serves`, `resume`, `walked`, `keep`, and `drop` are called by the thread that walks the messages, all else by
the loop of the connection.
"""

import asyncio
import concurrent.futures
import time
from collections.abc import Callable
from dataclasses import dataclass

import msgspec
from nats.errors import ConnectionClosedError
from nats.errors import Error as NatsError
from nats.js.errors import KeyWrongLastSequenceError

from fltea.records.clock import host_ns, unix_offset_ns
from fltea.service.ingest.inbox import Inbox, Left, Resumed, Served
from fltea.service.ingest.leases import RENEW_S, STOP_S, Lease, Sightings, is_free, lease_of, share, surplus
from fltea.service.ingest.nats_reports import Reports
from fltea.service.ingest.store import Store

GRACE_S = 2 * RENEW_S
"""After an outage of the server: who comes back first would else take all, and give it back at once.

A partition whose messages cannot be pulled is left to others for as long.
"""

STEADY_NS = 50_000_000
"""A change of the server's clock against ours that is smaller is how long the question took."""

PULL, PULL_S = 64, 0.5
LOOKS = 4
"""After so many pulls in vain it is asked whether our consumer still exists: the server does not say so."""

PUTS = 64
"""Snapshots on their way to the store; further ones wait for their next turn."""

ROOM_BYTES = 4_000_000
"""What may wait here; the rest waits in the stream."""


@dataclass
class Held:
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


class Partitions:
    """Has this worker's share of the partitions.

    worker: name of this process, unlike all others'. total: how many partitions there are. done: the last
    message of each partition that was walked. unix_offset_ns: from `host_ns` to the server's time.
    """

    store: Store

    def __init__(self, worker: str, total: int, inbox: Inbox, reports: Reports) -> None:
        self._worker, self._total, self._inbox, self._reports = worker, total, inbox, reports
        inbox.queue_bytes = min(inbox.queue_bytes, ROOM_BYTES)
        self.done: dict[int, int] = {}
        self.unix_offset_ns = unix_offset_ns()
        self._held: dict[int, Held] = {}
        self._sightings = Sightings()
        self._takes_from_s = 0.0
        self._left_s: dict[int, float] = {}
        """When a partition was given back since its messages could not be pulled."""
        self._loop: asyncio.AbstractEventLoop | None = None
        self._puts: set[concurrent.futures.Future[None]] = set()

    def begin(self, store: Store) -> None:
        """Begin with a connection, in whose loop this is called; `let_go_of_all` ends it."""
        self.store, self._loop = store, asyncio.get_running_loop()

    def wait_for_others(self) -> None:
        """Take nothing for a while, since the server was away."""
        self._takes_from_s = time.monotonic() + GRACE_S

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
        return self._in_background(partition, device, data)

    def drop(self, partition: int, device: str) -> None:
        """Delete a snapshot, in the background. If that fails, who is next finds the device silent."""
        self._in_background(partition, device, None)

    def _in_background(self, partition: int, device: str, data: bytes | None) -> bool:
        self._puts = {one for one in self._puts if not one.done()}
        loop = self._loop
        if not self.serves(partition) or loop is None or len(self._puts) >= PUTS:
            return False
        put = self._put(f"{partition}.{device}", data)
        try:
            self._puts.add(asyncio.run_coroutine_threadsafe(put, loop))
        except RuntimeError:  # the connection has just ended
            put.close()
            return False
        return True

    async def _put(self, key: str, data: bytes | None) -> None:
        snapshots = self.store.snapshots
        try:
            await (snapshots.delete(key) if data is None else snapshots.put(key, data))
        except NatsError as error:
            if data is not None and not isinstance(error, ConnectionClosedError):  # which is reported itself
                self._reports.snapshot(key, error)

    async def renew(self) -> None:
        """Renew the leases, which shows others that this worker lives."""
        began_s = time.monotonic()
        await self._look_at_clock()
        for partition, held in list(self._held.items()):
            lease = msgspec.json.encode(Lease(self._worker, self._done_of(partition, held)))
            try:
                held.revision = await self.store.leases.update(
                    f"lease.{partition}", lease, last=held.revision
                )
                held.renewed_s = began_s
            except KeyWrongLastSequenceError:
                self._let_go(partition)

    async def _look_at_clock(self) -> None:
        """Write our own entry, and see what time the server gives it: our clock need not agree with it."""
        key, before_ns = f"worker.{self._worker}", host_ns()
        await self.store.leases.put(key, b"")
        written_ns = (before_ns + host_ns()) // 2
        offset_ns = await self.store.clock_ns(key) - written_ns
        if abs(offset_ns - self.unix_offset_ns) > STEADY_NS:
            self.unix_offset_ns = offset_ns
        self._reports.clock(offset_ns - unix_offset_ns())

    def _done_of(self, partition: int, held: Held) -> int:
        """The last message that anybody has walked."""
        return max(held.before, self.done.get(partition, 0))

    async def share_out(self) -> bool:
        """Let go of what is lost or too much; take what is free, up to this worker's share.

        Returns:
            False if nothing was taken since it is too early.
        """
        for partition, held in list(self._held.items()):
            failed = held.task.exception() if held.task is not None and held.task.done() else None
            if isinstance(failed, ConnectionError | ConnectionClosedError):
                raise failed
            if failed is not None:
                self._reports.left(partition, failed)
                self._left_s[partition] = time.monotonic()
                await self._give_back(partition)
            elif held.lapsed and held.is_fresh() and not held.resuming:
                await self._pull_again(partition, held)
        entries = await self.store.held()
        now_s = time.monotonic()
        self._sightings.look(entries, now_s)
        workers = len(self._sightings.fresh("worker.", now_s))
        for partition in surplus(self._held, self._total, workers):
            await self._give_back(partition)
        if now_s < self._takes_from_s:
            return False
        self._left_s = {one: left_s for one, left_s in self._left_s.items() if now_s - left_s < GRACE_S}
        for partition in range(self._total):
            if len(self._held) >= share(self._total, workers):
                break
            seen = self._sightings.of(f"lease.{partition}")
            may_take = partition not in self._held and partition not in self._left_s
            if may_take and is_free(seen, now_s):
                await self._take(
                    partition, lease_of(seen.value) if seen else Lease(""), seen and seen.revision
                )
        return True

    async def _take(self, partition: int, before: Lease, revision: int | None) -> None:
        """Take a lease, load the snapshots, and begin to pull behind the oldest of them."""
        began_s = time.monotonic()
        lease = msgspec.json.encode(Lease(self._worker, before.done))
        try:
            new = await self.store.leases.update(f"lease.{partition}", lease, last=revision or 0)
        except KeyWrongLastSequenceError:  # another was first
            return
        held = self._held[partition] = Held(new, began_s, before.done)
        kept, unreadable = await self.store.devices_of(partition)
        held.revision = await self.store.leases.update(f"lease.{partition}", lease, last=held.revision)
        held.renewed_s = time.monotonic()
        marks = [one.mark for one in kept.values()]
        first, last = await self.store.ends()
        start = (min(marks) if marks else before.done) + 1
        if start > last + 1:  # another stream than that of the snapshots
            held.before = 0
            start, kept = 1, {name: msgspec.structs.replace(one, mark=0) for name, one in kept.items()}
        self.done[partition] = start - 1
        self._inbox.post(Served(partition, kept, before.done, start - 1))
        held.task = self._pull(partition, start)
        if before.owner or kept or unreadable:
            gone = range(start, first if marks else start)
            self._reports.taken(self._worker, partition, before, start, len(kept), gone, unreadable)

    def _pull(self, partition: int, start: int) -> "asyncio.Task[None]":
        return asyncio.create_task(
            _pull(self.store, self._inbox, partition, start, lambda: self.unix_offset_ns)
        )

    async def _pull_again(self, partition: int, held: Held) -> None:
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
            await self.store.leases.update(f"lease.{partition}", lease, last=held.revision)
        except KeyWrongLastSequenceError:
            return

    async def give_all_back(self) -> None:
        """Let others have all partitions, at the end."""
        for partition in list(self._held):
            await self._give_back(partition)
        await self.store.leases.delete(f"worker.{self._worker}")

    def let_go_of_all(self) -> None:
        """Serve no partition any more, since the connection has ended."""
        self._loop = None
        for partition in list(self._held):
            self._let_go(partition)

    def _let_go(self, partition: int) -> None:
        """Serve a partition no more."""
        held = self._held.pop(partition)
        if held.task is not None:
            held.task.cancel()
        self._inbox.post(Left(partition))


async def _pull(
    store: Store, inbox: Inbox, partition: int, start: int, unix_offset_ns: Callable[[], int]
) -> None:
    """Hand messages on from number `start`, none left out.

    A pull that the library gave up may have taken some with it: they are asked for again. unix_offset_ns:
    from `host_ns` to the time of the stream, as of now.
    """
    while True:
        pulling = await store.consume(partition, start)
        expected, whole, silent = 1, True, 0
        while whole:
            while not inbox.wait_for_room(0):
                await asyncio.sleep(0.01)
            try:
                messages = await pulling.fetch(PULL, timeout=PULL_S)
            except TimeoutError:
                silent += 1
                whole = silent % LOOKS != 0 or await store.has_consumer(partition)
                continue
            for message in messages:
                meta = message.metadata
                if meta.sequence.consumer != expected:
                    whole = False
                    break
                expected, start = expected + 1, meta.sequence.stream + 1
                name = message.subject.rpartition(".")[2]
                arrived_ns = round(meta.timestamp.timestamp() * 1e9) - unix_offset_ns()
                inbox.put(name, message.data, partition, meta.sequence.stream, arrived_ns)
        await pulling.unsubscribe()
