"""The stage that says what the bias of each axis is now, by the noise that the live fit has found.

It takes samples in the walk of the live fit, whose settled answers count from the sample with which they are
there and which leaves out what is motion here. It has estimates from the first samples on: until an answer is
stable, or half a minute long, a bank of random walks stands for the noise.
"""

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from msgspec.structs import replace as with_fields

from fltea.estimator.offset_walk import CONSTANT, system_of
from fltea.estimator.tracker import Tracker
from fltea.noise.heading import heading_std, rested
from fltea.noise.left_open import distance
from fltea.noise.parts import Part
from fltea.noise.system import System, system
from fltea.records.arrays import Array
from fltea.records.block import Block, Tracked, TrackedColumns, with_tracked
from fltea.records.events import Ints
from fltea.records.fit import Interval
from fltea.records.records import ACCEL_UNIT, GYRO_UNIT
from fltea.records.stats import TrackerStats
from fltea.settings.config import Config
from fltea.settings.estimator import EstimatorConfig
from fltea.spectrum.innovation_whiteness import describes
from fltea.spectrum.live_axes import Noise
from fltea.spectrum.wording import names
from fltea.stream.live import LiveFits, SettledFit, settled_by
from fltea.stream.stages import Beginning, Item, Saved, Stage, Standing

ENOUGH = 3000
"""Samples: a fit of fewer knows too little of what is slow, and the bank of walks goes on."""
FEWEST, LIKELIER = 300, 30.0
"""Samples, from which on a fit counts that makes them so much likelier than the bank does, in 2 log L."""
AHEAD_S = 1, 10, 60, 600, 3600
GROWTH, APART = 1.5, 0.5
"""A filter is made again for a record that is so much longer, or for a noise so much likelier, by log L."""
DIGITS = 3
"""Of the figures of a fit: the last ones differ between a run and its replay."""
UNDEFINED = Interval()


class SensorTracks:
    """Tracks the biases of one sensor. axes: their names, and which columns of the samples they are."""

    def __init__(self, axes: Mapping[str, int], config: EstimatorConfig, h: float, unit: str) -> None:
        self.names, self._places, self._h, self.unit = tuple(axes), list(axes.values()), h, unit
        self._offsets = _offsets(config, len(self.names))
        self._tracker = Tracker(self._offsets)
        self._walks = [UNDEFINED] * len(self.names)
        self._models: list[tuple[System, Array] | None] = [None] * len(self.names)
        self._headings: list[dict[int, float]] = [{} for _ in self.names]
        self._biases = (np.full(len(self.names), math.nan),) * 2
        self._known: dict[str, SettledFit] = {}
        self._learned: dict[str, Noise] = {}

    def run(self, values: Array) -> TrackedColumns:
        """Take samples, (n, columns)."""
        own = values if len(self._places) == values.shape[1] else values[:, self._places]
        found = self._tracker.run(own)
        if len(own):
            self._biases = found.bias[-1], found.bias_std[-1]
        stands = [self._known[axis].stands if axis in self._known else None for axis in self.names]
        return TrackedColumns(
            self.names,
            self.unit,
            *found,
            tuple(one.verdict if one else None for one in stands),
            tuple(one.alpha if one else UNDEFINED for one in stands),
            tuple(one.f if one else UNDEFINED for one in stands),
        )

    def skip(self, count: int) -> None:
        """Predict over lost samples."""
        self._tracker.skip(count)

    def learn(self, axis: str, settled: SettledFit) -> None:
        """Take what the live fit has found for the noise of an axis, if it is new and sure enough."""
        if settled is self._known.get(axis):
            return
        self._known[axis] = settled
        noise = settled.noise
        if noise is None or noise.samples < FEWEST:
            return
        before = self._learned.get(axis)
        if before is not None and _says_the_same(noise, before, self._h):
            return
        parts, lane = tuple(_rounded(part) for part in noise.parts), self.names.index(axis)
        try:
            if self._offsets[lane] is None:
                found, walk = system_of(
                    parts, self._h, noise.samples, lambda one: self._tracker.likelihood(lane, one)
                )
            else:
                found, walk = system(parts, self._h, noise.samples, found=True), CONSTANT
            if before is None and noise.samples < ENOUGH:
                bank = self._tracker.likelihood_of_walks(lane)
                if not self._tracker.likelihood(lane, found) - bank > LIKELIER:
                    return
            self._tracker.set(lane, found)
            self._walks[lane], self._models[lane] = walk.K(self._h), (found, rested(found, noise.samples))
            if self.unit == GYRO_UNIT:
                self._headings[lane] = {t_s: self.heading_std(axis, t_s) for t_s in AHEAD_S}
        except (ValueError, ArithmeticError):  # at the edge of what is stationary: the last one goes on
            return
        self._learned[axis] = noise

    def heading_std(self, axis: str, t_s: float) -> float:
        """Return the deviation of the integral t_s after a rest as long as the fit's; NaN before a fit."""
        model = self._models[self.names.index(axis)]
        return math.nan if model is None else heading_std(*model, self._h, t_s)

    def stats(self) -> Iterator[tuple[str, TrackerStats]]:
        """Yield how each axis gets on."""
        figures = self._tracker.figures(), self._walks, self._headings, zip(*self._biases, strict=True)
        for axis, one, K, heading, biases in zip(self.names, *figures, strict=True):
            holds = None if one.ljung_box is None else describes(one.innovations, one.ljung_box)
            words = names(map(type, self._learned[axis].parts)) if axis in self._learned else "walks"
            bias, std = (float(x) if math.isfinite(x) else None for x in biases)
            yield (
                axis,
                TrackerStats(words, one.nis, one.lag1, holds, one.moved, one.begun, K, heading, bias, std),
            )

    def save(self) -> bytes:
        """Return what `load` takes."""
        return self._tracker.save()

    def load(self, saved: bytes) -> None:
        """Go on from there; ValueError for what cannot be one's own."""
        self._tracker.load(saved)


