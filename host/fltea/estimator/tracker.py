"""The tracker says what the bias of each axis is now, with its σ: the filter of the noise that was found.

The bias is the sensor's offset and the state of its noise. Until the noise is known, a bank of random walks
and relaxations stands for it (host/native/walk_bank.hpp). The samples that a filter remembers are filtered
again when the noise is found to be another one, so that the state is that of the newest model from then on.
Where the sensor is moved, all axes predict. Where the bias of an axis steps, its filter begins there again.

The bias is a forecast: the mean that is expected of offset and state over the next samples.
"""

import math
from collections.abc import Sequence
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from fltea import _native
from fltea.noise.system import Coordinate, System
from fltea.records.arrays import Array, Mask


class Tracks(NamedTuple):
    """What is known after every sample, (n, axes); NaN where nothing is yet."""

    state: Array
    state_std: Array
    bias: Array
    """offset and state"""
    bias_std: Array
    innovation: Array
    """measurement minus prediction"""
    moving: Mask


class Rest(IntEnum):
    """What the caller knows of a sensor: nothing, that it is at rest, or that it moves."""

    UNKNOWN = 0
    AT_REST = 1
    MOVING = 2


class EventKind(IntEnum):
    """What can happen with a sample: the bias of an axis has stepped; motion has begun; it has ended."""

    STEP = 0
    MOVES = 1
    RESTS = 2


BY_ACCEL, BY_CALLER = -1, -2
"""Who has shown motion, in place of an axis."""


class TrackerEvent(NamedTuple):
    """What has happened, known with the sample `row` of a call."""

    kind: EventKind
    row: int
    axis: int
    """Of a step: its axis. Of motion: the axis that has shown it, BY_ACCEL or BY_CALLER."""
    ago: int
    """Samples since it began, the newest included; of motion that ends 0."""
    size: float
    """Of a step, in the samples' unit; of motion that ends, how far from the bias a sample was at most."""
    size_std: float
    samples: int
    """How long the motion that ends was."""


class TrackerRules(NamedTuple):
    """What a tracker goes by, in samples and in their unit.

    ahead: samples to come for which the bias is meant; 0: it is that of the newest sample. checked: lengths
    over which it is checked. largest_step: farther a bias does not step within a second; what does is motion.
    largest_gravity_step: the same of the accelerometer. still: the number of samples that lie still elsewhere
    from which on there is where the offset is now, if `settles`, the caller says so, or there is nearer to 0;
    patience: from which on that is so anyway.
    """

    ahead: int = 0
    checked: tuple[int, ...] = ()
    largest_step: float = math.inf
    largest_gravity_step: float = 0.1
    still: int = 1024
    patience: int = 60_000
    settles: bool = True


class Checked(NamedTuple):
    """The bias beside the means of so many pieces of the samples that came: rms over σ; None without one."""

    pieces: int
    rms: float | None


class TrackerFigures(NamedTuple):
    """How the tracker of an axis gets on; figures of innovations are None before there are enough."""

    moved: int
    """samples in motion"""
    begun: int
    """how often it began again, at an offset that had changed"""
    steps: int
    """steps of the bias"""
    lag1: float | None
    nis: float | None
    ljung_box: float | None
    innovations: int
    checked: tuple[Checked, ...]
    bias: float | None
    """after the newest sample; None where nothing is known yet"""
    bias_std: float | None


class Remembered:
    """What a tracker remembers of the samples of an axis, as it was; it may be asked in any thread."""

    def __init__(self, native: _native.Remembered) -> None:
        self.native = native

    def likelihood(self, system: System) -> float:
        """Return 2 log L of them with such a noise, but for a constant; NaN without a filter.

        Raises ValueError for what is no system.
        """
        return self.likelihoods(system, [()])[0]

    def likelihoods(self, bare: System, more: Sequence[Sequence[Coordinate]]) -> list[float]:
        """Return the same of a system with each of these coordinates more."""
        return self.native.likelihoods(bare.numbers, more)

    def likelihood_of_walks(self) -> float:
        """Return the same of the bank of walks; NaN before it knew enough, and once a system was set."""
        return self.native.of_walks()


class TrackerModel:
    """A noise as the tracker of an axis goes by it: made in any thread, for trackers with the same rules.

    rival: what the noise may be, too, with as many coordinates; the samples tell which of them it is. likely:
    how likely the first one is by now.

    Raises ValueError if no filter can work with it.
    """

    def __init__(
        self, rules: TrackerRules, system: System, rival: System | None = None, likely: float = 1.0
    ) -> None:
        systems = [system] if rival is None else [system, rival]
        weights = [1.0] if rival is None else [likely, 1 - likely]
        absolute = any(one.walks for one in systems)
        numbers = [one.numbers for one in systems]
        self.native = _native.TrackerModel(rules.ahead, list(rules.checked), absolute, weights, numbers)

    def refilter(self, remembered: Remembered, to_come: int) -> None:
        """Filter what a tracker remembers, in any thread, so that less is left to `Tracker.go_by`.

        to_come: the samples that the tracker takes from then until `Tracker.go_by`, MOST_TO_COME at most. If
        more has happened by then, or fewer samples came, the tracker does it all itself: what comes out is
        the same, but for what the test of steps knows of innovations: that is as of `remembered`.

        Raises ValueError for more samples.
        """
        self.native.refilter(remembered.native, to_come)


