"""Many devices behind one broker: each becomes a line with a walk of its own, all walked by one thread."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import msgspec

from fltea.records.clock import host_ns, unix_offset_ns
from fltea.records.events import Chunk
from fltea.records.ports import Report
from fltea.records.repeat import OnceAMinute
from fltea.service.hub import Hub
from fltea.service.ingest.inbox import Inbox, Message
from fltea.service.ingest.losses import Losses
from fltea.service.ingest.pressure import Pressure
from fltea.service.walk import Walk
from fltea.settings.config import Config
from fltea.sources.frames import FramesSource
from fltea.stream.fit_times import FitLoad

TICK_NS = 2 * 10**9
"""A device that has said nothing for so long is looked at, and then as often: it may be silent."""

LOOK_NS = 10**9
WAIT_S = 0.25
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


@dataclass
class _Line:
    walk: Walk
    source: FramesSource
    heard_ns: int
    looked_ns: int


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
        self._lines: dict[str, _Line] = {}
        self._broken_ns: dict[str, int] = {}
        self._load = FitLoad()
        self._pressure = Pressure(self._load)
        self._opened = 0
        self._told = OnceAMinute()
        self._losses = Losses(self.inbox, self._receiver.url)
        self._looked_ns = host_ns()
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
                for message in self.inbox.take(WAIT_S):
                    self._take(message)
                now_ns = host_ns()
                self.moved_s = time.monotonic()
                if now_ns - self._looked_ns >= LOOK_NS:
                    self._looked_ns = now_ns
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
        name, data, arrived_ns = message
        self._pressure.waited(host_ns() - arrived_ns)
        line = self._lines.get(name)
        if line is None:
            if arrived_ns < self._broken_ns.get(name, 0):
                return
            line = self._open(name, arrived_ns)
        line.heard_ns = line.looked_ns = arrived_ns
        self._walk(name, line, Chunk(data, arrived_ns, unix_offset_ns()))

    def _open(self, name: str, now_ns: int) -> _Line:
        url = f"{self._receiver.url}/{name}"
        source = FramesSource(url, lambda: self.inbox.overflow_bytes[name])
        config = msgspec.structs.replace(self._config, name=name, source=url)
        walk = Walk(source, config, self._hub, None, self._load, self._opened, STATS_S)
        self._opened += 1
        line = self._lines[name] = _Line(walk, source, now_ns, now_ns)
        self._load.devices = len(self._lines)
        for event in source.open(now_ns, unix_offset_ns()):
            walk.take(event)
        return line

    def _walk(self, name: str, line: _Line, item: Chunk | None) -> None:
        try:
            for event in line.source.take(item):
                line.walk.take(event)
        except Exception as error:  # of one device: the others go on
            self._broken_ns[name] = host_ns() + FAULT_NS
            self._give_up(name)
            if self._told.is_due("line_broken", host_ns()):
                text = f"{name}: nothing more is made of it for a minute: {type(error).__name__}: {error}"
                self._report("line_broken", text)

    def _give_up(self, name: str) -> None:
        del self._lines[name]
        self._load.devices = max(1, len(self._lines))
        self.inbox.forget(name)

    def _look(self, now_ns: int) -> None:
        """What has to be done now and then."""
        forget_ns = int(self._config.ingest.forget_s * 1e9)
        for name, line in list(self._lines.items()):
            if now_ns - line.looked_ns < TICK_NS:
                continue
            if now_ns - line.heard_ns >= forget_ns:
                line.walk.finish()
                self._give_up(name)
            elif self._receiver.connected:  # else nobody could be heard, and the reason is told
                line.looked_ns = now_ns
                self._walk(name, line, None)
        self._broken_ns = {name: ns for name, ns in self._broken_ns.items() if ns > now_ns}
        if slowed := self._pressure.look(now_ns):
            self._report(slowed.kind, slowed.message)
        for told in self._losses.look(now_ns):
            self._report(told.kind, told.message)
