"""Estimate the present bias of each axis, with its σ, by a filter for the axis's noise model.

The bias is the sensor's offset plus the state of its noise. Until the noise is known, a bank of filters is
used: each assumes a random walk or a relaxation (first-order Gauss-Markov process) of its own
(host/native/walk_bank.hpp). When the noise model changes, the samples that the tracker remembers are filtered
again with the new model. While the sensor moves, the filters of all axes only predict. When the bias of an
axis jumps (a step), the filter of that axis restarts.

The bias is a forecast: the mean of offset and state that is expected over the next samples.
"""

import math
from collections.abc import Sequence
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from fltea import _native
from fltea.noise.linear_system import Coordinate, System
from fltea.records.arrays import Array, Mask


class Tracks(NamedTuple):
    """The estimates after every sample, (n, axes); NaN while an estimate is unknown."""

    state: Array
    state_std: Array
    bias: Array
    """Bias: the sensor's offset plus the state of its noise."""
    bias_std: Array
    innovation: Array
    """Measurement minus prediction."""
    moving: Mask


class Rest(IntEnum):
    """What the caller knows about a sensor's motion: nothing, that the sensor rests, or that it moves."""

    UNKNOWN = 0
    AT_REST = 1
    MOVING = 2


class EventKind(IntEnum):
    """What can happen at a sample: the bias of an axis steps, motion begins, or motion ends."""

    STEP = 0
    MOVES = 1
    RESTS = 2


BY_ACCEL, BY_CALLER = -1, -2
"""Values of `TrackerEvent.axis` if the accelerometer (`BY_ACCEL`) or the caller (`BY_CALLER`) detected the
motion.
"""


class TrackerEvent(NamedTuple):
    """A step of the bias, or the begin or end of motion.

    `row`: index of the sample that shows the event. Indices count from the first sample of the call.
    """

    kind: EventKind
    row: int
    axis: int
    """Axis whose bias stepped. For motion: the axis that detected the motion, or BY_ACCEL or BY_CALLER."""
    ago: int
    """Number of samples since the event began, including the newest sample; 0 for the end of motion."""
    size: float
    """Size of a step, in the unit of the samples. For the end of motion: largest distance of a sample from
    the bias during the motion.
    """
    size_std: float
    samples: int
    """Length of the motion that ends, in samples."""


class TrackerRules(NamedTuple):
    """Settings of a tracker; times are in samples, sizes in the unit of the samples.

    `ahead`: number of coming samples whose mean bias is estimated; 0 means the newest sample alone.
    `checked`: for each number n in it, the bias is compared with the mean of the next n samples.
    `largest_step`: a larger change within a second is motion, not a step. `largest_gravity_step`: a larger
    change of the accelerometer's samples within a second is motion. `still`: if the samples stay at another
    value than the bias for this many samples, the value becomes the new offset. This holds only if `settles`
    is set, if the caller knows that the sensor is at rest, or if the value is nearer to 0 than the bias.
    Otherwise the sensor may be rotating. `patience`: after this many samples at another value, the value
    becomes the new offset in any case.
    """

    ahead: int = 0
    checked: tuple[int, ...] = ()
    largest_step: float = math.inf
    largest_gravity_step: float = 0.1
    still: int = 1024
    patience: int = 60_000
    settles: bool = True


class Checked(NamedTuple):
    """How well the bias agreed with the samples that came later.

    `pieces`: number of means of later samples with which the bias was compared. `rms`: root mean square of
    the differences, each divided by its σ; None before the first mean is complete.
    """

    pieces: int
    rms: float | None