class Tracking(Stage):
    """Tracks the biases of both sensors. fits: the live fits; without them the bank of walks goes on."""

    def __init__(self, config: Config, fits: LiveFits | None) -> None:
        self._config, self._fits, self._settled = config, fits, settled_by(fits)
        self._sensors: dict[str, SensorTracks] = {}

    def begin(self, beginning: Beginning) -> None:
        """Begin an epoch, from what was saved if it fits."""
        hello, saved = beginning.hello, beginning.saved or Saved()
        gyro, accel = beginning.axes(self._config.channels)
        h, self._sensors = 1 / hello.rate_hz, {}
        for name, axes, config, unit, data in (
            ("gyro", gyro, self._config.estimator, GYRO_UNIT, saved.gyro_track),
            ("accel", accel, self._config.accel, ACCEL_UNIT, saved.accel_track),
        ):
            if axes:
                self._sensors[name] = sensor = SensorTracks(axes, config, h, unit)
                if data is not None:
                    sensor.load(data)

    def bridge(self, count: int) -> None:
        """Predict over the time for which the program stood still."""
        for sensor in self._sensors.values():
            sensor.skip(count)

    def on_block(self, block: Block, host_ns: Ints, missing: int) -> Iterator[Item]:
        """Give the samples on with their biases, and the fits between them."""
        if missing:
            self.bridge(missing)
        if self._fits is not None:
            return self._fits.walk(block, missing, self._track)
        return iter((with_tracked(block, [self._track(block)]),))

    def _track(self, block: Block) -> Tracked:
        tracked = []
        for name, values in (("gyro", block.gyro_dps), ("accel", block.accel_ms2)):
            if (sensor := self._sensors.get(name)) is not None and values is not None:
                for axis in sensor.names:
                    sensor.learn(axis, self._settled(axis))
                tracked.append(sensor.run(values))
        return tuple(tracked)

    def standing(self) -> Standing:
        """How the trackers get on."""
        return Standing(tracker={axis: one for s in self._sensors.values() for axis, one in s.stats()})

    def save(self) -> dict[str, Any]:
        """What the trackers of both sensors know."""
        return {f"{name}_track": sensor.save() for name, sensor in self._sensors.items()}


def _offsets(config: EstimatorConfig, axes: int) -> list[float | None]:
    """Return the offsets that the settings give."""
    bias = config.bias
    if isinstance(bias, str):
        return [None] * axes
    return list(bias) if isinstance(bias, list) else [bias] * axes


def _says_the_same(noise: Noise, before: Noise, h: float) -> bool:
    """Return whether so little is new that the filter is not made again."""
    if noise.samples > GROWTH * before.samples or noise.drifts != before.drifts:
        return False
    if [type(part) for part in noise.parts] != [type(part) for part in before.parts]:
        return False
    return distance(noise.parts, before.parts, h, noise.samples) < APART


def _rounded(part: Part) -> Part:
    figures = ((name, getattr(part, name)) for name in part.__struct_fields__)
    # A number of samples stays a whole one.
    rounded = {name: x if isinstance(x, int) else float(f"{x:.{DIGITS}g}") for name, x in figures}
    return with_fields(part, **rounded)
