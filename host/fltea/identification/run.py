"""Identify many recordings.

The results have the order of the recordings. A failure of one recording does not affect the others.

The analysis of each axis is one task. FLTEA also runs over shuffled copies of each axis's samples, and these
runs take most of the time. So each group of copies is a task of its own. If the copies were part of their
axis's task, a recording of three axes would keep only three cores busy. The results do not depend on which
process does which task.
"""

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, field
from typing import Any

import msgspec

from fltea.identification.axis import (
    IdentifyOptions,
    with_copies,
    with_fltea,
)
from fltea.identification.axis_report import AxisReport, Failure, FileReport
from fltea.identification.conclusions import Conclusions, conclude, in_agreement
from fltea.identification.data_checks import DataCheck, of_axis
from fltea.identification.fltea_fit import LEAST, FlteaFits
from fltea.identification.forecast_judge import FittedSystem
from fltea.identification.gaps import longest_epoch
from fltea.identification.hand_out import HandOut, Task
from fltea.identification.left_out import without
from fltea.identification.load import Loaded, Request, Series, Unreadable, load
from fltea.identification.one_axis import (
    MOST_ANALYSES,
    FlteaInput,
    concluded,
    examine,
    run_fltea,
    with_events,
)
from fltea.identification.sensor_events import (
    NO_EVENTS,
    AxisEvents,
    watch,
)
from fltea.identification.settings import Settings, at_rate
from fltea.identification.shuffled import Copies, estimate, groups
from fltea.identification.telegraph import without_levels
from fltea.identification.workers import Workers
from fltea.records.arrays import Array
from fltea.records.errors import FlteaError, UsageError
from fltea.records.kinds import FILE_TROUBLES
from fltea.records.scarce import is_scarcity, scarcity
from fltea.records.temporary import work_folder

USUAL_TASKS = 3
"""Number of tasks that progress reports assume for a recording before it is read.

The tasks for shuffled copies of the recording's samples are added to the total later.
"""

Progress = Callable[[str, int, int], None]
"""Function that reports progress: called with a text on what was just done, the number of tasks done, and the
total number of tasks.
"""


@dataclass
class _Task(Task):
    """A task: read a recording, track its biases, run FLTEA over its axes, or process one axis."""

    report: FileReport
    axis: "_Axis | None" = None
    part: int | None = None
    """Index of the group of shuffled copies that the task processes; None for a task without copies."""
    of: "_Recording | None" = None
    """The recording to which the task belongs; None if the task has yet to read that recording."""


@dataclass
class _Axis:
    """An axis of a recording, with the results of its tasks so far.

    `report` is None until all its tasks are done.
    """

    name: str
    series: Series
    options: IdentifyOptions
    looks: int = 0
    is_examined: bool = False
    found: AxisReport | None = None
    events: AxisEvents | None = None
    wants_fltea: bool = False
    fltea: FlteaFits | None = None
    parts: list[Copies | None] = field(default_factory=list)
    conclusions: Conclusions | None = None
    failure: Failure | None = None

    def take(self, task: _Task, result: Any) -> None:
        """Store the result of a task of this axis."""
        self.is_examined |= task.do is examine
        if isinstance(result, BaseException):
            if self.looks > 1 and task.do is examine:
                # too few samples are left between the bias steps for another analysis, so the previous one
                # stays valid
                return
            # If several tasks of an axis fail, report the failure of its analysis, not that of its shuffled
            # copies, since the failure of the analysis explains more.
            self.failure = (
                Failure(_text(result)) if task.part is None else self.failure or Failure(_text(result))
            )
        elif isinstance(result, Conclusions):
            self.conclusions = result
        elif task.part is None:
            self.found = result
        else:
            self.parts[task.part] = result

    @property
    def report(self) -> AxisReport | Failure | None:
        """The report of the axis; None if a result of its tasks is still missing."""
        copies = [part for part in self.parts if part is not None]
        if self.failure is not None or self.found is None or len(copies) < len(self.parts):
            return self.failure
        if self.events is None or (self.wants_fltea and self.fltea is None):
            return None
        found = self.found
        if self.fltea is not None:
            result = with_copies(with_fltea(found.result, self.fltea), copies)
            found = msgspec.structs.replace(found, result=result)
        if found.tracked is not None:
            if self.conclusions is None:
                return None
            found = concluded(found, self.conclusions)
        return with_events(found, self.events)


@dataclass
class _Recording:
    """A recording that was read, with its axes and the results of their tasks so far."""

    h: float
    accel: tuple[Array, ...]
    data_checks: tuple[DataCheck, ...]
    axes: list[_Axis] = field(default_factory=list)
    watches: int = 0

    def agreed(self) -> dict[str, FittedSystem]:
        """Return the state-space model for the tracker of each axis, by the axis's name."""
        tracked = {axis.name: axis.found.tracked for axis in self.axes if axis.found is not None}
        return in_agreement(tracked, self.h)


