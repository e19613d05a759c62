"""The walk of a block: source → decode (place, time, units) → stages (host, board) → records.

The sources stand before it (transport, framing and messages inside the serial one), the sinks behind it.
Nothing that comes out depends on how the samples were put together into blocks, nor on how the bytes behind
them were read: statistics go out at the first event of each new second, and count what stands before it. Of
many devices each has its own place in the second (`fit_times.turn`): no sample waits for those of all.
"""

from collections.abc import Callable, Iterable, Iterator
from itertools import chain

import msgspec

from fltea.records.block import Block
from fltea.records.clock import SECOND_NS
from fltea.records.errors import UsageError
from fltea.records.events import Break, Event, LinkDown, RawBlock, Trouble, host_ns_of
from fltea.records.ports import Source
from fltea.records.records import ACCEL_AXES, AXES, AnyRecord, Epoch, EpochReason, Error, Gap, Hello, Stats
from fltea.records.stats import DeviceStatus, OutputStats, SampleStats
from fltea.settings.config import Config
from fltea.settings.estimator import BY_DEVICE
from fltea.settings.ingest import is_partitioned
from fltea.stream.beside import Beside
from fltea.stream.board import BoardEstimates
from fltea.stream.decode import Decoded, Decoder
from fltea.stream.fit_times import turn
from fltea.stream.gathering import Gathering, by_period
from fltea.stream.happenings import after_rows
from fltea.stream.host import HostEstimates
from fltea.stream.live import LiveFits
from fltea.stream.snapshot import (
    DeviceState,
    LastSample,
    missing_by_number,
    missing_since,
    sensor_of,
    why_unused,
)
from fltea.stream.stages import NEVER, Beginning, Item, Notice, Stage, Standing, through
from fltea.stream.steady import Steady, Taken
from fltea.stream.tracking import Tracking

Output = AnyRecord | Block


MOST_STEADY = 256
"""Samples of a block: of more, the stages cost less than their estimates."""


