"""Find steps of a sensor's biases and motion in a recording, and the biases at its end.

The tracker is the one that the daemon runs live. Here it runs over all axes of a sensor together, and over
its accelerometer if there is one. It uses the noise model that was found for each axis.
"""

import contextlib
import math
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from itertools import pairwise
from typing import NamedTuple

import msgspec
import numpy as np

from fltea.estimator.tracker import AT_ONCE, EventKind, Tracker, TrackerEvent
from fltea.identification.fine_peaks import CHUNK
from fltea.identification.forecast import BiasAtEnd
from fltea.identification.forecast_judge import FittedSystem
from fltea.identification.gaps import LONGEST_PREDICTION, cut
from fltea.identification.left_out import NOTHING, LeftOut
from fltea.identification.load import GYRO_UNIT, Series
from fltea.identification.motion import IN_A_ROW, is_smooth
from fltea.identification.telegraph import without_levels
from fltea.noise.linear_system import System
from fltea.noise.parts import Part, Relaxation, White
from fltea.noise.system import system
from fltea.records.arrays import Array, Mask
from fltea.settings.live import LiveConfig
from fltea.stream.happenings import BY
from fltea.stream.tracking import rules_of

LONG = IN_A_ROW * CHUNK
"""A span of more samples than this counts as motion only if the rate changes smoothly from sample to sample.

Otherwise the span is noise whose power has grown, which the verdict reports.
"""
FAST_S = 1.0
"""A relaxation (a first-order Gauss-Markov process) whose correlation time is at most this [s] cannot be
mistaken for steps of the bias.
"""
BETTER = 10.0
"""Two models of an axis are compared: one with a moving bias, one whose bias is constant between steps. The
second is used if its log likelihood is higher than that of the first by more than this.
"""
COURSE_POINTS = 500


