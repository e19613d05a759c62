"""Move one device's samples from its source through the pipeline to the outputs."""

import math
import time
from collections.abc import Iterable
from typing import Any, TypeGuard

from fltea._native import Device, RunPrinter
from fltea.records import clock
from fltea.records.block import Block
from fltea.records.events import Event, Ints, Trouble, host_ns_of
from fltea.records.ports import Printed, Source, Wanted
from fltea.records.records import AnyRecord, Epoch, Error, Fit, Hello
from fltea.service.hub import NOTHING_PRINTED, ByText, Hub, Tap
from fltea.service.state import StateFile
from fltea.settings.config import Config
from fltea.sinks.json_lines import run_printer
from fltea.sources.as_wire import AsWire
from fltea.sources.frames import FramesSource
from fltea.sources.serial import SerialSource
from fltea.stream.decode import Rows, Stop
from fltea.stream.fit_worker import FitWorker
from fltea.stream.pipeline import Pipeline
from fltea.stream.snapshot import DeviceState

CHANGES_TEXT = {Stop.EPOCH, Stop.FIT_COUNTS}
"""If the native device (C++) stops for one of these reasons, fields such as the verdict may change. Between
two such stops, these fields have the same values in all records of samples.
"""


class WireCopy:
    """Passes what stands on a source's wire to the outputs that record bytes.

    A source that uses the wire protocol passes its bytes itself. The events of any other source are encoded
    in the wire protocol here.
    """

    def __init__(self, source: Source, tap: Tap) -> None:
        self.tap = tap
        self._source = source
        self._encoder: AsWire | None = None
        self._is_own = isinstance(source, SerialSource | FramesSource)
        if isinstance(source, SerialSource | FramesSource):
            source.tap = tap

    def take(self, event: Event) -> None:
        """Encode an event and pass its bytes on. Do nothing if the source passes its bytes itself."""
        if self._is_own:
            return
        if not self.tap.wanted:
            self._encoder = None
            return
        if self._encoder is None:
            self._encoder = AsWire(lambda: self._source.unix_offset_ns)
        for item in self._encoder.encode(event):
            self.tap(item)


class Saves:
    """Saves a device's snapshot in the file of snapshots, every `period_s`."""

    def __init__(self, file: StateFile, name: str, period_s: float) -> None:
        self.found = file.found.get(name)
        self._file, self._name = file, name
        self._period_ns = int(period_s * 1e9)
        self._due_ns = clock.host_ns() + self._period_ns

    def refuse(self) -> None:
        """Set aside the snapshot that the file had of this device, since an estimator has refused it."""
        self._file.refuse(self._name)

    def is_due(self) -> bool:
        """Return whether a snapshot is due. If so, the next one is due a period later."""
        now_ns = clock.host_ns()
        if now_ns < self._due_ns:
            return False
        self._due_ns = now_ns + self._period_ns
        return True

    def put(self, snapshot: DeviceState | None) -> None:
        """Save a snapshot, if there is one."""
        if snapshot is not None:
            self._file.put(self._name, snapshot)