MOST_TO_COME = _native.TrackerModel.MOST_TO_COME
"""Samples to come, before which what is remembered can be filtered."""


AT_ONCE = 1 << 14
"""Rows of a long recording, so that what is made of them fits the caches."""


class Tracker:
    """Tracks the biases of the axes of one sensor.

    offsets: what the sensor adds to each axis, None where that is not known.
    """

    def __init__(self, offsets: Sequence[float | None], rules: TrackerRules | None = None) -> None:
        self.rules = rules = rules or TrackerRules()
        ahead, checked, step, gravity_step, still, patience, settles = rules
        self._checks = len(checked)
        self.native = _native.Tracker(
            list(offsets), ahead, list(checked), step, gravity_step, still, patience, settles
        )
        self.events: list[TrackerEvent] = []
        """What has happened with the samples of the last call of `run`."""

    def run(self, y: ArrayLike, accel: ArrayLike | None = None, rest: Rest = Rest.UNKNOWN) -> Tracks:
        """Take n samples of every axis, (n, axes): the same, to the bit, however they are cut into blocks.

        accel: samples of the sensor's accelerometer at the same instants, (n, 1 to 3) in m/s²; by them, too,
        it is known whether the sensor moves.

        Raises ValueError, and changes nothing, for a wrong shape, and for numbers that are not finite or
        beyond all measure.
        """
        rows = np.ascontiguousarray(y, dtype=np.float64)
        out, moving = np.empty((5, *rows.shape)), np.empty(rows.shape, dtype=np.uint8)
        of_accel = None if accel is None else np.ascontiguousarray(accel, dtype=np.float64)
        self.events = events_of(self.native.run(rows, out, moving, of_accel, int(rest)))
        return Tracks._make((*out, moving.view(np.bool_)))

    def take(self, y: Array) -> None:
        """Take samples of one axis, (n,), of which only what is known at the end is wanted."""
        for begin in range(0, len(y), AT_ONCE):
            self.run(y[begin : begin + AT_ONCE, None])

    def skip(self, count: int) -> None:
        """Predict over lost samples of all axes."""
        self.native.skip(count)

    def set(self, lane: int, system: System, rival: System | None = None, likely: float = 1.0) -> None:
        """Make the model of a noise, as `TrackerModel` does, and go by it.

        Raises ValueError, and changes nothing, if no filter can work with it.
        """
        self.go_by(lane, TrackerModel(self.rules, system, rival, likely))

    def go_by(self, lane: int, model: TrackerModel) -> None:
        """Take this for the noise of an axis, from the next sample on.

        Raises ValueError, and changes nothing, if no filter can work with it.
        """
        self.native.set(lane, model.native)

    def remembered(self, lane: int) -> Remembered:
        """Return what it remembers of the samples of an axis, as it is now."""
        return Remembered(self.native.remembered(lane))

    def x(self, lane: int) -> tuple[float, Array]:
        """Return where the numbers of an axis begin, and from there x of its system after the newest sample.

        Without a system there are no coordinates.
        """
        origin, x = self.native.x(lane)
        return origin, np.array(x)

    @property
    def moving(self) -> bool:
        """Whether the sensor moves."""
        return self.native.moving()

    def figures(self) -> list[TrackerFigures]:
        """Tell how each axis gets on."""
        found = []
        for moved, begun, steps, lag1, nis, ljung_box, n, checks, *biases in self.native.stats():
            known = checks[: self._checks]
            checked = tuple(Checked(pieces, rms if pieces else None) for pieces, rms in known)
            whiteness = _finite(lag1), _finite(nis), _finite(ljung_box)
            found.append(TrackerFigures(moved, begun, steps, *whiteness, n, checked, *map(_finite, biases)))
        return found

    def save(self) -> bytes:
        """Return what `load` takes."""
        return self.native.save()

    def load(self, saved: bytes) -> None:
        """Go on from there. Raises ValueError, and changes nothing, for what cannot be one's own."""
        self.native.load(saved)


def events_of(native: Sequence[tuple[int, int, int, int, float, float, int]]) -> list[TrackerEvent]:
    """Return what has happened, as `_native.Tracker.run` tells it."""
    return [TrackerEvent._make((EventKind(kind), *rest)) for kind, *rest in native]


def _finite(x: float) -> float | None:
    return x if math.isfinite(x) else None