class BiasStep(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A step of an axis's bias.

    `size` and `size_std` are in the unit of the axis. `at_s`: time of the step since the beginning of the
    recording [s].
    """

    at_s: float
    size: float
    size_std: float


class MotionSpan(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A time span of motion of the sensor; begin and end are in s since the beginning of the recording."""

    begin_s: float
    end_s: float
    by: str
    """The axis that showed the motion, or `accel`."""
    largest: float | None
    """Largest distance of a sample from the bias during the motion, in `unit`; null if the sensor still moved
    at the end of the recording or at a long gap.
    """
    unit: str


class BiasCourse(NamedTuple):
    """The course of Bias(T) and its σ over a recording, taken at up to `COURSE_POINTS` samples."""

    t_s: Array
    bias: Array
    bias_std: Array


class AxisEvents(NamedTuple):
    """Steps, motion and bias of one axis.

    If there is no noise model of the axis, only motion is known.
    """

    steps: tuple[BiasStep, ...] = ()
    motion: tuple[MotionSpan, ...] = ()
    left_out: LeftOut = NOTHING
    """Samples that the spectral analysis has to leave out."""
    at_end: BiasAtEnd | None = None
    course: BiasCourse | None = None


NO_EVENTS = AxisEvents()


def watch(
    axes: Mapping[str, Series],
    accel: Sequence[Array],
    tracked: Mapping[str, FittedSystem | None],
    h: float,
    live: LiveConfig,
) -> dict[str, AxisEvents]:
    """Return steps, motion and bias of each axis of a recording. All axes of a sensor have the same motion.

    The accelerometer beside a gyroscope shows the gyroscope's motion, too. For the accelerometer, a motion
    lasts until the sensor lies still again in its new position.

    Args:
        axes: all samples as they were read. Telegraph noise is removed before tracking, so steps between its
            levels are not returned.
        accel: samples (n,) of each axis of the accelerometer [m/s²]; empty if there is none.
        tracked: the state-space model for the tracker of each axis, by the axis's name.
        h: sampling period [s].
        live: settings of the tracker.
    """
    axes = {name: without_levels(one, h)[0] for name, one in axes.items()}
    gyro = {name: one for name, one in axes.items() if one.unit == GYRO_UNIT}
    others = {name: one for name, one in axes.items() if name not in gyro}
    systems = {name: None if one is None else one.system for name, one in tracked.items()}
    staying = _staying(tracked, h)
    runs: list[tuple[Future[_SensorRun], Future[_SensorRun] | None]] = []
    with ThreadPoolExecutor(2) as pool:  # nearly all the work is native code, which threads do in parallel
        for group, shown in ((gyro, accel), (others, ())):
            if group:
                other = None
                if not staying.keys().isdisjoint(group):
                    other = pool.submit(_SensorRun, group, shown, systems | staying, h, live)
                runs.append((pool.submit(_SensorRun, group, shown, systems, h, live), other))
    found: dict[str, AxisEvents] = {}
    moved: list[_Moved] = []
    # The gyroscope comes first, since only its run gets the samples of the accelerometer, too. Motion that
    # they show then counts for the remaining axes as well.
    for of_system, of_staying in runs:
        run, stays = of_system.result(), None if of_staying is None else of_staying.result()
        moved = _united([*moved, *run.moved])
        for name in run.axes:
            better = stays if stays is not None and stays.foretells(name, run) else run
            found[name] = better.of_axis(name, moved)
    return {name: found[name] for name in axes}


def _staying(tracked: Mapping[str, FittedSystem | None], h: float) -> dict[str, System]:
    """Return a second model, with a bias constant between steps, for each axis whose model has a moving bias.

    A bias that steps to and fro has the spectrum of a relaxation (a first-order Gauss-Markov process). A bias
    that steps now and then looks like a random walk. So both models are tried, and the one that predicts the
    samples better is used. The model with a constant bias predicts badly from each step until the step is
    detected, so it loses if the bias really walks.
    """
    found = {}
    for name, one in tracked.items():
        if one is None:
            continue
        fast = [part for part in one.parts if not _is_slow(part)]
        moves = len(fast) < len(one.parts) or one.walk.is_certain
        if moves and any(isinstance(part, White) for part in fast):
            # an error means that no Kalman filter works with this model
            with contextlib.suppress(ValueError, ArithmeticError):
                found[name] = system(fast, h, one.samples, found=True).with_offset()
    return found


def _is_slow(part: Part) -> bool:
    return part.tau_s > FAST_S if isinstance(part, Relaxation) else part.has("slow")


class _Moved(NamedTuple):
    """Motion of a sensor during samples begin … end - 1."""

    begin: int
    end: int
    span: MotionSpan


class _Stepped(NamedTuple):
    """A step of an axis's bias just before sample `at`. The tracker detected it only at sample `row`."""

    at: int
    row: int
    size: float
    size_std: float


class _Course:
    """Biases and σ at up to COURSE_POINTS evenly spaced samples of all `n`, and at the end of a run."""

    def __init__(self, n: int, axes: int) -> None:
        self._every = -(-n // COURSE_POINTS)
        self._points: list[Array] = []
        self.rows: list[int] = []
        """Indices of the samples after which bias and σ are kept."""
        self.end: Array = np.full((2, axes), math.nan)
        """Bias and σ of each axis after the newest sample."""

    def add(self, first: int, bias: Array, bias_std: Array) -> None:
        """Add the biases after the next samples (n, axes). `first`: index of the first of these samples."""
        keep = np.arange(-first % self._every, len(bias), self._every)
        self.rows += (first + keep).tolist()
        self._points.append(np.stack([bias[keep], bias_std[keep]]))
        self.end = np.stack([bias[-1], bias_std[-1]])

    def of_axis(self, lane: int) -> Array:
        """Return the course of an axis's bias and of its σ (2, n)."""
        return np.concatenate(self._points, axis=1)[:, :, lane]


class _Predictions:
    """How well the model of each axis predicted the samples at rest."""

    def __init__(self, axes: int) -> None:
        self._squares, self._counts = np.zeros(axes), np.zeros(axes)

    def add(self, innovation: Array, moving: Mask) -> None:
        """Add the innovations of the next samples (n, axes); samples in motion do not count."""
        known = np.isfinite(innovation) & ~moving
        self._squares += (np.where(known, innovation, 0.0) ** 2).sum(axis=0)
        self._counts += known.sum(axis=0)

    def are_better(self, lane: int, other: "_Predictions") -> bool:
        """Return whether this run's model predicts an axis clearly better than the model of `other`."""
        if self._counts[lane] < other._counts[lane] - LONG:
            return False  # this run's model cannot predict some samples, so the run counted them as motion
        mine, its = (one._squares[lane] / max(one._counts[lane], 1) for one in (self, other))
        return bool(0 < mine < its and self._counts[lane] * math.log(its / mine) > 2 * BETTER)


class _Steps:
    """The steps of each axis's bias. The tracker withdraws some of them later."""

    def __init__(self, axes: int) -> None:
        self.by_axis: list[list[_Stepped]] = [[] for _ in range(axes)]
        self._before = [0] * axes
        """Number of steps of each axis that an earlier tracker found."""

    def begin(self) -> None:
        """Begin to collect the steps that a new tracker finds."""
        self._before = [len(steps) for steps in self.by_axis]

    def undo(self, counts: Sequence[int], events: Sequence[TrackerEvent], first: int) -> None:
        """Drop the bias steps that the tracker has withdrawn.

        It withdraws a step if a motion began with that step.

        `counts`: number of steps of each axis that the tracker still holds valid. `first`: index in the
        recording of the block's first sample. The `row` of each of `events` counts from this sample.
        """
        begun = [first + event.row for event in events if event.kind == EventKind.MOVES]
        for steps, before, count in zip(self.by_axis, self._before, counts, strict=True):
            undone = len(steps) - before - count
            if undone > 0 and begun:
                nearest = sorted(
                    (min((row - one.row for row in begun if row >= one.row), default=math.inf), one)
                    for one in steps
                )
                steps[:] = sorted(one for _, one in nearest[undone:])


class _SensorRun:
    """One run of the tracker over the axes of a sensor."""

    def __init__(
        self,
        axes: Mapping[str, Series],
        accel: Sequence[Array],
        systems: Mapping[str, System | None],
        h: float,
        live: LiveConfig,
    ) -> None:
        self.axes, self._names, self._h, self._live = axes, tuple(axes), h, live
        self._accel = accel
        self._first_axis = next(iter(axes.values()))  # unit, gaps and length are the same in all axes
        n = len(self._first_axis.y)
        self._systems = [systems.get(name) for name in axes]
        self._course, self._steps = _Course(n, len(axes)), _Steps(len(axes))
        self._predictions = _Predictions(len(axes))
        self.moved: list[_Moved] = []
        self._parts = cut(n, self._first_axis.gaps, LONGEST_PREDICTION)
        for begin, end, _ in self._parts:
            self._run(begin, end)

    def _run(self, begin: int, end: int) -> None:
        """Run a tracker over samples begin … end - 1, which have no long gap and no restart of the sensor."""
        tracker = Tracker([None] * len(self._names), rules_of(self._live, self._h, self._first_axis.unit))
        for lane, one in enumerate(self._systems):
            if one is not None:
                # ValueError means that no Kalman filter works with this state-space model
                with contextlib.suppress(ValueError):
                    tracker.set(lane, one)
        since: _Moved | None = None
        self._steps.begin()
        y = [one.y for one in self.axes.values()]
        for first, last, missing in self._blocks(begin, end):
            if missing:
                tracker.skip(missing)
            accel = np.stack([one[first:last] for one in self._accel], axis=1) if self._accel else None
            out = tracker.run(np.stack([one[first:last] for one in y], axis=1), accel)
            for event in tracker.events:
                since = self._take(event, first + event.row, begin, since)
            self._steps.undo([one.steps for one in tracker.figures()], tracker.events, first)
            self._predictions.add(out.innovation, out.moving)
            self._course.add(first, out.bias, out.bias_std)
        if since is not None:
            self._end_motion(since, end, None)

    def _blocks(self, begin: int, end: int) -> Iterator[tuple[int, int, int]]:
        """Yield begin and end of each block of samples, and the number of samples lost before the block."""
        inside = self._first_axis.gaps.within(begin, end)
        lost = dict(zip((inside.at + begin).tolist(), inside.missing.tolist(), strict=True))
        edges = sorted({*range(begin, end, AT_ONCE), *lost, end})
        for first, last in pairwise(edges):
            yield first, last, lost.get(first, 0)

    def _take(self, event: TrackerEvent, row: int, begin: int, since: _Moved | None) -> _Moved | None:
        """Store an event that was detected at sample `row`, and return the motion that goes on after it.

        `since`: the motion that goes on before this event. At rest, `since` or the result is None.
        """
        at = max(row - max(event.ago - 1, 0), begin)
        if event.kind == EventKind.STEP:
            self._steps.by_axis[event.axis].append(_Stepped(at, row, event.size, event.size_std))
        elif event.kind == EventKind.MOVES:
            by = BY.get(event.axis) or self._names[event.axis]
            return _Moved(at, at, MotionSpan(self._time(at), 0.0, by, None, self._first_axis.unit))
        elif since is not None:
            self._end_motion(since, row + 1, event.size)
            return None
        return since

    def foretells(self, name: str, other: "_SensorRun") -> bool:
        """Whether an axis's model in this run predicts clearly better than its model in run `other`."""
        return self._predictions.are_better(self._names.index(name), other._predictions)

    def _end_motion(self, since: _Moved, end: int, largest: float | None) -> None:
        span = msgspec.structs.replace(since.span, end_s=self._time(end - 1) + self._h, largest=largest)
        one = _Moved(since.begin, end, span)
        shown = self.axes.get(span.by)
        if shown is None or end - one.begin < LONG or is_smooth(shown.y[one.begin : end]):
            self.moved.append(one)

    def _at_end(self, lane: int, steps: Sequence[_Stepped]) -> BiasAtEnd | None:
        bias, std = self._course.end[:, lane].tolist()
        if not math.isfinite(bias + std):
            return None
        samples = max(end - begin for begin, end, _ in self._parts)
        if steps:
            samples = min(samples, len(self._first_axis.y) - steps[-1].at)
        return BiasAtEnd(bias, std, self._live.bias_s, samples, has_stepped=bool(steps))

    def _time(self, number: int) -> float:
        return self._first_axis.gaps.place(number) * self._h

    def of_axis(self, name: str, moved: Sequence[_Moved]) -> AxisEvents:
        """Return the events of axis `name`. `moved`: all motions of its sensor."""
        lane = self._names.index(name)
        motion = tuple(one.span for one in moved)
        spans = tuple((one.begin, one.end) for one in moved)
        if self._systems[lane] is None:
            return AxisEvents((), motion, LeftOut(spans, ()))
        # Do not report a step at the first sample of a part of the recording, nor steps during motion that
        # another sensor showed.
        none = [(begin, begin + 1) for begin, _, _ in self._parts] + [*spans]
        steps = [
            one for one in self._steps.by_axis[lane] if not any(begin <= one.at < end for begin, end in none)
        ]
        t_s = np.array([self._time(row) for row in self._course.rows])
        return AxisEvents(
            tuple(BiasStep(self._time(one.at), one.size, one.size_std) for one in steps),
            motion,
            LeftOut(spans, tuple(one.at for one in steps)),
            self._at_end(lane, steps),
            BiasCourse(t_s, *self._course.of_axis(lane)),
        )


def _united(moved: Sequence[_Moved]) -> list[_Moved]:
    """Return motions of a sensor in order of time, without overlaps.

    Overlapping motions are merged. A merged motion names the axis that showed it first.
    """
    found: list[_Moved] = []
    for one in sorted(moved, key=lambda one: one[:2]):
        if found and one.begin <= found[-1].end:
            last = found[-1]
            end_s = max(last.span.end_s, one.span.end_s)
            span = msgspec.structs.replace(last.span, end_s=end_s)
            found[-1] = _Moved(last.begin, max(last.end, one.end), span)
        else:
            found.append(one)
    return found
