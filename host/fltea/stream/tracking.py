"""The stage that says what the bias of each axis is now, by the noise that the live fit has found.

It takes samples in the walk of the live fit, whose settled answers count from the sample with which they are
there and which leaves out what is motion here. It has estimates from the first samples on: until an answer is
stable, or half a minute long, a bank of random walks stands for the noise.
"""

import contextlib
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from fltea.estimator.tracker import Checked, Rest, Tracker, TrackerEvent, TrackerRules
from fltea.records.arrays import Array, Mask
from fltea.records.block import Block, Tracked, TrackedColumns, with_tracked
from fltea.records.events import Ints
from fltea.records.fit import Interval
from fltea.records.records import ACCEL_UNIT, GYRO_UNIT
from fltea.records.stats import BiasCheck, TrackerStats
from fltea.settings.config import Config
from fltea.settings.estimator import EstimatorConfig
from fltea.settings.live import LiveConfig
from fltea.spectrum.innovation_whiteness import describes
from fltea.spectrum.live_axes import LONGEST_MOTION_S
from fltea.stream.happenings import Happened, after_rows, left_out, records_of
from fltea.stream.learning import Learned, Learner
from fltea.stream.live import LiveFits, SettledFit, settled_by
from fltea.stream.stages import Beginning, Item, Saved, Stage, Standing

UNDEFINED = Interval()
CHECKED_S = 1, 10, 60
"""Times over which the bias is checked."""
STILL_S = 10.0
"""So long samples have to lie still elsewhere until there is where the offset is now."""


def rules_of(live: LiveConfig, h: float, unit: str) -> TrackerRules:
    """Return what the tracker of a sensor goes by; h: sampling period in s."""
    is_gyro = unit == GYRO_UNIT
    return TrackerRules(
        ahead=max(round(live.bias_s / h), 1),
        checked=tuple(max(round(t_s / h), 1) for t_s in CHECKED_S),
        largest_step=live.largest_step_dps if is_gyro else live.largest_step_ms2,
        largest_gravity_step=live.largest_step_ms2,
        still=max(round(STILL_S / h), 1),
        patience=max(round(LONGEST_MOTION_S / h), 1),
        settles=not is_gyro,  # an accelerometer that was turned lies still
    )


class SensorTracks:
    """Tracks the biases of one sensor.

    axes: their names, and which columns of the samples they are. h: sampling period in s.
    """

    def __init__(
        self, axes: Mapping[str, int], config: EstimatorConfig, live: LiveConfig, h: float, unit: str
    ) -> None:
        self.names, self.places, self.h, self.unit = tuple(axes), list(axes.values()), h, unit
        self._known: dict[str, SettledFit] = {}
        self._offsets = _offsets(config, len(self.names))
        self._bias_s = live.bias_s
        self.tracker = Tracker(self._offsets, rules_of(live, h, unit))
        self._newest: TrackedColumns | None = None
        self._said = self._words()
        self._learned: dict[str, Learned] = {}

    def run(self, values: Array, accel: Array | None = None, rest: Rest = Rest.UNKNOWN) -> TrackedColumns:
        """Take samples, (n, columns); `events` has what has happened with them.

        accel: of the sensor's accelerometer, (n, 1 to 3) in m/s².
        """
        own = values if len(self.places) == values.shape[1] else values[:, self.places]
        return self.columns(self.tracker.run(own, accel, rest))

    @property
    def events(self) -> list[TrackerEvent]:
        """What has happened with the samples of the last call of `run`."""
        return self.tracker.events

    def columns(self, found: Sequence[Array | Mask]) -> TrackedColumns:
        """Return what the tracker has found of samples, of which there is one at least, as columns."""
        self._newest = TrackedColumns._make((self.names, self.unit, *found, *self._said))
        return self._newest

    def _words(self) -> tuple[tuple[Any, ...], ...]:
        """What stands in all columns until the next fit: verdict, alpha and f of each axis."""
        stands = [self._known[axis].stands if axis in self._known else None for axis in self.names]
        return (
            tuple(one.verdict if one else None for one in stands),
            tuple(one.alpha if one else UNDEFINED for one in stands),
            tuple(one.f if one else UNDEFINED for one in stands),
        )

    def knows(self, axis: str, settled: SettledFit) -> bool:
        """Return whether it has taken that."""
        return settled is self._known.get(axis)

    def skip(self, count: int) -> None:
        """Predict over lost samples."""
        self.tracker.skip(count)

    def learner(self, axis: str) -> Learner:
        """Return what is to learn from the samples of an axis until now, for `SettledFit.followed_by`."""
        lane = self.names.index(axis)
        return Learner(self.tracker.remembered(lane), self.h, self.unit, self._offsets[lane] is not None)

    def go_by(self, axis: str, settled: SettledFit) -> None:
        """Take what the live fit has found for the noise of an axis, if it is new."""
        if self.knows(axis, settled):
            return
        self._known[axis] = settled
        self._said = self._words()
        learned = settled.learned
        if learned is None or learned is self._learned.get(axis):
            return
        with contextlib.suppress(ValueError):  # no filter can work with it: the last one goes on
            self.tracker.set(self.names.index(axis), *learned.rivals)
            self._learned[axis] = learned

    def heading_std(self, axis: str, t_s: float) -> float:
        """Return the deviation of the integral t_s after a rest as long as the fit's; NaN before a fit."""
        return self._learned[axis].heading_std(t_s) if axis in self._learned else math.nan

    def stats(self) -> Iterator[tuple[str, TrackerStats]]:
        """Yield how each axis gets on."""
        newest = [(math.nan, math.nan)] * len(self.names)
        if self._newest is not None:
            newest = [*zip(self._newest.bias[-1].tolist(), self._newest.bias_std[-1].tolist(), strict=True)]
        for axis, one, biases in zip(self.names, self.tracker.figures(), newest, strict=True):
            holds = None if one.ljung_box is None else describes(one.innovations, one.ljung_box)
            words, K, headings = "walks", UNDEFINED, dict[int, float]()
            if (learned := self._learned.get(axis)) is not None:
                words, K, headings = learned.model, learned.K, learned.headings
            bias, std = (x if math.isfinite(x) else None for x in biases)
            yield (
                axis,
                TrackerStats(
                    words,
                    one.nis,
                    one.lag1,
                    holds,
                    one.moved,
                    one.begun,
                    K,
                    headings,
                    bias,
                    std,
                    one.steps,
                    self.tracker.moving,
                    _checks(one.checked),
                    self._bias_s,
                ),
            )

    def save(self) -> bytes:
        """Return what `load` takes."""
        return self.tracker.save()

    def load(self, saved: bytes) -> None:
        """Go on from there; ValueError for what cannot be one's own."""
        self.tracker.load(saved)