def identify_all(
    requests: Sequence[Request | Unreadable],
    settings: Settings,
    workers: Workers,
    readers: Workers | None = None,
    progress: Progress = lambda text, done, total: None,
) -> list[FileReport]:
    """Identify recordings; the reports have the order of the requests.

    `readers`: workers that read the files; None: `workers` read the files, too. Other workers are needed for
        reading if `workers` run on machines that do not have the files.

    Raises:
        FlteaError: the workers are gone.
    """
    reports = []
    reading: deque[_Task] = deque()
    with work_folder() as folder:
        for request in requests:
            reports.append(FileReport(request.name))
            if isinstance(request, Unreadable):
                reports[-1].failure = request.error
            else:
                reading.append(_Task(load, (request, folder), reports[-1]))
        _Loop(settings, workers, readers or workers, progress, reading).work()
    return reports


class _Loop(HandOut[_Task]):
    """Hand out the tasks of an identification to workers.

    Tasks of axes come before tasks that read further recordings, so that few recordings are in memory at
    once.
    """

    def __init__(
        self,
        settings: Settings,
        workers: Workers,
        readers: Workers,
        progress: Progress,
        reading: deque[_Task],
    ) -> None:
        super().__init__(workers)
        self._settings = settings
        self._readers = readers
        self._progress = progress
        self._reading = reading
        self._axes: deque[_Task] = deque()
        self._done, self._total = 0, len(reading) * (1 + USUAL_TASKS)

    def next_task(self) -> _Task | None:
        """Return the next task of an axis, or else the next recording to read."""
        queue = self._alone or self._axes or self._reading
        return queue.popleft() if queue else None

    def submit(self, task: _Task) -> "Future[Any]":
        """Submit a task: to `readers` if it reads a recording, otherwise to `workers`."""
        who = self._readers if task.do is load else self._workers
        return who.submit(task.do, *task.arguments)

    def settle(self, task: _Task, result: Any) -> None:
        """Store the result of a task in the report of its recording, and plan the tasks that follow."""
        report = task.report
        self._done += 1
        if task.of is not None:
            if task.axis is not None:
                task.axis.take(task, result)
                if task.do is examine and all(axis.is_examined for axis in task.of.axes):
                    self._watch(task)
            elif task.do is run_fltea:
                _take_fltea(task.of, result)
            else:
                self._look_again(task, {} if isinstance(result, BaseException) else result)
            for axis in task.of.axes:
                if (done := axis.report) is not None:
                    report.axes[axis.name] = done
        elif isinstance(result, Loaded):
            report.recording = result._replace(axes={}, accel=())
            self._plan(report, result)
        else:
            report.failure = result if isinstance(result, FlteaError) else FlteaError(_text(result))
            self._total -= USUAL_TASKS
        what = [report.name.rpartition("/")[2]]
        if task.axis is not None:
            what.append(task.axis.name)
            if task.part is not None:
                what.append(f"copies {task.part + 1}/{len(task.axis.parts)}")
            elif task.do is conclude:
                what.append("bias")
        elif task.of is not None:
            what.append("FLTEA" if task.do is run_fltea else "steps and motion")
        self._progress(" ".join(what), self._done, self._total)

    def _add(self, *tasks: _Task) -> None:
        self._axes.extend(tasks)
        self._total += len(tasks)

    def _watch(self, task: _Task) -> None:
        """After the analysis of all axes of a recording, plan the task that tracks their biases.

        If the axes were analysed for the last time, plan the task that computes bias, forecast and filter
        instead.
        """
        assert task.of is not None
        of, axes = task.of, {axis.name: axis.series for axis in task.of.axes if axis.found is not None}
        of.watches += 1
        if of.watches == MOST_ANALYSES:
            self._conclude(task)
        elif axes:
            arguments = (axes, of.accel, of.agreed(), of.h, self._settings.live)
            self._add(_Task(watch, arguments, task.report, of=of))

    def _look_again(self, task: _Task, events: dict[str, AxisEvents]) -> None:
        """Plan a new analysis of the axes for which the tracker found other bias steps or motion than before.

        If there are no such axes, plan the task that computes bias, forecast and filter of all axes.
        """
        assert task.of is not None
        of = task.of
        again = []
        for axis in of.axes:
            if axis.found is not None:
                axis.events = events.get(axis.name, NO_EVENTS)
                if not axis.events.left_out.is_like(axis.found.left_out):
                    again.append(axis)
        if again:
            self._add(*(self._look(axis, task.report, of) for axis in again))
        else:
            self._conclude(task)

    def _look(self, axis: _Axis, report: FileReport, of: _Recording) -> _Task:
        """Return the task of the next analysis of an axis."""
        axis.looks += 1
        axis.is_examined = False
        out = None if axis.events is None else axis.events.left_out
        known = of_axis(of.data_checks, axis.name)
        settings = self._settings
        arguments = axis.series, of.h, axis.options, settings.figures, known, out, settings.details
        return _Task(examine, arguments, report, axis, of=of)

    def _conclude(self, task: _Task) -> None:
        """Plan the task that computes bias, forecast and filter, after the last analysis of all axes."""
        assert task.of is not None
        of = task.of
        agreed = of.agreed()
        if self._settings.details:
            self._run_fltea(task.report, of)
        for axis in of.axes:
            if axis.found is not None and axis.events is not None:
                series = without(axis.series, axis.found.left_out)
                if axis.name in agreed:
                    K, at_end = axis.found.result.level.K, axis.events.at_end
                    found = series, of.h, axis.options, agreed[axis.name], K
                    arguments = *found, self._settings.forecast, at_end, axis.events.steps
                    self._add(_Task(conclude, arguments, task.report, axis, of=of))

    def _run_fltea(self, report: FileReport, of: _Recording) -> None:
        """Plan to run FLTEA over all axes together, and over shuffled copies of their samples."""
        axes = [axis for axis in of.axes if axis.found is not None and axis.events is not None]
        fltea_inputs = []
        for axis in axes:
            assert axis.found is not None
            axis.wants_fltea = True
            fltea_inputs.append(FlteaInput.of(axis.series, axis.found, axis.options))
            rest, _ = without_levels(axis.series, of.h)
            self._add(*self._copies(axis, without(rest, axis.found.left_out), report, of))
        if axes:
            self._add(_Task(run_fltea, (fltea_inputs, of.h), report, of=of))

    def _plan(self, report: FileReport, recording: Loaded) -> None:
        """Plan the first analysis of each axis."""
        h = recording.h
        self._workers.expect(sum(len(series.y) for series in recording.axes.values()))
        of = _Recording(h, recording.accel, recording.data_checks)
        for name, series in recording.axes.items():
            # a placeholder, so that the report lists the axes in the order of the recording
            report.axes[name] = Failure("not done")
            try:
                options = at_rate(self._settings.of_axis(name, tuple(recording.axes)), h)
            except FlteaError as error:
                report.axes[name] = Failure(str(error))
                continue
            needed = options.estimator.startup_needed + LEAST
            if len(series.y) < needed:
                report.recording, report.axes = None, {}
                wrong = [
                    f" {data_check.text}"
                    for data_check in recording.data_checks
                    if data_check.kind in FILE_TROUBLES
                ][:1]
                report.failure = UsageError(
                    f"{report.name}: {len(series.y)} samples ({len(series.y) * h:.1f} s) are too few for a "
                    f"verdict, which needs at least {needed} samples (the start-up window takes "
                    f"{options.estimator.startup_needed}: --startup). Record ten minutes at rest, or an "
                    f"hour to know the bias instability.{''.join(wrong)}"
                )
                self._total -= USUAL_TASKS
                return
            of.axes.append(_Axis(name, series, options))
        self._add(*(self._look(axis, report, of) for axis in of.axes))
        self._total -= USUAL_TASKS

    def _copies(self, axis: _Axis, series: Series, report: FileReport, of: _Recording) -> Iterator[_Task]:
        """Yield the tasks that run FLTEA over shuffled copies of an axis.

        The tasks are many and of equal size, so that no process is idle.
        """
        epoch = longest_epoch(len(series.y), series.gaps)
        for part, group in enumerate(groups(epoch[1] - epoch[0], axis.options.shuffles)):
            axis.parts.append(None)
            copy = (series.y, of.h, axis.options.estimator, series.lsb, group, axis.options.seed, epoch)
            yield _Task(estimate, copy, report, axis, part, of=of)


def _take_fltea(of: _Recording, result: Any) -> None:
    """Store FLTEA's estimates, or the reason why there are none, in each axis of a recording."""
    axes = [axis for axis in of.axes if axis.wants_fltea]
    if isinstance(result, BaseException):
        for axis in axes:
            axis.failure = axis.failure or Failure(_text(result))
        return
    for axis, fits in zip(axes, result, strict=True):
        axis.fltea = fits


def _text(error: Any) -> str:
    if is_scarcity(error):
        return str(scarcity(error))
    text = str(error)
    return text if isinstance(error, FlteaError | ValueError) and text else f"{type(error).__name__}: {text}"
