"""Processes a sensor's samples as the daemon does: runs the tracker, and makes fits as the record grows."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from fltea.estimator.tracker import EventKind
from fltea.records.arrays import Array, Mask
from fltea.settings.estimator import EstimatorConfig
from fltea.settings.live import LiveConfig
from fltea.spectrum.live_axes import LiveAxes
from fltea.stream.happenings import left_out
from fltea.stream.live import NO_FIT
from fltea.stream.tracking import SensorTracks

AXES = 3
"""Number of axes of a sensor. If an array of samples has more columns, they belong to several sensors."""
GROWTH = 10
"""From one accepted fit to the next, a record grows by 1/GROWTH, as in `fltea.stream.fit_times`."""


class StepEvent(NamedTuple):
    """A step of the bias that the tracker has reported."""

    axis: str
    at_s: float
    size: float
    """Size of the step, in the unit of the samples."""


class Lived(NamedTuple):
    """What the daemon publishes while it processes n samples of each axis, as arrays (n, axes)."""

    bias: Array
    bias_std: Array
    state: Array
    moving: Mask


class LiveSensor:
    """Processes the samples of one sensor as the daemon does. `h`: sampling period [s].

    A fit is accepted after the first second, and then again as the record grows. The tracker uses the
    accepted fit from the next sample on.
    """

    def __init__(self, axes: int, h: float, unit: str = "deg/s") -> None:
        places = {f"{axis}": axis for axis in range(axes)}
        self._live = LiveAxes(tuple(places), h, LiveConfig(), unit)
        self._tracks = SensorTracks(places, EstimatorConfig(), LiveConfig(), h, unit)
        self._h = h
        self._events: list[StepEvent] = []
        self._settled = dict.fromkeys(places, NO_FIT)
        self._at, self._second = 0, round(1 / h)
        self._due = self._second

    def run(self, y: Array) -> Lived:
        """Process at least one sample (n, axes), and return what is published for them."""
        found, begin = [], 0
        while begin < len(y):
            end = min(len(y), begin + self._due - self._at)
            for axis, accepted in self._settled.items():
                self._tracks.use_model(axis, accepted)
            found.append(self._tracks.run(y[begin:end]))
            events = self._tracks.events
            self._live.add(y[begin:end], left_out(found[-1].moving, events))
            self._events += [
                StepEvent(
                    self._tracks.names[one.axis], (self._at + one.row + 1 - one.ago) * self._h, one.size
                )
                for one in events
                if one.kind == EventKind.STEP
            ]
            self._at += end - begin
            begin = end
            if self._at == self._due:
                self._fit()
        columns = ([getattr(piece, name) for piece in found] for name in Lived._fields)
        return Lived._make(np.concatenate(column) for column in columns)

    def _fit(self) -> None:
        fits = self._live.refits(curves=False, fresh=True)
        self._settled = {
            axis: self._settled[axis].followed_by(fit(), self._tracks.maker(axis))
            for axis, fit in fits.items()
        }
        self._due = self._at + max(self._second, math.ceil(self._at / GROWTH))

    @property
    def restarts(self) -> int:
        """Total number of restarts of all axes' trackers because the offset had changed."""
        return sum(figures.restarts for _, figures in self._tracks.stats())

    def events(self) -> list[StepEvent]:
        """Return the steps of the bias that the tracker has reported so far."""
        return self._events


def live_way(y: Array, h: float) -> Lived:
    """Return what the daemon would publish for samples (n, axes) of several sensors with AXES axes each."""
    found = [LiveSensor(part.shape[1], h).run(part) for part in sensors(y)]
    return Lived._make(np.concatenate(column, axis=1) for column in zip(*found, strict=True))


def sensors(y: Array) -> Sequence[Array]:
    """Return the columns of `y` (n, axes), sensor by sensor."""
    return [y[:, first : first + AXES] for first in range(0, y.shape[1], AXES)]
