"""Estimate the biases of one sensor in plain Python, one sample at a time.

The native tracker is used, with one sample per call. Other tests compare the native tracker with textbook
filters.
"""

import math
from collections.abc import Iterator
from typing import NamedTuple

import msgspec
import numpy as np
from fltea.estimator.tracker import BY_ACCEL, EventKind, Tracker, TrackerEvent
from fltea.records.estimate import AxisEstimate
from fltea.records.records import Motion, Step
from fltea.records.stats import BiasCheck, TrackerStats
from fltea.settings.estimator import EstimatorConfig
from fltea.settings.live import LiveConfig
from fltea.spectrum.innovation_whiteness import describes
from fltea.stream.tracking import CHECKED_S, rules_of

from tests.rig.plain_sensor import Vector


class SampleTimes(NamedTuple):
    """Number and times of a sample, and the number of its epoch (a run of samples), as in the records of the
    sample.
    """

    seq: int
    epoch: int
    device_us: int
    host_ns: int

    def before(self, samples: int, h: float) -> "SampleTimes":
        """Return number, epoch and times of the sample that came `samples` samples earlier.

        `h`: sampling period [s].
        """
        device_us = self.device_us - round(samples * h * 1e6)
        return SampleTimes(self.seq - samples, self.epoch, device_us, self.host_ns - round(samples * h * 1e9))


class SensorTracks:
    """The bias trackers of all axes of one sensor, from the beginning of an epoch.

    `axes`: names of the axes with their columns in the samples.
    """

    def __init__(
        self, axes: dict[str, int], unit: str, config: EstimatorConfig, live: LiveConfig, rate_hz: float
    ) -> None:
        self._axes, self.unit, self._h, self._bias_s = axes, unit, 1 / rate_hz, live.bias_s
        given = config.bias if isinstance(config.bias, list) else [config.bias] * len(axes)
        offsets = [None if isinstance(one, str) else float(one) for one in given]
        self._tracker = Tracker(offsets, rules_of(live, self._h, unit))
        self._happened: list[TrackerEvent] = []

    def take(self, sample: Vector, accel_ms2: Vector | None) -> dict[str, dict[str, object]]:
        """Update the trackers with one sample.

        For each axis, return the fields of an estimate that its tracker supplies.

        `accel_ms2`: the accelerometer's sample, by which the gyroscope's tracker detects motion as well.
        """
        own = np.array([[sample[column] for column in self._axes.values()]])
        found = self._tracker.run(own, None if accel_ms2 is None else np.array([accel_ms2]))
        self._happened = self._tracker.events
        said: dict[str, dict[str, object]] = {}
        for k, axis in enumerate(self._axes):
            numbers = {name: float(getattr(found, name)[0, k]) for name in found._fields[:5]}
            said[axis] = {name: None if math.isnan(one) else one for name, one in numbers.items()}
            said[axis]["moving"] = bool(found.moving[0, k])
        return said

    def happened(self, times: SampleTimes, device: str | None) -> Iterator[Step | Motion]:
        """Yield a record for each step and motion that the newest sample revealed. `times`: number and times
        of that sample.
        """
        names = tuple(self._axes)
        for one in self._happened:
            began = times.before(max(one.ago - 1, 0), self._h)
            if one.kind == EventKind.STEP:
                axis, size = names[one.axis], (one.size, one.size_std)
                yield Step(*began, axis, self.unit, *size, found_after=one.ago, device=device)
                continue
            begins = one.kind == EventKind.MOVES
            by = "accel" if one.axis == BY_ACCEL else names[one.axis]
            after = (None, None) if begins else (one.samples, one.size)
            yield Motion(*began, begins, by, *after, device=device)

    def miss(self, count: int) -> None:
        """Predict the bias over `count` lost samples."""
        self._tracker.skip(count)

    def stats(self) -> Iterator[tuple[str, TrackerStats]]:
        """Yield the tracker's statistics for each axis. The oracle has no live fits, so the tracker's model
        is always that before the first fit.
        """
        for axis, one in zip(self._axes, self._tracker.figures(), strict=True):
            checked = zip(CHECKED_S, one.checked, strict=True)
            yield (
                axis,
                TrackerStats(
                    model="walks",
                    nis=one.nis,
                    lag1=one.lag1,
                    holds=None if one.ljung_box is None else describes(one.innovations, one.ljung_box),
                    moved=one.moved,
                    restarts=one.begun,
                    bias=one.bias,
                    bias_std=one.bias_std,
                    steps=one.steps,
                    moving=self._tracker.moving,
                    checked={t_s: BiasCheck(c.pieces, c.rms) for t_s, c in checked if c.rms is not None},
                    bias_for_s=self._bias_s,
                ),
            )


def with_tracks(estimate: AxisEstimate, of_axis: dict[str, object]) -> AxisEstimate:
    """Return an estimate with the fields that the tracker of its axis supplies."""
    return msgspec.structs.replace(estimate, **of_axis)