class TrackedBlock(NamedTuple):
    """What is known of the samples of a block, and what is left out of sums of noise, by sensor."""

    tracked: Tracked
    left_out: dict[str, Mask]
    """Samples of the units' axes, (n, axes)."""


class Tracking(Stage):
    """Tracks the biases of both sensors. fits: the live fits; without them the bank of walks goes on."""

    def __init__(self, config: Config, fits: LiveFits | None) -> None:
        self._config, self._fits, self._settled = config, fits, settled_by(fits)
        self.sensors: dict[str, SensorTracks] = {}
        self._happened: list[Happened] = []

    def begin(self, beginning: Beginning) -> None:
        """Begin an epoch, from what was saved if it fits."""
        hello, saved = beginning.hello, beginning.saved or Saved()
        gyro, accel = beginning.axes(self._config.channels)
        h, self.sensors = 1 / hello.rate_hz, {}
        for name, axes, config, unit, data in (
            ("gyro", gyro, self._config.estimator, GYRO_UNIT, saved.gyro_track),
            ("accel", accel, self._config.accel, ACCEL_UNIT, saved.accel_track),
        ):
            if axes:
                self.sensors[name] = sensor = SensorTracks(axes, config, self._config.live, h, unit)
                if data is not None:
                    sensor.load(data)

    def bridge(self, count: int) -> None:
        """Predict over the time for which the program stood still."""
        for sensor in self.sensors.values():
            sensor.skip(count)

    def on_block(self, block: Block, host_ns: Ints, missing: int) -> Iterator[Item]:
        """Give the samples on with their biases, and between them the fits, steps and motion."""
        if missing:
            self.bridge(missing)
        if self._fits is not None:
            return self._between(self._fits.walk(block, missing, self))
        return self._between((with_tracked(block, [self.track(block).tracked]),))

    def track(self, block: Block) -> TrackedBlock:
        """Take samples, by the fits that count by now."""
        tracked = []
        rest: dict[str, Mask] = {}
        for name, values in (("gyro", block.gyro_dps), ("accel", block.accel_ms2)):
            if (sensor := self.sensors.get(name)) is not None and values is not None:
                for axis in sensor.names:
                    sensor.go_by(axis, self._settled(axis))
                accel = block.accel_ms2 if name == "gyro" else None
                tracked.append(sensor.run(values, accel))
                rest[sensor.unit] = left_out(tracked[-1].moving, sensor.events)
                self._happened += self.records_of(name, sensor.events, block)
        return TrackedBlock(tuple(tracked), rest)

    def records_of(self, name: str, events: Sequence[TrackerEvent], block: Block) -> list[Happened]:
        """Return the records of what has happened with the samples of a block."""
        sensor = self.sensors[name]
        return records_of(events, block, sensor.names, sensor.unit, sensor.h, self._config.name)

    def _between(self, items: Iterable[Item]) -> Iterator[Item]:
        """Yield the items, and after the sample with which it was found each record of what has happened."""
        for item in items:
            if isinstance(item, Block) and self._happened:
                happened = [one for one in self._happened if one.found_seq <= int(item.seq[-1])]
                self._happened = self._happened[len(happened) :]
                yield from after_rows(item, happened)
            else:
                yield item

    def learner(self, axis: str) -> Learner:
        """Return what is to learn from the samples of an axis until now."""
        return next(one for one in self.sensors.values() if axis in one.names).learner(axis)

    @property
    def is_steady(self) -> bool:
        """Whether no fit is news."""
        sensors = self.sensors.values()
        return all(one.knows(axis, self._settled(axis)) for one in sensors for axis in one.names)

    def standing(self) -> Standing:
        """How the trackers get on."""
        return Standing(tracker={axis: one for s in self.sensors.values() for axis, one in s.stats()})

    def save(self) -> dict[str, Any]:
        """What the trackers of both sensors know."""
        return {f"{name}_track": sensor.save() for name, sensor in self.sensors.items()}


def _checks(checked: Sequence[Checked]) -> dict[int, BiasCheck]:
    """Return, by seconds, how the bias has held; nothing of times of which no piece is full."""
    found = zip(CHECKED_S, checked, strict=True)
    return {t_s: BiasCheck(one.pieces, one.rms) for t_s, one in found if one.rms is not None}


def _offsets(config: EstimatorConfig, axes: int) -> list[float | None]:
    """Return the offsets that the settings give."""
    bias = config.bias
    if isinstance(bias, str):
        return [None] * axes
    return list(bias) if isinstance(bias, list) else [bias] * axes
