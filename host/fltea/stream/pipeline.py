"""The stream of one device: convert the events of the device's source into records and blocks of samples.

A source yields events. The native device (`fltea.stream.decode`) processes the samples in these events. It
stops wherever Python has to act, for example at a gap in the samples. `HANDLERS` names the method for each
kind of stop. All results go to the outputs, in the order of the samples. The results do not depend on how
samples were grouped into blocks, nor on how the bytes were read.

The statistics of a device are published at the first event of each new second, and count the events before
that one. With many devices, the seconds of different devices begin at different moments (`fit_times.turn`).
Otherwise the statistics of all devices would be due together, and samples would wait for them.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

import msgspec

from fltea._native import Device, stands_before_sample
from fltea.estimator.lanes import Reason
from fltea.records.block import Block
from fltea.records.events import Event, Ints, LinkDown, RawBlock, Trouble, host_ns_of
from fltea.records.ports import Source
from fltea.records.records import AnyRecord, Epoch, Error, Gap, Hello, Stats
from fltea.records.repeat import OnceAMinute
from fltea.records.sensor_kind import SENSOR_KINDS
from fltea.records.stats import DeviceStatus, OutputStats
from fltea.settings.config import Config
from fltea.settings.estimator import BY_DEVICE
from fltea.stream.board import BoardEstimates
from fltea.stream.channels import explain_lost
from fltea.stream.decode import Decoder, FirstSample, Rows, Stop, explain_rate
from fltea.stream.epoch import Beginning, Item, Moment, Notice, Standing
from fltea.stream.epoch_start import EpochStart
from fltea.stream.fit_worker import FitWorker
from fltea.stream.live import LiveFits
from fltea.stream.sensors import Sensors
from fltea.stream.snapshot import DeviceState, LastSample, sensor_of
from fltea.stream.stream_time import StatsTimes, StreamTime

Output = AnyRecord | Block


class Pipeline:
    """Converts the events of one source into records and blocks of samples, in order.

    `outputs`: a function that returns what each output has written and dropped, for the record `stats`. These
    counts are published only for live sources: for a file they would only show how fast this machine is.
    `state`: a snapshot of the estimators from an earlier run.
    `refuse`: a function that is called if the content of that snapshot is not valid.
    `fit_worker`: makes the live fits of all devices of this program.
    `number`: index of this device among the devices of the program, counted from zero.
    `stats_s`: seconds between two statistics of a device. Different devices publish them at different times.
    `watched`: whether an output receives every result. If not, this class makes only the statistics at the
    end and those records on which other results depend.
    """

    def __init__(
        self,
        source: Source,
        config: Config,
        outputs: Callable[[], dict[str, OutputStats]] = dict,
        state: DeviceState | None = None,
        refuse: Callable[[], None] = lambda: None,
        fit_worker: FitWorker | None = None,
        number: int = 0,
        stats_s: int = 1,
        watched: bool = True,
    ) -> None:
        self._source, self._config, self._outputs = source, config, outputs
        self._time = time = StreamTime(source.unix_offset_ns)
        self._decoder = Decoder(
            lambda: time.source_offset_ns, config.link.max_gap, config.name, config.output
        )
        self._stats_times = StatsTimes(self.device, stats_s, fit_worker, number, watched=watched)
        fits = LiveFits(config, prompt=source.prompt, watched=watched, fit_worker=fit_worker, number=number)
        self._fits = fits if config.live.on else None
        self._board = (
            BoardEstimates(config, self._fits) if config.estimator.estimate_on in BY_DEVICE else None
        )
        settings = (lambda: config.estimator) if self._board is None else self._board.host_settings
        self._sensors = Sensors(config, settings, self._fits)
        self._start = EpochStart(config, self._decoder, self._sensors, self._board, state, refuse)
        self._status: DeviceStatus | None = None
        self._lost_reported = OnceAMinute()

    def feed(self, event: Event) -> Iterator[Output]:
        """Process one event of the source, and yield the records and blocks that result.

        The caller has to consume all of these before it passes the next event.

        Raises:
            UsageError: the settings, such as a fixed bias or R, do not fit the axes of the device.
        """
        self._time.source_offset_ns = self._source.unix_offset_ns
        if isinstance(event, RawBlock):
            yield from self._on_samples(event)
            return
        yield from self._on_time(host_ns_of(event))
        if isinstance(event, Hello):
            if self._decoder.on_hello(event):
                self._forget()
                yield msgspec.structs.replace(event, host_ns=self._time.unix_ns, device=self._config.name)
        else:
            self._decoder.on_other(event)
        yield from self._on_event(event)

    def _on_samples(self, raw: RawBlock) -> Iterator[Output]:
        """Let the native device process samples, handle each of its stops, and yield the results."""
        for stop, row, rows, details in self._decoder.advance(raw):
            if rows is not None:
                yield from self.took(rows, raw.host_ns[rows[0] : rows[0] + len(rows[1][0])])
            if stop in HANDLERS:
                now_ns = int(raw.host_ns[row]) if stop in BEFORE_SAMPLE else self._time.now_ns
                yield from self.stopped(stop, now_ns, details)
        # the native device may ignore the last samples, for example if their clock is wrong
        self._time.now_ns = int(raw.host_ns[-1])

    def took(self, rows: Rows, host_ns: Ints) -> Iterator[Output]:
        """Yield the samples that the native device has processed, together with the results for them.

        `host_ns` (n,): arrival times of the samples on the monotonic clock [ns].
        """
        block = self._sensors.block(self._decoder.block(rows[1]), rows[2])
        if self._board is None:
            yield block
        else:
            yield from self._records(self._board.on_block(block, host_ns))
        self._time.now_ns = int(host_ns[-1])

    def stopped(self, stop: Stop, now_ns: int, details: Any) -> Iterator[Output]:
        """Handle a stop of the native device. `now_ns`: arrival time of the sample at the stop [ns]."""
        self._time.source_offset_ns, self._time.now_ns = self._source.unix_offset_ns, now_ns
        self._note_offset()
        return HANDLERS[stop](self, details)

    def came_to(self, now_ns: int) -> None:
        """Remember the arrival time [ns] of samples that the native device has processed without a stop."""
        self._time.now_ns = max(self._time.now_ns, now_ns)

    def _on_stats_due(self, details: None) -> Iterator[Output]:
        """Publish the statistics. They are due because the next sample is the first of a new second."""
        return self._on_time(self._time.now_ns)

    def _on_gap(self, details: Any) -> Iterator[Output]:
        """Report that samples are missing before the next sample, and which axes became invalid meanwhile."""
        missing, seq, unix_ns, lost = details
        yield Gap(seq - missing, missing, self._decoder.epoch, unix_ns, device=self._config.name)
        for number, losses in enumerate(lost):
            yield from self._on_lost(self._sensors.lost(number, losses))

    def _on_epoch(self, details: Any) -> Iterator[Output]:
        """Begin an epoch with the next sample, from a snapshot if a suitable one exists."""
        first = FirstSample._make(details)
        hello = self._decoder.hello
        assert hello is not None
        name, missing = self._config.name, first.missing
        self._time.take_offset()
        now_ns, unix_ns = self._time.now_ns, self._time.unix_ns
        beginning = Beginning(hello, first.gyro_axes, first.has_accel, missing=missing)
        notices, reason, resumed_after_s, between = self._start.begin(beginning, first, now_ns, unix_ns)
        yield from self._records(notices)
        if self._fits is not None:
            self._fits.begin_numbers(first.seq)
            self._set_fit_times()
        epoch = self._decoder.epoch
        if missing:
            yield Gap(first.seq - missing, missing, epoch - 1, unix_ns, device=name)
        standing = self._standing()
        place = first.seq, first.epoch_us, unix_ns
        gyro, accel = (standing.filters.get(kind) for kind in SENSOR_KINDS)
        yield Epoch(epoch, reason, *place, hello.boot_id, gyro, accel, resumed_after_s, device=name)
        if between:
            self.device.note_lost(between)
            yield Gap(first.seq - between, between, epoch, unix_ns, device=name)

    def _on_happened(self, details: Any) -> Iterator[Output]:
        """Report that at the last sample an axis became invalid, a bias stepped, or motion began or ended."""
        moment = self._moment()
        assert moment is not None
        for number, losses, event in details:
            if losses is not None:
                yield from self._on_lost(self._sensors.lost(number, losses))
            else:
                yield self._sensors.happened(number, event, moment)

    def _on_window_full(self, details: None) -> Iterator[Output]:
        """Let the filters of a sensor begin to estimate, since the sensor's start-up window is full."""
        for channels in self._sensors.fill(self.device):
            yield from self._records(channels.notices(self._time.now_ns))

    def _on_fit_counts(self, details: None) -> Iterator[Output]:
        """From the next sample on, use the result of the refit that began earlier."""
        assert self._fits is not None
        found = list(self._fits.counted())
        self._sensors.go_by_fits(self.device)
        self._set_fit_times()
        # The records of the fit come after `go_by_fits`. An output that receives them also reads `words`,
        # which has the new verdicts only then.
        yield from found

    def _on_fit_due(self, details: None) -> Iterator[Output]:
        """Let the fit worker begin a refit of all samples so far."""
        moment = self._moment()
        assert self._fits is not None
        assert moment is not None
        self._fits.refit(moment, self._sensors.tracks)
        self._set_fit_times()
        return iter(())

    def _on_rate_differs(self, details: Any) -> Iterator[Output]:
        """Report that the device's clock contradicts the sampling rate in its HELLO."""
        yield self._error("rate_differs", explain_rate(self._decoder.source, *details))

    def _set_fit_times(self) -> None:
        assert self._fits is not None
        self.device.fit_due, self.device.fit_counts = self._fits.due, self._fits.counts

    def _on_lost(self, losses: Sequence[tuple[str, Reason]]) -> Iterator[Output]:
        for axis, why in losses:
            if self._lost_reported.is_due(axis, self._time.now_ns):
                yield self._error(*explain_lost(axis, why))

    def _on_time(self, host_ns: int | None) -> Iterator[Output]:
        """Publish the statistics of the past second if this event is the first of a new second."""
        if host_ns is not None:
            self._time.now_ns = host_ns
        self._note_offset()
        if self._stats_times.pass_time(self._time.now_ns):
            yield self.stats()

    def _note_offset(self) -> None:
        """Before the first epoch, follow the source's offset from host time to Unix time.

        This offset changes if the source learns the date only after its first events.
        """
        if not self._decoder.epoch:
            self._time.take_offset()

    def _on_event(self, event: Event) -> Iterator[Output]:
        match event:
            case DeviceStatus():
                self._status = event
            case LinkDown():
                self._status = None
            case Trouble(kind, message):
                yield self._error(kind, message)
        if self._decoder.hello is None:
            self._forget()
        if self._board is not None:
            yield from self._records(self._board.on_event(event))

    def _records(self, items: Iterable[Item]) -> Iterator[Output]:
        for item in items:
            if isinstance(item, Notice):
                self._time.now_ns = item.host_ns
                yield self._error(item.kind, item.message)
            else:
                yield item

    def save(self) -> DeviceState | None:
        """Return a snapshot of the estimators for a later run; None while they have nothing to save."""
        if self._start.state is not None:  # the snapshot of an earlier run has not been used yet
            return self._start.state
        hello, saved = self._decoder.hello, self._sensors.save()
        if hello is None or not saved or self.device.moment is None:
            return None
        sequence, device_us, host_ns, *_ = self.device.newest
        # The offset from host time to Unix time is the present one, not that of the beginning of the epoch,
        # because the date may have been set since then.
        unix_ns = host_ns + self._source.unix_offset_ns
        boot_id = self._start.boot_id
        last = None if boot_id is None else LastSample(boot_id, sequence, device_us)
        return DeviceState(sensor=sensor_of(hello, self._config), unix_ns=unix_ns, last=last, **saved)

    @property
    def device(self) -> Device:
        """The native device, for those callers whose own native code passes the samples to the device."""
        return self._decoder.native

    @property
    def words(self) -> object:
        """Values, such as verdicts, that are the same in the records of many samples in a row.

        They change only at a `Stop`, where the native device returns from its loop over the samples.
        """
        return self._decoder.epoch, self._sensors.words

    @property
    def has_board(self) -> bool:
        """Whether the samples come from a board that estimates. If so, Python handles each sample."""
        return self._board is not None

    @property
    def hello(self) -> Hello | None:
        """The newest HELLO; None while no device has sent one."""
        return self._decoder.hello

    def stats(self) -> Stats:
        """Return the statistics of the whole device stream so far."""
        device, standing = self.device, self._standing()
        return Stats(
            epoch=self._decoder.epoch,
            host_ns=self._time.unix_ns,
            rate_hz=device.rate_hz,
            clock_ppm=device.clock_ppm if self._source.has_clock else None,
            startup_remaining=standing.startup_remaining,
            link=self._source.link_stats(),
            sample_counts=self._decoder.counts,
            axes={
                axis: msgspec.structs.replace(one, tracker=standing.tracker.get(axis))
                for axis, one in standing.axes.items()
            },
            board=self._status,
            outputs=self._outputs() if self._source.prompt else {},
            device_estimator=standing.device,
            fit_period_s=standing.fit_period_s,
            device=self._config.name,
        )

    def finish(self, *, last_fit: bool = True, whole: bool = False) -> Iterator[Output]:
        """Yield the records at the end of a stream, which are a fit of all samples and the statistics.

        `last_fit`: whether to make the fit of all samples. `whole`: whether the source has ended, so that no
        more samples can come.
        """
        if self._fits is not None and last_fit:
            yield from self._fits.last(self._moment())
        stats = self.stats()
        if whole and stats.sample_counts.delivered and stats.startup_remaining:
            yield self._error(
                "too_short",
                f"the start-up window needs {stats.startup_remaining} more samples, so there is no estimate. "
                "Record ten minutes at rest, or an hour to know the bias instability.",
            )
        yield stats

    def _moment(self) -> Moment | None:
        """Return the number, device time and host time of the last sample; None before the first one."""
        moment = self.device.moment
        if moment is None:
            return None
        seq, device_us, host_ns = moment
        return Moment(seq, self._decoder.epoch, device_us, host_ns)

    def _standing(self) -> Standing:
        """Return the present state of all estimators.

        For an axis that only the board estimates, it is the state of the board's estimator.
        """
        whole = self._sensors.standing(self.device)
        return whole if self._board is None else whole.with_board(self._board.standing())

    def _forget(self) -> None:
        """Ignore the estimates and fits that the board still sends for earlier samples.

        The samples from now on may come from another board or sensor.
        """
        if self._board is not None:
            self._board.forget()

    def _error(self, kind: str, message: str) -> Error:
        return Error(kind, message, self._time.unix_ns, device=self._config.name)


HANDLERS: dict[Stop, Callable[[Pipeline, Any], Iterator[Output]]] = {
    Stop.STATS_DUE: Pipeline._on_stats_due,
    Stop.GAP: Pipeline._on_gap,
    Stop.EPOCH: Pipeline._on_epoch,
    Stop.HAPPENED: Pipeline._on_happened,
    Stop.WINDOW_FULL: Pipeline._on_window_full,
    Stop.FIT_COUNTS: Pipeline._on_fit_counts,
    Stop.FIT_DUE: Pipeline._on_fit_due,
    Stop.RATE_DIFFERS: Pipeline._on_rate_differs,
}
"""The method that handles each kind of stop of the native device. `END` and `MORE` need no method, since they
report no event.
"""

BEFORE_SAMPLE = {stop for stop in Stop if stands_before_sample(stop)}
"""Kinds of stops that belong to the next sample. Other stops belong to the sample processed last."""
