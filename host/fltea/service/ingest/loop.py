"""Process the messages of many devices that publish to one broker, in one thread."""

import time
from collections.abc import Callable, Iterator, Sequence

import msgspec

from fltea.records.clock import host_ns
from fltea.records.events import Chunk, Reads
from fltea.records.ports import Report
from fltea.records.repeat import OnceAMinute
from fltea.service.hub import Hub
from fltea.service.ingest.devices import Devices
from fltea.service.ingest.inbox import Inbox, Left, Message, Resumed, Served
from fltea.service.ingest.kept import Kept
from fltea.service.ingest.losses import Losses
from fltea.service.ingest.progress import Progress
from fltea.service.ingest.receiver import Receiver
from fltea.service.ingest.snapshots import Snapshots
from fltea.service.pressure import CHECK_NS, Pressure
from fltea.settings.config import Config
from fltea.stream.fit_worker import FitWorker

STILL_NS = 5 * 10**9
"""If the program stood still for longer than this [ns], for example because the machine slept, no device
counts as silent during that time.
"""

BACK_NS = 15 * 10**9
"""After an outage of the broker, devices have this time to connect again before they can count as silent
[ns].
"""

WAIT_S, SLICE_S = 0.25, 0.1

HELD_S = 10.0
"""If outputs can take no more data for this long, that is reported [s]. The program waits without a limit
until they can.
"""

DRAIN_S = 0.3
"""At the end of the program, messages that have already arrived are processed for this long [s]. Those that
remain count as lost.
"""

PIECE_BYTES = 1 << 16
"""At most this number of bytes of a device are processed at a time. Before each such piece, the
program waits until the outputs have room. They then have room for all records of a piece.
"""


class Hearing:
    """Knows whether messages of devices can arrive. While none can, no device counts as silent."""

    def __init__(self) -> None:
        self.checked_ns = host_ns()
        self._deaf_until_ns = 0

    def check(self, connected: bool, now_ns: int) -> bool:
        """Return whether devices from which nothing came may count as silent now.

        They may not while the broker cannot be reached or the inbox is full, for `BACK_NS` after that, or if
        the program has stood still since the last call.
        """
        if not connected:
            self._deaf_until_ns = now_ns + BACK_NS
        elif now_ns - self.checked_ns > STILL_NS:
            self._deaf_until_ns = max(now_ns, self._deaf_until_ns)
        self.checked_ns = now_ns
        return now_ns > self._deaf_until_ns


class Pace:
    """Knows whether outputs have room, and whether this machine is fast enough for the messages.

    Messages that arrived while the outputs had no room had to wait for the outputs. So the time for which
    they waited says nothing about this machine.
    """

    def __init__(self, hub: Hub, fit_worker: FitWorker, report: Report, url: str) -> None:
        self._hub, self._report, self._url = hub, report, url
        self._pressure = Pressure(fit_worker, report)
        self._held_ns = 0
        self._once_a_minute = OnceAMinute()

    def has_room(self) -> bool:
        """Return whether the outputs have room. If they have none, wait for it for a short time."""
        if self._hub.wait_for_room(SLICE_S):
            return True
        self._held_ns = host_ns()
        return False

    def report_full(self) -> None:
        """Report the outputs that can take no more data at the moment."""
        if self._once_a_minute.is_due("output_slow", host_ns()):
            slow = ", ".join(sorted(self._hub.full()))
            text = f"{slow} takes no more data at the moment, so {self._url} has to keep the messages."
            self._report("output_slow", text)

    def waited(self, arrived_ns: int, waited_ns: int) -> None:
        """Note how long a message waited. `arrived_ns`: time at which the message arrived."""
        if arrived_ns > self._held_ns:
            self._pressure.waited(waited_ns)

    def check(self, now_ns: int) -> None:
        """Make refits rarer if the machine is too slow, and report it."""
        self._pressure.check(now_ns)


