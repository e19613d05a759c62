"""Many devices behind one broker: each becomes a line with a walk of its own, all walked by one thread."""

import time
from collections.abc import Callable

import msgspec

from fltea.records.clock import host_ns
from fltea.records.events import Chunk
from fltea.records.ports import Report
from fltea.service.hub import Hub
from fltea.service.ingest.catching_up import CatchingUp
from fltea.service.ingest.devices import Devices, Line
from fltea.service.ingest.inbox import Inbox, Left, Message, Resumed, Served
from fltea.service.ingest.kept import Kept
from fltea.service.ingest.losses import Losses
from fltea.service.ingest.pressure import Pressure
from fltea.service.ingest.receiver import Receiver
from fltea.service.ingest.snapshots import Snapshots
from fltea.settings.config import Config
from fltea.stream.beside import Beside

LOOK_NS = 10**9
STILL_NS = 5 * 10**9
"""A program that did not look for longer stood still: nobody is taken for silent in that time."""

BACK_NS = 15 * 10**9
"""Boards get so long to find a broker that is back."""

WAIT_S = 0.25

EASE_S, EASE_AGAIN_NS = 1.0, 10 * 10**9
"""What waited for us comes faster than outputs write, so they are waited for. One that does not catch up is
slow by itself: it loses its own records, and is waited for again after a while."""


class Hearing:
    """Knows since when devices could be heard: while they could not, nobody is silent or forgotten."""

    def __init__(self) -> None:
        self.looked_ns = host_ns()
        self._deaf_until_ns = 0

    def look(self, connected: bool, now_ns: int) -> bool:
        """Return whether devices could be heard since the last look."""
        if not connected:
            self._deaf_until_ns = now_ns + BACK_NS
        elif now_ns - self.looked_ns > STILL_NS:
            self._deaf_until_ns = max(now_ns, self._deaf_until_ns)
        self.looked_ns = now_ns
        return now_ns > self._deaf_until_ns


class Ingest:
    """Walks the messages of all devices, in the order of their arrival.

    config: of every device; its name is the topic's. receiver: makes, out of an inbox, who fills it.
    on_end: called with the exception that ended all, or with None. beside: what all looks share.
    """

    def __init__(
        self,
        config: Config,
        hub: Hub,
        receiver: Callable[[Inbox, Report], Receiver],
        on_end: Callable[["Ingest", Exception | None], None],
        beside: Beside,
    ) -> None:
        self.name = config.name or ""
        self.moved_s = time.monotonic()
        self._hub, self._on_end, self._report = hub, on_end, hub.report()
        limits = config.ingest
        self.inbox = Inbox(limits.devices, int(limits.queue_mb * 1e6), self.name)
        self._receiver = receiver(self.inbox, self._report)
        shared, url = self._receiver.partitions, self._receiver.url
        self.devices = Devices(config, hub, self.inbox, url, self._report, shared, beside)
        self.snapshots = None if shared is None else Snapshots(shared, limits.snapshot_s, self._report)
        self.catching_up = CatchingUp()
        self.hearing = Hearing()
        self._pressure = Pressure(beside)
        self._losses = Losses(self.inbox, url)
        self._eases_ns = 0
        self._closed = False

    def run(self) -> None:
        """Walk until `close`."""
        try:
            self._receiver.start()
            while not self._closed:
                self.take_all(WAIT_S)
                now_ns = host_ns()
                self.moved_s = time.monotonic()
                if now_ns - self.hearing.looked_ns >= LOOK_NS:
                    self.look(now_ns)
            for line in self.devices.lines.values():
                line.walk.finish()
        except Exception as error:
            self._on_end(self, error)
            raise
        self._on_end(self, None)

    def close(self) -> None:
        """End the loop, from another thread."""
        self._closed = True
        self._receiver.close()
        self.inbox.wake()

    def take_all(self, timeout_s: float) -> None:
        """Walk what waits in the inbox, after at most so long."""
        for item in self.inbox.take(timeout_s):
            if isinstance(item, Message):
                self._take(item)
            else:
                self._on_partition(item)

    def look(self, now_ns: int) -> None:
        """Do what has to be done now and then."""
        lines = self.devices.lines
        if not self.hearing.look(self._receiver.connected, now_ns):
            for line in lines.values():
                line.heard_ns = line.looked_ns = now_ns
                line.source.forgive(now_ns)
        self.devices.look(
            now_ns,
            # What a device has sent meanwhile may still wait in the stream.
            lambda line: line.partition is None or not self.catching_up.is_behind(line.partition, now_ns),
        )
        if self.snapshots is not None:
            self.snapshots.keep_due(lines, now_ns)
        if slowed := self._pressure.look(now_ns):
            self._report(slowed.kind, slowed.message)
        for trouble in self._losses.look(now_ns):
            self._report(trouble.kind, trouble.message)

    def _take(self, message: Message) -> None:
        name, data, arrived_ns, partition, mark = message
        now_ns, devices, shared = host_ns(), self.devices, self._receiver.partitions
        waited_ns = now_ns - arrived_ns
        if partition is None or self.catching_up.shows_pressure(partition, waited_ns, now_ns):
            self._pressure.waited(waited_ns)
        line = devices.lines.get(name)
        if partition is not None and not self._may_walk(partition, mark, line):
            return
        if line is None:
            if devices.is_broken(name, now_ns):
                return
            line = devices.open(name, arrived_ns, partition)
            if self.snapshots is not None:
                self.snapshots.keep(name, line, Kept(mark - 1, arrived_ns + devices.offset_ns()))
        line.heard_ns = line.looked_ns = now_ns
        line.mark = mark
        devices.walk(name, Chunk(data, arrived_ns, devices.offset_ns()))
        if now_ns >= self._eases_ns and not self._hub.wait_for_room(EASE_S):
            self._eases_ns = host_ns() + EASE_AGAIN_NS
        if partition is not None and shared is not None:
            shared.walked(partition, mark)

    def _may_walk(self, partition: int, mark: int, line: Line | None) -> bool:
        """Whether this message is ours, and news to its device."""
        shared = self._receiver.partitions
        if shared is None or not shared.serves(partition):
            return False
        if line is not None and (mark <= line.mark or line.partition != partition):
            return False
        if again := self.catching_up.walked_again(partition, mark):
            text = (
                f"partition {partition} is where it was left: {again} messages were walked again, whose "
                "estimates and fits may have been published before."
            )
            self._report("partition_caught_up", text)
        return True

    def _on_partition(self, item: Served | Resumed | Left) -> None:
        """Go on with a partition's devices where another left them or we did, or let go of them."""
        shared, devices = self._receiver.partitions, self.devices
        assert shared is not None
        if isinstance(item, Resumed):
            shared.resume(item.partition)
            return
        self.catching_up.forget(item.partition)
        for name, line in list(devices.lines.items()):
            if line.partition == item.partition:
                devices.finish(name, moved=True)  # what was walked here is counted
        if isinstance(item, Left):
            return
        shared.walked(item.partition, item.start)
        self.catching_up.begin(item.partition, item.done)
        for name, kept in item.kept.items():
            now_ns, arrived_ns = host_ns(), kept.unix_ns - devices.offset_ns()
            line = devices.open(name, arrived_ns, item.partition, kept.state)
            line.heard_ns = line.looked_ns = now_ns
            line.mark, line.kept_ns, line.is_whole = kept.mark, now_ns, kept.state is not None
            if kept.hello is not None:
                line.walk.take(msgspec.structs.replace(kept.hello, host_ns=arrived_ns))