class Pipeline:
    """Turns the events of one source into records and blocks, in order.

    outputs: gives the counts of the outputs for `stats`, which shows them of sources with a pace of their
    own: of others they would only tell how fast this machine was. state: a snapshot of an earlier run.
    refuse: is called if it is not sound. beside: what the live fits of this program share. number: which of
    its devices this is, from 0. stats_s: seconds from one statistics to the next; devices have turns.
    watched: somebody takes what comes out; else there are only the records by which others go, and the last.
    """

    def __init__(
        self,
        source: Source,
        config: Config,
        outputs: Callable[[], dict[str, OutputStats]] = dict,
        state: DeviceState | None = None,
        refuse: Callable[[], None] = lambda: None,
        beside: Beside | None = None,
        number: int = 0,
        stats_s: int = 1,
        watched: bool = True,
    ) -> None:
        self._stats_ns = stats_s * SECOND_NS
        self._stats_offset_ns = turn(beside or Beside(), number, self._stats_ns)
        self._source, self._config, self._outputs, self._state = source, config, outputs, state
        self._decoder = Decoder(
            lambda: self._source_offset_ns, config.link.max_gap, config.name, config.output
        )
        gathers = not (watched or source.prompt or config.estimator.estimate_on in BY_DEVICE)
        self._gathering = Gathering(self._decoder.place) if gathers else None
        self._refuse, self._watched = refuse, watched
        fits = LiveFits(config, prompt=source.prompt, watched=watched, beside=beside, number=number)
        self._fits = fits if config.live.on else None
        self._tracking = Tracking(config, self._fits)
        self._host, board = _estimates_of(config, self._fits)
        stages = self._fits, self._tracking, self._host, board
        self._stages: list[Stage] = [stage for stage in stages if stage is not None]
        self._board_estimates = board is not None
        self._board: DeviceStatus | None = None
        self._now_ns = 0
        self._stats_due_ns: int | None = None if watched else NEVER
        self._sample_ns: int | None = None
        self._last: LastSample | None = None
        self._no_axis_reported = False
        self._offset_ns = self._source_offset_ns = source.unix_offset_ns
        self._block: Block | None = None
        self._steady: Steady | None = None

    def feed(self, event: Event) -> Iterable[Output]:
        """Return what one event leads to, which has to be taken before the next one.

        Raises:
            UsageError: a fixed bias or R that does not fit the axes.
        """
        offset_ns = self._source.unix_offset_ns
        if self._gathering is not None:
            gathered = self._gathering.take(event, offset_ns)
            return chain.from_iterable(self._in_stages(*taken) for taken in gathered)
        found = self._steadily(event)
        return self._in_stages(event, offset_ns) if found is None else found

    def _steadily(self, event: Event) -> Iterable[Output] | None:
        """Take samples by the short way, and what is behind them; None if the first is for the stages."""
        if not isinstance(event, RawBlock) or len(event.sequence) > MOST_STEADY:
            return None
        taken = self._taken(event)
        if taken is None:
            return None
        if taken.lost or taken.happened or len(taken.block) < len(event.sequence):
            return self._of_pieces(event, taken)
        return (taken.block,)

    def _taken(self, raw: RawBlock) -> Taken | None:
        """Take samples by the short way, up to one with which more is to be done."""
        if self._steady is None or self._stats_due_ns is None:
            return None
        taken = self._steady.take(raw, self._stats_due_ns)
        if taken is not None:
            newest = taken.newest
            self._came_to(newest.host_ns, newest.sequence, newest.device_us)
        return taken

    def _of_pieces(self, raw: RawBlock, taken: Taken | None) -> Iterator[Output]:
        """Yield what was taken of these samples, and what comes of those behind it."""
        while taken is not None:
            block, lost = taken.block, taken.lost
            begin = 0
            for item in after_rows(block, taken.happened):
                if not isinstance(item, Block):
                    yield from self._records((item,))
                    continue
                end = begin + len(item)
                own = [(row - begin, axis, why) for row, axis, why in lost if begin <= row < end]
                yield from self._records(self._host.with_notices(item, own, raw.host_ns[begin:end]))
                begin = end
            raw = raw.rows(len(block), len(raw.sequence))
            if not len(raw.sequence):
                return
            taken = self._taken(raw)
        yield from self._in_stages(raw, self._source_offset_ns)

    def _in_stages(self, event: Event, offset_ns: int) -> Iterator[Output]:
        self._source_offset_ns = offset_ns
        parts = by_period(event, self._stats_ns, self._stats_offset_ns) if self._watched else (event,)
        for part in parts:
            yield from self._on_time(part)
            taken = self._steadily(part)
            if taken is not None:
                yield from taken
                continue
            self._steady = None if isinstance(part, RawBlock | LinkDown | Break) else self._steady
            for found in self._decoder.feed(part):
                if isinstance(found, Hello):
                    self._steady = None
                    self._forget()
                    yield msgspec.structs.replace(found, host_ns=self._unix_ns(), device=self._config.name)
                else:
                    yield from self._on_samples(found)
            if isinstance(part, RawBlock):
                self._now_ns = int(part.host_ns[-1])  # also where its last samples could not be used
            else:
                yield from self._on_event(part)
            if self._steady is None and isinstance(part, RawBlock) and len(part.sequence) <= MOST_STEADY:
                self._steady = self._steady_now()

    def _steady_now(self) -> Steady | None:
        """Return what takes the next samples, if nothing else is to be done with them."""
        if self._board_estimates or self._block is None:
            return None
        return Steady.after(self._block, self._decoder, self._tracking, self._fits, self._host)

    def save(self) -> DeviceState | None:
        """A snapshot of the estimators, for a later run; None while there is nothing to keep."""
        if self._state is not None:  # of an earlier run, and still to be used
            return self._state
        hello, sample_ns = self._decoder.place.hello, self._sample_ns
        saved = {name: one for stage in self._stages for name, one in stage.save().items()}
        if hello is None or sample_ns is None or not saved.keys() & {"gyro", "accel"}:
            return None
        unix_ns = sample_ns + self._source.unix_offset_ns  # the epoch's own would keep a date set since
        return DeviceState(sensor=sensor_of(hello, self._config), unix_ns=unix_ns, last=self._last, **saved)

    @property
    def hello(self) -> Hello | None:
        """The newest HELLO; None where it is not known which device it is."""
        return self._decoder.place.hello

    def _on_time(self, event: Event) -> Iterator[Output]:
        """Let the statistics of a second go out before the first event of the next."""
        host_ns = int(event.host_ns[0]) if isinstance(event, RawBlock) else host_ns_of(event)
        if host_ns is not None:
            self._now_ns = host_ns
        if self._decoder.timebase is None:  # the source may not have known the date before
            self._offset_ns = self._source_offset_ns
        due_ns = self._stats_due_ns
        if due_ns is not None and self._now_ns < due_ns:
            return
        if due_ns is not None:
            yield self.stats()
        begun = (self._now_ns - self._stats_offset_ns) // self._stats_ns
        self._stats_due_ns = (begun + 1) * self._stats_ns + self._stats_offset_ns

    def _on_event(self, event: Event) -> Iterator[Output]:
        match event:
            case DeviceStatus():
                self._board = event
            case LinkDown():
                self._board = None
            case Trouble(kind, message):
                yield self._error(kind, message)
        if self._decoder.place.hello is None:
            self._forget()
        yield from self._records(item for stage in self._stages for item in stage.on_event(event))

    def _on_samples(self, decoded: Decoded) -> Iterator[Output]:
        block, raw, hello, missing, reason = decoded
        name, resumed_after_s, between = self._config.name, None, 0
        self._now_ns = int(raw.host_ns[0])
        if reason is not None:
            self._offset_ns = self._source_offset_ns
            notices, reason, resumed_after_s, between = self._begin(decoded, reason)
            yield from self._records(notices)
        first = int(block.seq[0])
        if missing:
            epoch = block.epoch - (reason is not None)
            yield Gap(first - missing, missing, epoch, int(block.host_ns[0]), device=name)
        if reason is not None:
            standing = self._standing()
            times = int(block.device_us[0]), int(block.host_ns[0])
            yield Epoch(
                block.epoch,
                reason,
                first,
                *times,
                hello.boot_id,
                standing.gyro,
                standing.accel,
                resumed_after_s,
                device=name,
            )
            missing = 0
            if between:
                place = self._decoder.place
                place.lost, place.gaps = place.lost + between, place.gaps + 1
                yield Gap(first - between, between, block.epoch, int(block.host_ns[0]), device=name)
        items: Iterable[Item] = [block]
        for stage in self._stages:
            items = through(stage, items, raw, missing)
        self._came_to(*(int(column[-1]) for column in (raw.host_ns, raw.sequence, raw.device_us)))
        for item in self._records(items):
            if isinstance(item, Block):
                self._block = item
            yield item

    def _came_to(self, host_ns: int, sequence: int, device_us: int) -> None:
        """Take note of the newest sample that was used."""
        self._now_ns = self._sample_ns = host_ns
        hello = self._decoder.place.hello
        if hello is not None and hello.boot_id is not None:
            self._last = LastSample(hello.boot_id, sequence, device_us)

    def _records(self, items: Iterable[Item]) -> Iterator[Output]:
        for item in items:
            if isinstance(item, Notice):
                self._now_ns = item.host_ns
                yield self._error(item.kind, item.message)
            else:
                yield item

    def stats(self) -> Stats:
        """Sum up the whole walk so far."""
        place, timebase, standing = self._decoder.place, self._decoder.timebase, self._standing()
        return Stats(
            epoch=self._decoder.epoch,
            host_ns=self._unix_ns(),
            rate_hz=timebase.rate_hz if timebase else None,
            clock_ppm=timebase.clock_ppm if timebase else None,
            startup_remaining=standing.startup_remaining,
            link=self._source.link_stats(),
            sample_counts=SampleStats(
                place.delivered, place.lost, place.gaps, place.duplicates, place.before_hello
            ),
            axes={
                axis: msgspec.structs.replace(one, tracker=standing.tracker.get(axis))
                for axis, one in standing.axes.items()
            },
            board=self._board,
            outputs=self._outputs() if self._source.prompt else {},
            device_estimator=standing.device,
            fit_period_s=standing.fit_period_s,
            device=self._config.name,
        )

    def finish(self, *, last_fit: bool = True, whole: bool = False) -> Iterator[Output]:
        """What comes at the end: a fit of everything, and the statistics; whole: the source has no more."""
        for taken in self._gathering.rest() if self._gathering is not None else ():
            yield from self._in_stages(*taken)
        if self._fits is not None and last_fit:
            yield from self._records(self._fits.last())
        stats = self.stats()
        if whole and stats.sample_counts.delivered and stats.startup_remaining:
            yield self._error(
                "too_short",
                f"the samples end {stats.startup_remaining} before the start-up window is full, so there is "
                "no estimate. Record ten minutes at rest, or an hour to know the bias instability.",
            )
        yield stats

    def _standing(self) -> Standing:
        """Return all stages' standings as one; of several that state an axis the first one counts."""
        whole = Standing()
        for one in (stage.standing() for stage in self._stages):
            whole = Standing(
                max(whole.startup_remaining, one.startup_remaining),
                one.axes | whole.axes,
                whole.gyro or one.gyro,
                whole.accel or one.accel,
                whole.device or one.device,
                whole.fit_period_s or one.fit_period_s,
                one.tracker | whole.tracker,
            )
        return whole

    def _begin(
        self, decoded: Decoded, reason: EpochReason
    ) -> tuple[list[Item], EpochReason, float | None, int]:
        """Begin an epoch, from the snapshot if there is one that fits.

        Returns what is to be reported, why the epoch begins, how old the snapshot is, and how many samples
        since then are lost: of devices that another process had before, which nobody else would count.
        """
        notices: list[Item] = []
        raw, hello = decoded.raw, decoded.hello
        has_accel = decoded.block.accel_ms2 is not None
        beginning = Beginning(hello, raw.gyro.shape[1], has_accel, missing=decoded.missing)
        if absent := self._absent(beginning):
            notices.append(Notice("no_axis", absent, self._now_ns))
        state, self._state = self._state, None
        if state is not None:
            now_unix_ns = self._now_ns + self._offset_ns
            problem = why_unused(state, hello, self._config, now_unix_ns)
            if problem is None:
                try:
                    for stage in self._stages:
                        stage.begin(beginning._replace(saved=state))
                except ValueError as error:
                    problem = str(error)
                    self._refuse()
                else:
                    age_s = (now_unix_ns - state.unix_ns) * 1e-9
                    first = int(raw.sequence[0]), int(raw.device_us[0])
                    missing = missing_since(state, hello, *first, age_s)
                    for stage in self._stages:
                        stage.bridge(missing)
                    handed_over = is_partitioned(self._config.source)
                    lost = missing_by_number(state, hello, *first, age_s) if handed_over else None
                    return notices, "resumed", age_s, lost or 0
            text = f"the snapshot is not used, so the start-up window begins: {problem}."
            notices.append(Notice("state_unused", text, self._now_ns))
        try:
            for stage in self._stages:
                stage.begin(beginning)
        except ValueError as error:
            raise UsageError(f"estimator: {error}.") from error
        return notices, reason, None, 0

    def _absent(self, beginning: Beginning) -> str | None:
        """Return once which of the requested channels the source does not have."""
        available = AXES[: beginning.gyro_axes] + (ACCEL_AXES if beginning.accel else ())
        absent = [axis for axis in self._config.channels or () if axis not in available]
        if not absent or self._no_axis_reported:
            return None
        self._no_axis_reported = True
        return f"channels names {', '.join(absent)}, which this source does not have, or has no scale for."

    def _forget(self) -> None:
        for stage in self._stages:
            stage.forget()

    def _error(self, kind: str, message: str) -> Error:
        return Error(kind, message, self._unix_ns(), device=self._config.name)

    def _unix_ns(self) -> int:
        return self._now_ns + self._offset_ns


def _estimates_of(config: Config, fits: LiveFits | None) -> tuple[HostEstimates, BoardEstimates | None]:
    """Return what estimates: this computer, the board, or both."""
    if config.estimator.estimate_on not in BY_DEVICE:
        return HostEstimates(config, lambda: config.estimator, fits), None
    board = BoardEstimates(config, fits)
    return HostEstimates(config, None if board.alone else board.host_settings, fits), board