class TrackerFigures(NamedTuple):
    """Figures that tell how well the tracker of an axis works.

    Figures of the innovations are None until there are enough innovations.
    """

    moved: int
    """Number of samples during motion."""
    begun: int
    """Number of restarts of the filter because the offset had changed."""
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
    """A copy of the samples of an axis that a tracker remembers. Any thread may use it."""

    def __init__(self, native: _native.Remembered) -> None:
        self.native = native

    def likelihood(self, system: System) -> float:
        """Return 2 log L, up to a constant. L: likelihood of the samples if `system` is the noise model.

        The result is NaN if a filter with this model gives no finite numbers. Raises ValueError for an
        invalid system.
        """
        return self.likelihoods(system, [()])[0]

    def likelihoods(self, bare: System, more: Sequence[Sequence[Coordinate]]) -> list[float]:
        """Return 2 log L of the samples for several noise models, one for each entry of `more`.

        The model consists of `bare` and of the states in the entry, such as those of a drift.
        """
        return self.native.likelihoods(bare.numbers, more)

    def likelihood_of_walks(self) -> float:
        """Return 2 log L of the samples for the bank of models (random walks).

        A tracker uses the bank before it has a noise model. The result is NaN if there are too few samples,
        or if the tracker has a noise model.
        """
        return self.native.of_walks()


class TrackerModel:
    """A noise model for the tracker of an axis, which any thread may make.

    The tracker that uses the model must have the same `rules`. `rival`: a second model with the same number
    of states; later samples decide between `system` and `rival`. `likely`: present probability of `system`.

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
        """Filter the remembered samples, in any thread, so that less work is left to `Tracker.use_model`.

        `to_come`: number of samples that the tracker will process before `Tracker.use_model`, at most
        MOST_TO_COME. If an event happens before that, or if fewer samples come, the tracker filters all
        samples itself, as if `refilter` had not been called. Otherwise the results differ in one point: the
        statistics with which the test for steps begins are those at the time of `remembered`.

        Raises ValueError if `to_come` is larger than MOST_TO_COME.
        """
        self.native.refilter(remembered.native, to_come)


MOST_TO_COME = _native.TrackerModel.MOST_TO_COME
"""Largest `to_come` that `TrackerModel.refilter` accepts: at most so many new samples may come between
`refilter` and `Tracker.use_model`.
"""


AT_ONCE = 1 << 14
"""Number of samples of a long recording that one call processes, so that the results fit the processor's
caches.
"""


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
        """Steps and motions among the samples of the last call of `run`."""

    def run(self, y: ArrayLike, accel: ArrayLike | None = None, rest: Rest = Rest.UNKNOWN) -> Tracks:
        """Process n samples of every axis, (n, axes).

        The results do not depend on how samples are grouped into blocks.

        `accel`: simultaneous samples of the accelerometer, (n, 1 to 3) [m/s²], which help to detect motion.
        `rest`: what the caller knows about the motion.

        Raises ValueError, and changes nothing, for a wrong shape, and for numbers that are not finite or far
        too large.
        """
        rows = np.ascontiguousarray(y, dtype=np.float64)
        out, moving = np.empty((5, *rows.shape)), np.empty(rows.shape, dtype=np.uint8)
        of_accel = None if accel is None else np.ascontiguousarray(accel, dtype=np.float64)
        self.events = events_of(self.native.run(rows, out, moving, of_accel, int(rest)))
        return Tracks._make((*out, moving.view(np.bool_)))

    def take(self, y: Array) -> None:
        """Process samples (n,) of one axis, without results for each sample.

        Only the state after the last sample is kept.
        """
        for begin in range(0, len(y), AT_ONCE):
            self.run(y[begin : begin + AT_ONCE, None])

    def skip(self, count: int) -> None:
        """Let the filters of all axes predict over `count` lost samples."""
        self.native.skip(count)

    def set(self, lane: int, system: System, rival: System | None = None, likely: float = 1.0) -> None:
        """Make a `TrackerModel`, and use it for the axis with index `lane`.

        Raises ValueError, and changes nothing, if no filter works with it.
        """
        self.use_model(lane, TrackerModel(self.rules, system, rival, likely))

    def use_model(self, lane: int, model: TrackerModel) -> None:
        """Use this noise model for an axis, from the next sample on.

        Raises ValueError, and changes nothing, if no filter works with it.
        """
        self.native.set(lane, model.native)

    def remembered(self, lane: int) -> Remembered:
        """Return the samples of an axis that the tracker remembers now."""
        return Remembered(self.native.remembered(lane))

    def x(self, lane: int) -> tuple[float, Array]:
        """Return a constant c of an axis, and the state x of its noise model after the last sample.

        The tracker subtracts c from each sample, and the noise model describes what is left. Without a noise
        model x is empty.
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