class DeviceStream:
    """Passes everything from a source through the source's pipeline to the outputs, in the caller's thread.

    `failure`: error that ends the stream, set only with `--once`. `moved_s`: monotonic time at which the last
    event was handled [s]; infinity once the stream has ended.
    """

    def __init__(
        self,
        source: Source,
        config: Config,
        hub: Hub,
        state: StateFile | None,
        fit_worker: FitWorker | None = None,
        number: int = 0,
        stats_s: int = 1,
        saved: DeviceState | None = None,
    ) -> None:
        self.source = source
        self.name = config.name or ""
        self.failure: Trouble | Error | None = None
        self.moved_s = time.monotonic()
        self._once, self._hub = config.once, hub
        self._saves = saves = Saves(state, self.name, config.state.period_s) if state else None
        self._pipeline = Pipeline(
            source,
            config,
            lambda: hub.stats(self.name),
            saves.found if saves else saved,
            lambda: saves.refuse() if saves else None,
            fit_worker,
            number,
            stats_s,
            watched=source.live or hub.is_read(self.name),
        )
        self._wire = WireCopy(source, hub.tap(self.name, wait=not source.prompt))
        self._printers: dict[Wanted | None, RunPrinter] = {}
        self._words: object = None

    def take(self, event: Event) -> None:
        """Handle one event of the source.

        Raises:
            UsageError: the settings do not fit the samples, or the samples cannot be recorded.
        """
        self.moved_s = time.monotonic()
        self._wire.take(event)
        if self._once and isinstance(event, Trouble) and event.fatal:
            self.failure = event
        self._publish(*self._printed(self._pipeline.feed(event)), host_ns_of(event))
        self.check()

    def took(self, arrived_ns: Ints, rows: Rows, *, unprinted: bool) -> None:
        """Publish samples that the native device (C++) has processed.

        `unprinted`: True if outputs take these samples as text, but native code has not made this text.
        """
        found = list(self._pipeline.took(rows, arrived_ns))
        is_printed = not (unprinted or self._pipeline.has_board)
        texts: ByText = dict.fromkeys(self._hub.printing(self.name), ()) if is_printed else NOTHING_PRINTED
        self._publish(found, texts, int(arrived_ns[-1]))
        if unprinted:
            self._print_as(next(one for one in found if isinstance(one, Block)))

    def stopped(self, stop: Stop, now_ns: int, details: Any) -> None:
        """Do what has to be done between two samples, such as the start of a refit.

        For this the native device (C++) has stopped processing samples. `stop`: what has to be done.
        `now_ns`: arrival time of the sample at which the native device stopped [ns].
        """
        self._publish(list(self._pipeline.stopped(stop, now_ns, details)), NOTHING_PRINTED, now_ns)
        if stop in CHANGES_TEXT:
            self._check_words()

    def check(self) -> None:
        """Save a snapshot of the device's estimators if one is due."""
        if self._saves is not None and self._saves.is_due():
            self._saves.put(self._pipeline.save())

    def wants(self) -> tuple[bool, bool, bool]:
        """Return in which forms the outputs take the device's samples, as three flags.

        The flags are for blocks, for lines of text, and for the bytes of the wire.
        """
        has_board, texts = self._pipeline.has_board, self._hub.printing(self.name)
        takes_blocks = has_board or self._hub.takes_blocks(self.name)
        return takes_blocks, bool(texts) and not has_board, self._wire.tap.wanted

    @property
    def device(self) -> Device:
        """The native device (C++) that processes the samples."""
        return self._pipeline.device

    def _printed(self, items: Iterable[AnyRecord | Block]) -> tuple[list[AnyRecord | Block], ByText]:
        """Return `items` as a list, and copies of this list in which text replaces the blocks of samples.

        There is one copy for each kind of text that an output takes.
        """
        texts = () if self._pipeline.has_board else self._hub.printing(self.name)
        found: list[AnyRecord | Block] = []
        printed: dict[Wanted | None, list[AnyRecord | Block | Printed]] = {text: [] for text in texts}
        for item in items:
            found.append(item)
            if not printed:
                continue
            if not isinstance(item, Block):
                for own in printed.values():
                    own.append(item)
                if isinstance(item, Epoch | Fit):
                    self._check_words()
                continue
            missed = 0
            for text, own in printed.items():
                lines, missed = self._lines_of(item, text)
                own += lines
            if missed:
                self._print_as(item)
        return found, printed

    def _lines_of(self, block: Block, text: Wanted | None) -> tuple[list[Block | Printed], int]:
        """Return a list with the text of a block, and the number of rows that have no text.

        Native code has made the text. If it made none for the last rows, they follow in the list as a block.
        """
        printer = self._printers.get(text)
        if printer is None:
            return [block], len(block)
        data, records, missed = printer.take()
        lines: list[Block | Printed] = [Printed(data, records)] if records else []
        return lines + ([block.rows(len(block) - missed, len(block))] if missed else []), missed

    def _print_as(self, block: Block) -> None:
        """Let the native device (C++) convert later samples to text.

        Fields that are equal for all samples, such as the verdict, have in this text the same values as in
        `block`.
        """
        self._printers = {text: run_printer(block, text) for text in self._hub.printing(self.name)}
        self.device.set_printers(list(self._printers.values()))

    def _check_words(self) -> None:
        """Stop native code from converting samples to text if a field that all samples share has changed."""
        if (words := self._pipeline.words) != self._words:
            self._words = words
            self._printers = {}
            self.device.set_printers([])

    def _publish(self, found: list[AnyRecord | Block], printed: ByText, arrived_ns: int | None) -> None:
        live = self.source.live
        if self._once and live and self.failure is None:
            self.failure = next(filter(_is_vain, found), None)
        if found:
            wait, log = not self.source.prompt, self.failure is None
            at_ns = arrived_ns if live else None
            self._hub.publish(self.name, found, at_ns, wait=wait, log=log, printed=printed)

    @property
    def hello(self) -> Hello | None:
        """The newest HELLO of the device."""
        return self._pipeline.hello

    def save(self) -> DeviceState | None:
        """Return a snapshot of the device's estimators; None as long as there is nothing to save."""
        return self._pipeline.save()

    def finish(self, *, whole: bool = False, now_ns: int = 0) -> None:
        """End the stream.

        `whole`: whether the source has ended by itself. Only then were all its samples used.
        `now_ns`: arrival time of the newest sample that native code has processed [ns]; 0 if there is none.
        """
        self.moved_s = math.inf
        self._pipeline.came_to(now_ns)
        # if a user ends a live source, the last fit of all samples is not made, since the user would have to
        # wait for it
        ended = self._once or not self.source.live
        last = list(self._pipeline.finish(last_fit=ended, whole=whole))
        self._hub.publish(self.name, last, wait=not self.source.prompt)
        if self._saves is not None:
            self._saves.put(self._pipeline.save())


def _is_vain(record: AnyRecord | Block) -> TypeGuard[Error]:
    """Return whether a record says that this device cannot deliver the estimates that the user wants."""
    return isinstance(record, Error) and record.kind == "no_device_estimates"
