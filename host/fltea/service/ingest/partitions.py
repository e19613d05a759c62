"""Hold the leases of the partitions that this worker serves, and receive the partitions' messages.

The thread that processes the messages calls `serves`, `resume`, `walked`, `keep`, and `drop`. The thread of
the connection to the server calls all other methods.
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
"""For this time after an outage, no partition is taken [s]. Otherwise, the first worker that is back would
take all of them.

If the messages of a partition cannot be pulled, the partition is left to other workers for the same time.
"""

STEADY_NS = 50_000_000
"""If the difference between the server's clock and this machine's clock changes by at most this, the change
is ignored [ns]. It may come from the time that the request takes.
"""

PULL, PULL_S = 64, 0.5
WHOLE_EVERY = 4
"""After this number of requests that brought no message, it is checked that this worker's consumer on the
server still exists.

The check is needed since the server does not report that a consumer was deleted.
"""

PUTS = 64
"""Largest number of snapshots that are sent to the store at the same time. Further snapshots wait."""

ROOM_BYTES = 4_000_000
"""Largest size of messages that wait in this process [bytes]. Further messages wait in the server's
stream.
"""


@dataclass
class Held:
    """A partition that this worker serves.

    `before`: number of the last message that the previous worker has processed. `lapsed`: whether the lease
    was not renewed in time. This worker then skips messages. Once the lease is renewed, the worker asks the
    server to send the skipped messages again. `resuming`: whether it has asked, and they have not come yet.
    """

    revision: int
    renewed_s: float
    before: int
    lapsed: bool = False
    resuming: bool = False
    task: "asyncio.Task[None] | None" = None

    def is_fresh(self) -> bool:
        """Return whether the lease was renewed so recently that no other worker can have taken it."""
        return time.monotonic() - self.renewed_s < STOP_S


class BackgroundPuts:
    """Stores and deletes snapshots in the background, while a connection lasts.

    `loop`: event loop of the connection; None while there is none. `puts`: the running
    orders to store or delete a snapshot.
    """

    def __init__(self, reports: Reports) -> None:
        self._reports = reports
        self._store: Store | None = None
        self.loop: asyncio.AbstractEventLoop | None = None
        self.puts: set[concurrent.futures.Future[None]] = set()

    def begin(self, store: Store) -> None:
        """Use a new connection until `end` is called. Call this in the connection's event loop."""
        self._store, self.loop = store, asyncio.get_running_loop()

    def end(self) -> None:
        """Store no more snapshots, since the connection has ended."""
        self.loop = None

    def put(self, key: str, data: bytes | None) -> bool:
        """Store a snapshot, or delete it if `data` is None.

        Return False if too many snapshots are being stored already, or there is no connection.
        """
        self.puts = {one for one in self.puts if not one.done()}
        store, loop = self._store, self.loop
        if store is None or loop is None or len(self.puts) >= PUTS:
            return False
        put = self._put(store, key, data)
        try:
            self.puts.add(asyncio.run_coroutine_threadsafe(put, loop))
        except RuntimeError:  # the connection has just ended
            put.close()
            return False
        return True

    async def _put(self, store: Store, key: str, data: bytes | None) -> None:
        snapshots = store.snapshots
        try:
            await (snapshots.delete(key) if data is None else snapshots.put(key, data))
        except NatsError as error:
            # if the connection has ended, this is reported elsewhere
            if data is not None and not isinstance(error, ConnectionClosedError):
                self._reports.snapshot(key, error)


