"""Many devices behind one broker: each becomes a line with a walk of its own, all walked by one thread."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, cast

import msgspec

from fltea.records.clock import host_ns, unix_offset_ns
from fltea.records.events import Chunk
from fltea.records.ports import Report
from fltea.records.repeat import OnceAMinute
from fltea.service.hub import Hub
from fltea.service.ingest.catching_up import CatchingUp
from fltea.service.ingest.inbox import Inbox, Left, Message, Resumed, Served
from fltea.service.ingest.kept import Kept, pack
from fltea.service.ingest.losses import Losses
from fltea.service.ingest.pressure import Pressure
from fltea.service.walk import Walk
from fltea.settings.config import Config
from fltea.settings.ingest import is_partitioned
from fltea.sources.frames import FramesSource
from fltea.stream.fit_times import FitLoad
from fltea.stream.snapshot import DeviceState

TICK_NS = 2 * 10**9
"""A device that has sent nothing for this long is looked at, and then as often: it may be silent."""

LOOK_NS = 10**9
STILL_NS = 5 * 10**9
"""A program that did not look for longer stood still: nobody is taken for silent in that time."""

BACK_NS = 15 * 10**9
"""Boards get so long to find a broker that is back."""

WAIT_S = 0.25
FIRST_NS = 2 * 10**9
"""The first snapshot of a device is tried for so often, until the start-up window is full."""

EASE_S, EASE_AGAIN_NS = 1.0, 10 * 10**9
"""What waited for us comes faster than outputs write, so they are waited for. One that does not catch up is
slow by itself: it loses its own records, and is waited for again after a while."""

STATS_S = 10
"""Seconds from one statistics of a device to the next: each second a tenth of the devices has its turn."""

FAULT_NS = 60 * 10**9
"""A device whose line broke, by a fault of ours or by settings that do not fit it, is tried again then."""


class Receiver(Protocol):
    """Who puts messages into the inbox."""

    url: str

    @property
    def connected(self) -> bool:
        """Whether messages can come now."""

    def start(self) -> None:
        """Begin to receive."""

    def close(self) -> None:
        """Receive no more."""


class SharedReceiver(Receiver, Protocol):
    """One of several, each of which serves some partitions of the devices; it keeps their snapshots.

    done: the last message of each partition that was walked. unix_offset_ns: what to add to `host_ns` for the
    time of the stream, which is the same for all workers, whatever their own clocks say.
    """

    done: dict[int, int]
    unix_offset_ns: int

    def serves(self, partition: int) -> bool:
        """Whether messages of a partition may still be walked here."""

    def resume(self, partition: int) -> None:
        """Take note that the messages come again that were left out while `serves` was false."""

    def walked(self, partition: int, mark: int) -> None:
        """Take note of the last message that was walked."""

    def keep(self, partition: int, device: str, data: bytes) -> bool:
        """Store a snapshot, in the background; False if there is no room for it now."""

    def drop(self, partition: int, device: str) -> None:
        """Delete the snapshot of a device that is given up, in the background."""


@dataclass
class _Line:
    """A device. partition, mark: of the last message that it walked, where there are partitions.

    kept_ns: when its last snapshot was taken; is_whole: it had the estimators.
    """

    walk: Walk
    source: FramesSource
    heard_ns: int
    looked_ns: int
    partition: int | None = None
    mark: int = 0
    kept_ns: int = 0
    is_whole: bool = False


class _Hearing:
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
    on_end: called with the exception that ended all, or with None.
    """

    def __init__(
        self,
        config: Config,
        hub: Hub,
        receiver: Callable[[Inbox, Report], Receiver],
        on_end: Callable[["Ingest", Exception | None], None],
    ) -> None:
        self.name = config.name or ""
        self.moved_s = time.monotonic()
        self._config, self._hub, self._on_end = config, hub, on_end
        self._report = hub.report()
        limits = config.ingest
        self.inbox = Inbox(limits.devices, int(limits.queue_mb * 1e6), self.name)
        self._receiver = receiver(self.inbox, self._report)
        self._shared: SharedReceiver | None = None
        if is_partitioned(config.source):
            self._shared = cast(SharedReceiver, self._receiver)
        self._catching_up = CatchingUp()
        self._lines: dict[str, _Line] = {}
        self._broken_ns: dict[str, int] = {}
        self._load = FitLoad()
        self._pressure = Pressure(self._load)
        self._opened = 0
        self._once_a_minute = OnceAMinute()
        self._losses = Losses(self.inbox, self._receiver.url)
        self._hearing = _Hearing()
        self._eases_ns = 0
        self._closed = False

    @property
    def devices(self) -> int:
        """How many have a line now."""
        return len(self._lines)

    def run(self) -> None:
        """Walk until `close`."""
        try:
            self._receiver.start()
            while not self._closed:
                for item in self.inbox.take(WAIT_S):
                    if isinstance(item, Message):
                        self._take(item)
                    else:
                        self._on_partition(item)
                now_ns = host_ns()
                self.moved_s = time.monotonic()
                if now_ns - self._hearing.looked_ns >= LOOK_NS:
                    self._look(now_ns)
            for line in self._lines.values():
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

    def _take(self, message: Message) -> None:
        name, data, arrived_ns, partition, mark = message
        now_ns = host_ns()
        waited_ns = now_ns - arrived_ns
        if partition is None or self._catching_up.shows_pressure(partition, waited_ns, now_ns):
            self._pressure.waited(waited_ns)
        line = self._lines.get(name)
        if partition is not None and not self._may_walk(partition, mark, line):
            return
        if line is None:
            if now_ns < self._broken_ns.get(name, 0):
                return
            line = self._open(name, arrived_ns, partition)
            if partition is not None:
                self._keep(name, line, Kept(mark - 1, arrived_ns + self._offset_ns()))
        line.heard_ns = line.looked_ns = now_ns
        line.mark = mark
        self._walk(name, line, Chunk(data, arrived_ns, self._offset_ns()))
        if now_ns >= self._eases_ns and not self._hub.wait_for_room(EASE_S):
            self._eases_ns = host_ns() + EASE_AGAIN_NS
        if partition is not None and self._shared is not None:
            self._shared.walked(partition, mark)

    def _offset_ns(self) -> int:
        """From `host_ns` to Unix time: of the stream if there is one."""
        return self._shared.unix_offset_ns if self._shared is not None else unix_offset_ns()

    def _may_walk(self, partition: int, mark: int, line: _Line | None) -> bool:
        """Whether this message is ours, and news to its device."""
        if self._shared is None or not self._shared.serves(partition):
            return False
        if line is not None and (mark <= line.mark or line.partition != partition):
            return False
        if again := self._catching_up.walked_again(partition, mark):
            text = (
                f"partition {partition} is where it was left: {again} messages were walked again, whose "
                "estimates and fits may have been published before."
            )
            self._report("partition_caught_up", text)
        return True

    def _on_partition(self, item: Served | Resumed | Left) -> None:
        """Go on with a partition's devices where another left them or we did, or let go of them."""
        assert self._shared is not None
        if isinstance(item, Resumed):
            self._shared.resume(item.partition)
            return
        self._catching_up.forget(item.partition)
        for name, line in list(self._lines.items()):
            if line.partition == item.partition:
                line.walk.finish()  # its last statistics: what was walked here is counted
                self._give_up(name, moved=True)
        if isinstance(item, Left):
            return
        self._shared.walked(item.partition, item.start)
        self._catching_up.begin(item.partition, item.done)
        for name, kept in item.kept.items():
            now_ns = host_ns()
            line = self._open(name, kept.unix_ns - self._offset_ns(), item.partition, kept.state)
            line.heard_ns = line.looked_ns = now_ns
            line.mark, line.kept_ns, line.is_whole = kept.mark, now_ns, kept.state is not None
            if kept.hello is not None:
                line.walk.take(msgspec.structs.replace(kept.hello, host_ns=kept.unix_ns - self._offset_ns()))

    def _open(
        self, name: str, now_ns: int, partition: int | None = None, saved: DeviceState | None = None
    ) -> _Line:
        url = f"{self._receiver.url}/{name}"
        source = FramesSource(url, lambda: self.inbox.overflow_bytes[name])
        config = msgspec.structs.replace(self._config, name=name, source=url)
        walk = Walk(source, config, self._hub, None, self._load, self._opened, STATS_S, saved)
        self._opened += 1
        line = self._lines[name] = _Line(walk, source, now_ns, now_ns, partition)
        self._load.devices = len(self._lines)
        for event in source.open(now_ns, self._offset_ns()):
            walk.take(event)
        return line

    def _keep_snapshots(self, now_ns: int) -> None:
        """Of the devices whose turn it is; one that is silent has come as far as its partition."""
        period_ns = int(self._config.ingest.snapshot_s * 1e9)
        for name, line in self._lines.items():
            young = now_ns - line.kept_ns
            if line.partition is None or young < (period_ns if line.is_whole else FIRST_NS):
                continue
            state = line.walk.save()
            if state is None and young < period_ns:
                continue  # the start-up window fills: who takes over begins with its first message
            line.is_whole = True
            kept = Kept(
                max(line.mark, self._done(line)), host_ns() + self._offset_ns(), line.walk.hello, state
            )
            if not self._keep(name, line, kept):
                return

    def _done(self, line: _Line) -> int:
        """The last message of its partition: those of this device up to it have been walked."""
        assert self._shared is not None
        assert line.partition is not None
        return self._shared.done.get(line.partition, 0) if self._shared.serves(line.partition) else 0

    def _keep(self, name: str, line: _Line, kept: Kept) -> bool:
        assert self._shared is not None
        assert line.partition is not None
        data = pack(kept)
        if data is None:
            if self._once_a_minute.is_due("too_large", host_ns()):
                text = f"{name}: its snapshot is too large for the store: a shorter window makes it smaller."
                self._report("snapshot_failed", text)
            return True
        stored = self._shared.keep(line.partition, name, data)
        if stored:
            line.kept_ns = host_ns()
        return stored

    def _walk(self, name: str, line: _Line, item: Chunk | None) -> None:
        try:
            for event in line.source.take(item):
                line.walk.take(event)
        except Exception as error:  # of one device: the others go on
            self._broken_ns[name] = host_ns() + FAULT_NS
            self._give_up(name)
            if self._once_a_minute.is_due("line_broken", host_ns()):
                text = f"{name}: nothing more is made of it for a minute: {type(error).__name__}: {error}"
                self._report("line_broken", text)

    def _give_up(self, name: str, *, moved: bool = False) -> None:
        line = self._lines.pop(name)
        if not moved and line.partition is not None and self._shared is not None:
            self._shared.drop(line.partition, name)  # else who takes over goes back to where it was then
        self._hub.depart(name, moved=moved)
        self._load.devices = max(1, len(self._lines))
        self.inbox.forget(name)

    def _look(self, now_ns: int) -> None:
        """What has to be done now and then."""
        if not self._hearing.look(self._receiver.connected, now_ns):
            for line in self._lines.values():
                line.heard_ns = line.looked_ns = now_ns
                line.source.forgive(now_ns)
        forget_ns = int(self._config.ingest.forget_s * 1e9)
        for name, line in list(self._lines.items()):
            if now_ns - line.looked_ns < TICK_NS:
                continue
            if now_ns - line.heard_ns >= forget_ns:
                line.walk.finish()
                self._give_up(name)
                continue
            if line.partition is not None and self._catching_up.is_behind(line.partition, now_ns):
                continue  # what it has sent meanwhile still waits in the stream
            line.looked_ns = now_ns
            self._walk(name, line, None)
        self._broken_ns = {name: ns for name, ns in self._broken_ns.items() if ns > now_ns}
        if self._shared is not None:
            self._keep_snapshots(now_ns)
        if slowed := self._pressure.look(now_ns):
            self._report(slowed.kind, slowed.message)
        for trouble in self._losses.look(now_ns):
            self._report(trouble.kind, trouble.message)
