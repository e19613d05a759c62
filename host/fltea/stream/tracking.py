"""The stage that says what the bias of each axis is now, by the noise that the live fit has found.

It takes samples in the walk of the live fit, whose settled answers count from the sample with which they are
there and which leaves out what is motion here. It has estimates from the first samples on: until an answer is
stable, or half a minute long, a bank of random walks stands for the noise.
"""

import contextlib
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from fltea.estimator.tracker import Tracker
from fltea.records.arrays import Array, Mask
from fltea.records.block import Block, Tracked, TrackedColumns, with_tracked
from fltea.records.events import Ints
from fltea.records.fit import Interval
from fltea.records.records import ACCEL_UNIT, GYRO_UNIT
from fltea.records.stats import TrackerStats
from fltea.settings.config import Config
from fltea.settings.estimator import EstimatorConfig
from fltea.spectrum.innovation_whiteness import describes
from fltea.stream.learning import Learned, Learner
from fltea.stream.live import LiveFits, SettledFit, settled_by
from fltea.stream.stages import Beginning, Item, Saved, Stage, Standing

UNDEFINED = Interval()


class SensorTracks:
    """Tracks the biases of one sensor. axes: their names, and which columns of the samples they are."""

    def __init__(self, axes: Mapping[str, int], config: EstimatorConfig, h: float, unit: str) -> None:
        self.names, self.places, self._h, self.unit = tuple(axes), list(axes.values()), h, unit
        self._known: dict[str, SettledFit] = {}
        self._offsets = _offsets(config, len(self.names))
        self.tracker = Tracker(self._offsets)
        self._newest: TrackedColumns | None = None
        self._said = self._words()
        self._learned: dict[str, Learned] = {}

    def run(self, values: Array) -> TrackedColumns:
        """Take samples, (n, columns)."""
        own = values if len(self.places) == values.shape[1] else values[:, self.places]
        return self.columns(self.tracker.run(own))

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
        return Learner(self.tracker.remembered(lane), self._h, self.unit, self._offsets[lane] is not None)

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
            self.tracker.set(self.names.index(axis), learned.system)
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
                TrackerStats(words, one.nis, one.lag1, holds, one.moved, one.begun, K, headings, bias, std),
            )

    def save(self) -> bytes:
        """Return what `load` takes."""
        return self.tracker.save()

    def load(self, saved: bytes) -> None:
        """Go on from there; ValueError for what cannot be one's own."""
        self.tracker.load(saved)


class Tracking(Stage):
    """Tracks the biases of both sensors. fits: the live fits; without them the bank of walks goes on."""

    def __init__(self, config: Config, fits: LiveFits | None) -> None:
        self._config, self._fits, self._settled = config, fits, settled_by(fits)
        self.sensors: dict[str, SensorTracks] = {}

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
                self.sensors[name] = sensor = SensorTracks(axes, config, h, unit)
                if data is not None:
                    sensor.load(data)

    def bridge(self, count: int) -> None:
        """Predict over the time for which the program stood still."""
        for sensor in self.sensors.values():
            sensor.skip(count)

    def on_block(self, block: Block, host_ns: Ints, missing: int) -> Iterator[Item]:
        """Give the samples on with their biases, and the fits between them."""
        if missing:
            self.bridge(missing)
        if self._fits is not None:
            return self._fits.walk(block, missing, self)
        return iter((with_tracked(block, [self.track(block)]),))

    def track(self, block: Block) -> Tracked:
        """Take samples, by the fits that count by now."""
        tracked = []
        for name, values in (("gyro", block.gyro_dps), ("accel", block.accel_ms2)):
            if (sensor := self.sensors.get(name)) is not None and values is not None:
                for axis in sensor.names:
                    sensor.go_by(axis, self._settled(axis))
                tracked.append(sensor.run(values))
        return tuple(tracked)

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


def _offsets(config: EstimatorConfig, axes: int) -> list[float | None]:
    """Return the offsets that the settings give."""
    bias = config.bias
    if isinstance(bias, str):
        return [None] * axes
    return list(bias) if isinstance(bias, list) else [bias] * axes