class Ingest:
    """Processes the messages of all devices that publish to one broker.

    `config`: settings of every device. The topics of this program contain `config.name`, so no device may
    have this name. `receiver`: function that makes the receiver, which fills the inbox. `on_end`: function
    that is called at the end, with the exception that ended the loop, or with None.
    `fit_worker`: thread that refits the noise of all devices.
    """

    def __init__(
        self,
        config: Config,
        hub: Hub,
        receiver: Callable[[Inbox, Report], Receiver],
        on_end: Callable[["Ingest", Exception | None], None],
        fit_worker: FitWorker,
    ) -> None:
        self.name = config.name or ""
        self.moved_s = time.monotonic()
        self._on_end, self._report = on_end, hub.report()
        limits = config.ingest
        self.inbox = Inbox(limits.devices, int(limits.queue_mb * 1e6), self.name)
        self._receiver = receiver(self.inbox, self._report)
        shared, url = self._receiver.partitions, self._receiver.url
        self.devices = Devices(
            config, hub, self.inbox, url, self._report, shared, fit_worker, self._wait_for_room
        )
        snapshots = (
            None if shared is None else Snapshots(shared, limits.snapshot_s, self._report, hub.written)
        )
        self.progress = Progress(shared, snapshots)
        self.hearing = Hearing()
        self._pace = Pace(hub, fit_worker, self._report, url)
        self._losses = Losses(self.inbox, url)
        self._ends_s: float | None = None

    def run(self) -> None:
        """Process messages until `close` is called."""
        try:
            self._receiver.start()
            while self._ends_s is None:
                self.take_all(WAIT_S)
                now_ns = host_ns()
                self.moved_s = time.monotonic()
                if now_ns - self.hearing.checked_ns >= CHECK_NS:
                    self.check(now_ns)
            # if the broker has partitions, another worker processes the messages that still wait
            if self.progress.shared is None:
                self._drain()
            # report a last time, since messages may have been refused since the last report
            self._report_losses(host_ns())
            for device in self.devices.opened.values():
                device.stream.finish()
        except Exception as error:
            self._on_end(self, error)
            raise
        self._on_end(self, None)

    def close(self) -> None:
        """End the loop, from another thread."""
        self._ends_s = time.monotonic() + DRAIN_S
        self.inbox.wake()
        self._receiver.close()

    def take_all(self, timeout_s: float) -> None:
        """Process the messages in the inbox. All messages of one device are processed together.

        If the inbox is empty, wait at most `timeout_s` for a message.
        """
        messages, behind = self.inbox.take(timeout_s)
        now_ns = host_ns()
        if now_ns - self.hearing.checked_ns > STILL_NS:  # before the messages, which the stall has delayed
            self.check(now_ns)
        groups: dict[str, list[Message]] = {}
        for message in messages:
            if self._is_due(message):
                groups.setdefault(message.device, []).append(message)
        self._walk(groups)
        if self.progress.snapshots is not None:
            self.progress.snapshots.store(self.devices.opened)
        if behind is not None:
            self._on_partition(behind)

    def _drain(self) -> None:
        """Process messages that have already arrived, for at most `DRAIN_S` after `close` was called.

        Messages that then still wait count as lost.
        """
        while self.inbox.has_messages and not self._is_over():
            self.take_all(0)
        if left := self.inbox.end():
            text = f"{left} bytes had arrived and were not processed when the program ended."
            self._report("frames_overflow", f"{self._receiver.url}: {text}")

    def _is_over(self) -> bool:
        return self._ends_s is not None and time.monotonic() >= self._ends_s

    def _wait_for_room(self) -> None:
        """Wait until the outputs have room. During this time, new messages wait in the broker."""
        began_s = time.monotonic()
        while not self._is_over() and not self._pace.has_room():
            self.moved_s = time.monotonic()
            if self.moved_s - began_s >= HELD_S:
                self._pace.report_full()

    def check(self, now_ns: int) -> None:
        """Do the regular work, about once a second.

        The regular work is to check for silent devices, to take snapshots, to check that the machine is fast
        enough, and to report losses.
        """
        opened, progress = self.devices.opened, self.progress
        if not self.hearing.check(self._receiver.connected and self.inbox.wait_for_room(0), now_ns):
            for device in opened.values():
                device.heard_ns = device.checked_ns = now_ns
                device.source.forgive(now_ns)
        self.devices.check(
            now_ns,
            # A device is not silent while messages of its partition may still wait in the stream.
            lambda device: (
                device.partition is None or not progress.catching_up.is_behind(device.partition, now_ns)
            ),
        )
        if progress.snapshots is not None:
            progress.snapshots.keep_due(opened, progress.walked, now_ns)
        self._pace.check(now_ns)
        self._report_losses(now_ns)

    def _report_losses(self, now_ns: int) -> None:
        for trouble in self._losses.check(now_ns):
            self._report(trouble.kind, trouble.message)

    def _is_due(self, message: Message) -> bool:
        """Return whether this worker serves a message's partition, and has not processed the message yet."""
        name, _, arrived_ns, partition, mark = message
        now_ns, progress = host_ns(), self.progress
        waited_ns = now_ns - arrived_ns
        if partition is None or progress.catching_up.shows_pressure(partition, waited_ns, now_ns):
            self._pace.waited(arrived_ns, waited_ns)
        if partition is None:
            return True
        device = self.devices.opened.get(name)
        if not progress.serves(partition):
            return False
        if device is not None and (mark <= device.mark or device.partition != partition):
            return False
        if again := progress.catching_up.walked_again(partition, mark):
            text = (
                f"partition {partition} has caught up: {again} messages were processed a second time, so "
                "their estimates and fits may have been published twice."
            )
            self._report("partition_caught_up", text)
        return True

    def _walk(self, groups: dict[str, list[Message]]) -> None:
        """Process messages, which are grouped by device.

        Then note for each partition the number of the last processed message. If messages of a partition were
        left out, nothing is noted for it, so that the broker delivers them again.
        """
        progress = self.progress
        done: dict[int, int] = {}
        for name, messages in groups.items():
            partition = messages[0].partition
            self.moved_s = time.monotonic()
            if self._is_over():
                self.inbox.put_back(messages)
                progress.leave_out(partition)
            elif partition is None:
                self._walk_device(name, messages)
            elif progress.serves(partition):
                self._walk_device(name, messages)
                done[partition] = max(done.get(partition, 0), messages[-1].mark)
        progress.note(done)

    def _walk_device(self, name: str, messages: Sequence[Message]) -> None:
        devices, first, last = self.devices, messages[0], messages[-1]
        now_ns, offset_ns = host_ns(), devices.offset_ns()
        device = devices.opened.get(name)
        if device is None:
            if devices.is_broken(name, now_ns):
                return
            device = devices.open(name, first.arrived_ns, first.partition)
            if self.progress.snapshots is not None:
                self.progress.snapshots.keep(name, device, Kept(first.mark - 1, first.arrived_ns + offset_ns))
        device.heard_ns = device.checked_ns = now_ns
        device.mark = last.mark
        for piece in _pieces(messages, offset_ns):
            # if an earlier piece has made the device stream fail, the device is no longer open
            if devices.opened.get(name) is device:
                devices.feed(name, piece)

    def _on_partition(self, item: Served | Resumed | Left) -> None:
        """Begin, resume or stop serving a partition."""
        progress, devices = self.progress, self.devices
        if isinstance(item, Resumed):
            progress.resume(item.partition)
            return
        for name, device in list(devices.opened.items()):
            if device.partition == item.partition:
                # the device's last record `stats` counts what this worker has processed
                devices.finish(name, moved=True)
        progress.forget(item.partition)
        if isinstance(item, Left):
            return
        progress.begin(item)
        for name, kept in item.kept.items():
            self.inbox.admission.admit(name)
            now_ns, arrived_ns = host_ns(), kept.unix_ns - devices.offset_ns()
            device = devices.open(name, arrived_ns, item.partition, kept.state)
            device.heard_ns = device.checked_ns = now_ns
            device.mark, device.kept_ns, device.is_whole = kept.mark, now_ns, kept.state is not None
            if kept.hello is not None:
                device.stream.take(msgspec.structs.replace(kept.hello, host_ns=arrived_ns))


def _pieces(messages: Sequence[Message], offset_ns: int) -> Iterator[Reads]:
    """Yield the bytes of a device's messages in pieces of at most `PIECE_BYTES`.

    Each piece is a `Reads`, like the bytes that are read from a serial port.
    """
    chunks: list[Chunk] = []
    size, now_ns = 0, messages[0].arrived_ns
    for message in messages:
        # arrival times must not decrease, but the clock of the broker's stream may have been set back
        now_ns = max(now_ns, message.arrived_ns)
        for begin in range(0, max(1, len(message.data)), PIECE_BYTES):
            data = message.data[begin : begin + PIECE_BYTES]
            if chunks and size + len(data) > PIECE_BYTES:
                yield Reads.of(*chunks)
                chunks, size = [], 0
            chunks.append(Chunk(data, now_ns, offset_ns))
            size += len(data)
    yield Reads.of(*chunks)
