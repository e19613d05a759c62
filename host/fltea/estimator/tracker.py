"""Estimate the present bias of each axis, with its σ, by the filter of the noise that was found.

The bias is the sensor's offset plus the state of its noise. Until the noise is known, a bank of random walks
and relaxations stands for it (host/native/walk_bank.hpp). When the noise model changes, the samples that a
filter remembers are filtered again, so that the state is that of the newest model from then on. While the
sensor moves, all axes predict. Where the bias of an axis steps, its filter restarts.

The bias is a forecast: the mean of offset and state that is expected over the next samples.
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
    """The estimates after every sample, (n, axes); NaN while they are unknown."""

    state: Array
    state_std: Array
    bias: Array
    """Offset plus state."""
    bias_std: Array
    innovation: Array
    """Measurement minus prediction."""
    moving: Mask


class Rest(IntEnum):
    """What the caller knows about a sensor: nothing, that it is at rest, or that it moves."""

    UNKNOWN = 0
    AT_REST = 1
    MOVING = 2


class EventKind(IntEnum):
    """What can happen at a sample: the bias of an axis steps, motion begins, or motion ends."""

    STEP = 0
    MOVES = 1
    RESTS = 2


BY_ACCEL, BY_CALLER = -1, -2
"""What detected motion, in place of an axis: the accelerometer, or the caller."""


class TrackerEvent(NamedTuple):
    """An event, detected at the sample `row` of a call."""

    kind: EventKind
    row: int
    axis: int
    """Axis of a step; or the axis that detected motion, BY_ACCEL or BY_CALLER."""
    ago: int
    """Number of samples since the event began, the newest included; 0 for the end of motion."""
    size: float
    """Size of a step, in the samples' unit; for the end of motion, the largest distance from the bias."""
    size_std: float
    samples: int
    """Length of the motion that ends, in samples."""


class TrackerRules(NamedTuple):
    """Settings of a tracker, in samples and in their unit.

    `ahead`: number of coming samples for which the bias is meant; 0: only the newest sample. `checked`:
    lengths over which the bias is checked. `largest_step`: a larger change within a second is motion, not a
    step. `largest_gravity_step`: the same for the accelerometer. `still`: number of samples at rest at
    another value after which that value is the new offset, if `settles`, if the caller says that the sensor
    is at rest, or if the value is nearer to 0. `patience`: number of samples after which it is the new offset
    in any case.
    """

    ahead: int = 0
    checked: tuple[int, ...] = ()
    largest_step: float = math.inf
    largest_gravity_step: float = 0.1
    still: int = 1024
    patience: int = 60_000
    settles: bool = True


class Checked(NamedTuple):
    """The bias compared with the means of `pieces` later pieces of samples.

    `rms`: root mean square of the error over σ; None without a piece.
    """

    pieces: int
    rms: float | None


class TrackerFigures(NamedTuple):
    """Figures of an axis's tracker; those of the innovations are None until there are enough."""

    moved: int
    """Number of samples in motion."""
    begun: int
    """Number of restarts at an offset that had changed."""
    steps: int
    """Number of steps of the bias."""
    lag1: float | None
    nis: float | None
    ljung_box: float | None
    innovations: int
    checked: tuple[Checked, ...]
    bias: float | None
    """Bias after the newest sample; None while it is unknown."""
    bias_std: float | None


class Remembered:
    """The samples of an axis that a tracker remembered at some time; may be used in any thread."""

    def __init__(self, native: _native.Remembered) -> None:
        self.native = native

    def likelihood(self, system: System) -> float:
        """Return 2 log L of the samples with such a noise, up to a constant; NaN without a filter.

        Raises ValueError for an invalid system.
        """
        return self.likelihoods(system, [()])[0]

    def likelihoods(self, bare: System, more: Sequence[Sequence[Coordinate]]) -> list[float]:
        """Return 2 log L of the samples for the system with each of these sets of states added."""
        return self.native.likelihoods(bare.numbers, more)

    def likelihood_of_walks(self) -> float:
        """Return 2 log L of the bank of walks; NaN before it has enough samples, or once a system is set."""
        return self.native.of_walks()


