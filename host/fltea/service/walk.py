"""The way of one device's samples, from its source to the outputs."""

import math
import time
from typing import TypeGuard

from fltea.records import clock
from fltea.records.block import Block
from fltea.records.events import Event, Trouble, host_ns_of
from fltea.records.ports import Source
from fltea.records.records import AnyRecord, Error, Hello
from fltea.service.hub import Hub
from fltea.service.state import StateFile
from fltea.settings.config import Config
from fltea.sources.as_wire import AsWire
from fltea.sources.frames import FramesSource
from fltea.sources.serial import SerialSource
from fltea.stream.beside import Beside
from fltea.stream.pipeline import Pipeline
from fltea.stream.snapshot import DeviceState


class Walk:
    """Moves everything from a source through its pipeline to the outputs, in whatever thread calls it.

    failure: the trouble that ends it under `--once`. moved_s: when it last moved, monotonic; infinity once it
    has ended.
    """

    def __init__(
        self,
        source: Source,
        config: Config,
        hub: Hub,
        state: StateFile | None,
        beside: Beside | None = None,
        number: int = 0,
        stats_s: int = 1,
        saved: DeviceState | None = None,
    ) -> None:
        self.source = source
        self.name = config.name or ""
        self.failure: Trouble | Error | None = None
        self.moved_s = time.monotonic()
        self._once, self._hub, self._state = config.once, hub, state
        self._pipeline = Pipeline(
            source,
            config,
            lambda: hub.stats(self.name),
            state.found.get(self.name) if state else saved,
            lambda: state.refuse(self.name) if state else None,
            beside,
            number,
            stats_s,
            watched=source.live or hub.is_read(self.name),
        )
        self._tap = hub.tap(self.name, wait=not source.prompt)
        self._as_wire: AsWire | None = None
        self._has_wire = isinstance(source, SerialSource | FramesSource)
        if isinstance(source, SerialSource | FramesSource):
            source.tap = self._tap
        self._save_period_ns = int(config.state.period_s * 1e9)
        self._save_ns = clock.host_ns() + self._save_period_ns

    def take(self, event: Event, *, tell: bool = True) -> None:
        """Move one event. tell: as of `Hub.publish`.

        Raises:
            UsageError: the settings do not fit what the source gives, or it cannot be recorded.
        """
        self.moved_s = time.monotonic()
        if not self._has_wire:
            self._make_wire(event)
        if self._once and isinstance(event, Trouble) and event.fatal:
            self.failure = event
        items = list(self._pipeline.feed(event))
        live = self.source.live
        if self._once and live and self.failure is None:
            self.failure = next(filter(_is_vain, items), None)
        if items:
            arrived_ns = host_ns_of(event) if live else None
            wait = not self.source.prompt
            self._hub.publish(self.name, items, arrived_ns, wait=wait, log=self.failure is None, tell=tell)
        if self._state is not None and clock.host_ns() >= self._save_ns:
            self._save_ns = clock.host_ns() + self._save_period_ns
            self._deposit(self._state)

    @property
    def hello(self) -> Hello | None:
        """The newest HELLO of the device."""
        return self._pipeline.hello

    def save(self) -> DeviceState | None:
        """A snapshot of its estimators; None while there is nothing to keep."""
        return self._pipeline.save()

    def finish(self, *, whole: bool = False) -> None:
        """The source has ended (whole), or nothing more is wanted of it."""
        self.moved_s = math.inf
        ended = self._once or not self.source.live  # else somebody waits for the program to end
        last = list(self._pipeline.finish(last_fit=ended, whole=whole))
        self._hub.publish(self.name, last, wait=not self.source.prompt)
        if self._state is not None:
            self._deposit(self._state)

    def _make_wire(self, event: Event) -> None:
        """Let a source without a wire have one while somebody records it."""
        if not self._tap.wanted:
            self._as_wire = None
            return
        if self._as_wire is None:
            self._as_wire = AsWire(lambda: self.source.unix_offset_ns)
        for item in self._as_wire.encode(event):
            self._tap(item)

    def _deposit(self, state: StateFile) -> None:
        snapshot = self._pipeline.save()
        if snapshot is not None:
            state.put(self.name, snapshot)


def _is_vain(record: AnyRecord | Block) -> TypeGuard[Error]:
    """Whether a record says that what was asked for will not come from this device."""
    return isinstance(record, Error) and record.kind == "no_device_estimates"