class Partitions:
    """Holds the leases of this worker's share of the partitions, and fills the inbox with their messages.

    `worker`: unique name of this process. `total`: number of all partitions. `done`: for each partition, the
    number of the last message that was processed. `unix_offset_ns`: offset from `host_ns` to the server's
    Unix time.
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
        """For each partition that was given back since its messages could not be pulled, the time at which it
        was given back.
        """
        self._background = BackgroundPuts(reports)

    def begin(self, store: Store) -> None:
        """Use a new connection until `let_go_of_all` is called. Call this in the connection's event loop."""
        self.store = store
        self._background.begin(store)

    def wait_for_others(self) -> None:
        """Take no partition for a while, since the server was away."""
        self._takes_from_s = time.monotonic() + GRACE_S

    def serves(self, partition: int) -> bool:
        """Return whether this worker may still process messages of a partition.

        This method is called for each message.
        """
        held = self._held.get(partition)
        if held is None:
            return False
        if not held.is_fresh():
            held.lapsed = True
        return not held.lapsed

    def resume(self, partition: int) -> None:
        """Note that the messages of a partition that this worker skipped now arrive a second time."""
        held = self._held.get(partition)
        if held is not None:
            held.lapsed, held.resuming = not held.is_fresh(), False

    def walked(self, partition: int, mark: int) -> None:
        """Note the number of a partition's last message that was processed."""
        self.done[partition] = mark

    def keep(self, partition: int, device: str, data: bytes) -> bool:
        """Store a snapshot of a device in the background.

        Return False if too many snapshots are being stored already, or if this worker no longer serves the
        partition.
        """
        return self.serves(partition) and self._background.put(f"{partition}.{device}", data)

    def drop(self, partition: int, device: str) -> None:
        """Delete a device's snapshot in the background.

        If the snapshot cannot be deleted, no harm is done: the next worker continues the device from the
        snapshot, and gives the device up since it is silent.
        """
        if self.serves(partition):
            self._background.put(f"{partition}.{device}", None)

    async def renew(self) -> None:
        """Renew the leases, so that other workers see that this worker runs."""
        began_s = time.monotonic()
        await self._check_clock()
        for partition, held in list(self._held.items()):
            lease = msgspec.json.encode(Lease(self._worker, self._done_of(partition, held)))
            try:
                held.revision = await self.store.leases.update(
                    f"lease.{partition}", lease, last=held.revision
                )
                held.renewed_s = began_s
            except KeyWrongLastSequenceError:
                self._let_go(partition)

    async def _check_clock(self) -> None:
        """Compare the server's clock with this machine's clock.

        For this, write this worker's entry in the bucket of leases: the server says when it was written.
        """
        key, before_ns = f"worker.{self._worker}", host_ns()
        await self.store.leases.put(key, b"")
        written_ns = (before_ns + host_ns()) // 2
        offset_ns = await self.store.clock_ns(key) - written_ns
        if abs(offset_ns - self.unix_offset_ns) > STEADY_NS:
            self.unix_offset_ns = offset_ns
        self._reports.clock(offset_ns - unix_offset_ns())

    def _done_of(self, partition: int, held: Held) -> int:
        """Return the number of the partition's last message that this or an earlier worker has processed."""
        return max(held.before, self.done.get(partition, 0))

    async def share_out(self) -> bool:
        """Give back partitions that failed or are beyond this worker's share; take free ones up to its share.

        Returns:
            False if no partition may be taken yet, since an outage has just ended.
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
        self._sightings.check(entries, now_s)
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
        """Take a partition's lease, load its snapshots, and receive messages from the oldest snapshot on."""
        began_s = time.monotonic()
        lease = msgspec.json.encode(Lease(self._worker, before.done))
        try:
            new = await self.store.leases.update(f"lease.{partition}", lease, last=revision or 0)
        except KeyWrongLastSequenceError:  # another worker has taken the lease first
            return
        held = self._held[partition] = Held(new, began_s, before.done)
        kept, unreadable = await self.store.devices_of(partition)
        held.revision = await self.store.leases.update(f"lease.{partition}", lease, last=held.revision)
        held.renewed_s = time.monotonic()
        marks = [one.mark for one in kept.values()]
        first, last = await self.store.ends()
        start = (min(marks) if marks else before.done) + 1
        if start > last + 1:  # the stream was deleted and made anew after the snapshots had been stored
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
        """Receive again all messages after the last processed one.

        This is done if the lease was renewed too late, but no other worker had taken it.
        """
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
        """Give all partitions back at the end of the program."""
        for partition in list(self._held):
            await self._give_back(partition)
        await self.store.leases.delete(f"worker.{self._worker}")

    def let_go_of_all(self) -> None:
        """Stop serving all partitions, since the connection has ended."""
        self._background.end()
        for partition in list(self._held):
            self._let_go(partition)

    def _let_go(self, partition: int) -> None:
        """Stop serving a partition."""
        held = self._held.pop(partition)
        if held.task is not None:
            held.task.cancel()
        self._inbox.post(Left(partition))


async def _pull(
    store: Store, inbox: Inbox, partition: int, start: int, unix_offset_ns: Callable[[], int]
) -> None:
    """Put all messages of a partition from number `start` on into the inbox.

    If a request takes too long, the library gives it up, and messages that were on their way may be lost.
    This shows as a gap in the message numbers. Then all messages from the gap on are requested again.
    `unix_offset_ns`: function that returns the present offset from `host_ns` to the server's Unix time.
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
                whole = silent % WHOLE_EVERY != 0 or await store.has_consumer(partition)
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