class TrackerModel:
    """A noise model for the tracker of an axis; made in any thread, for trackers with the same rules.

    `rival`: a rival model with the same number of states; later samples decide between both. `likely`:
    present probability of the first model.

    Raises ValueError if no filter works with the model.
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
        """Filter the remembered samples, in any thread, so that less work is left to `Tracker.go_by`.

        `to_come`: number of samples that the tracker takes until `Tracker.go_by`, at most MOST_TO_COME. If
        more has happened by then, or fewer samples came, the tracker filters everything itself. The results
        are the same, except that the test of steps knows the innovations only up to `remembered`.

        Raises ValueError for more samples.
        """
        self.native.refilter(remembered.native, to_come)


MOST_TO_COME = _native.TrackerModel.MOST_TO_COME
"""Most samples that may come between the filtering of remembered samples and `Tracker.go_by`."""


AT_ONCE = 1 << 14
"""Number of rows of a long recording taken at once, so that their results fit the caches."""


class Tracker:
    """Tracks the biases of the axes of one sensor.

    `offsets`: known offset of each axis, None if it is not known.
    """

    def __init__(self, offsets: Sequence[float | None], rules: TrackerRules | None = None) -> None:
        self.rules = rules = rules or TrackerRules()
        ahead, checked, step, gravity_step, still, patience, settles = rules
        self._checks = len(checked)
        self.native = _native.Tracker(
            list(offsets), ahead, list(checked), step, gravity_step, still, patience, settles
        )
        self.events: list[TrackerEvent] = []
        """What happened during the samples of the last call of `run`."""

    def run(self, y: ArrayLike, accel: ArrayLike | None = None, rest: Rest = Rest.UNKNOWN) -> Tracks:
        """Take n samples of every axis, (n, axes); the results do not depend on the blocks, to the bit.

        `accel`: simultaneous samples of the accelerometer, (n, 1 to 3) [m/s²], which help to detect motion.

        Raises ValueError, and changes nothing, for a wrong shape, and for numbers that are not finite or far
        too large.
        """
        rows = np.ascontiguousarray(y, dtype=np.float64)
        out, moving = np.empty((5, *rows.shape)), np.empty(rows.shape, dtype=np.uint8)
        of_accel = None if accel is None else np.ascontiguousarray(accel, dtype=np.float64)
        self.events = events_of(self.native.run(rows, out, moving, of_accel, int(rest)))
        return Tracks._make((*out, moving.view(np.bool_)))

    def take(self, y: Array) -> None:
        """Take samples of one axis, (n,), if only the state after the last one is wanted."""
        for begin in range(0, len(y), AT_ONCE):
            self.run(y[begin : begin + AT_ONCE, None])

    def skip(self, count: int) -> None:
        """Predict over lost samples of all axes."""
        self.native.skip(count)

    def set(self, lane: int, system: System, rival: System | None = None, likely: float = 1.0) -> None:
        """Make a model as `TrackerModel` does, and use it for an axis.

        Raises ValueError, and changes nothing, if no filter works with it.
        """
        self.go_by(lane, TrackerModel(self.rules, system, rival, likely))

    def go_by(self, lane: int, model: TrackerModel) -> None:
        """Use this noise model for an axis, from the next sample on.

        Raises ValueError, and changes nothing, if no filter works with it.
        """
        self.native.set(lane, model.native)

    def remembered(self, lane: int) -> Remembered:
        """Return the samples of an axis that the tracker remembers now."""
        return Remembered(self.native.remembered(lane))

    def x(self, lane: int) -> tuple[float, Array]:
        """Return the origin of an axis's values, and its system's state x from there, after the last sample.

        Without a system x is empty.
        """
        origin, x = self.native.x(lane)
        return origin, np.array(x)

    @property
    def moving(self) -> bool:
        """Whether the sensor moves."""
        return self.native.moving()

    def figures(self) -> list[TrackerFigures]:
        """Return the figures of each axis's tracker."""
        found = []
        for moved, begun, steps, lag1, nis, ljung_box, n, checks, *biases in self.native.stats():
            known = checks[: self._checks]
            checked = tuple(Checked(pieces, rms if pieces else None) for pieces, rms in known)
            whiteness = _finite(lag1), _finite(nis), _finite(ljung_box)
            found.append(TrackerFigures(moved, begun, steps, *whiteness, n, checked, *map(_finite, biases)))
        return found

    def save(self) -> bytes:
        """Return the tracker's state for `load`."""
        return self.native.save()

    def load(self, saved: bytes) -> None:
        """Continue from a saved state. Raises ValueError, and changes nothing, for an invalid one."""
        self.native.load(saved)


def events_of(native: Sequence[tuple[int, int, int, int, float, float, int]]) -> list[TrackerEvent]:
    """Return the events that `_native.Tracker.run` reports."""
    return [TrackerEvent._make((EventKind(kind), *rest)) for kind, *rest in native]


def _finite(x: float) -> float | None:
    return x if math.isfinite(x) else None
