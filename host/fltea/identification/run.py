"""Many recordings: results come in the order of the recordings, failures stay apart.

Each axis is a task, and each group of its shuffled copies another, for they take most of the time, and three
axes would keep two cores busy for as long as four. What comes out does not depend on who does which.
"""

from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, field
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from fltea.identification.allan import allan, with_level
from fltea.identification.axis import (
    AxisResult,
    IdentifyOptions,
    Looked,
    identified,
    look,
    with_copies,
)
from fltea.identification.curves import Curves, curves
from fltea.identification.data_sheet import SheetComparison, compare
from fltea.identification.fltea_fit import LEAST
from fltea.identification.forecast import Forecast, Goal, Now, SentenceParts, found
from fltea.identification.gaps import longest_epoch
from fltea.identification.hand_out import HandOut, Task
from fltea.identification.load import GYRO_UNIT, Loaded, Request, Series, Unreadable, load
from fltea.identification.noise_model import AxisModel, modelled
from fltea.identification.reproduction import Reproduction, reproduction
from fltea.identification.shuffled import Copies, estimate, groups
from fltea.identification.traps import Trap, axis_traps, of_axis, withheld
from fltea.identification.work_folder import work_folder
from fltea.identification.workers import Workers
from fltea.records.errors import FlteaError, UsageError
from fltea.records.records import ACCEL_AXES, AXES
from fltea.settings.estimator import AccelConfig, EstimatorConfig
from fltea.spectrum.allan_curve import Allan
from fltea.spectrum.wording import duration, names

USUAL_TASKS = 3
"""Tasks that a recording is taken for before it is read. The bar grows with the groups of copies."""

Progress = Callable[[str, int, int], None]
"""Is called with what has just been done, and how many tasks of how many are done."""


class Failure(msgspec.Struct, frozen=True):
    """The reason why there is no result."""

    error: str


class AxisReport(msgspec.Struct, frozen=True):
    """The results of one axis; allan and reproduction may be None for `allan_reason`.

    There are curves only if figures are wanted.
    """

    unit: str
    lsb: float | None
    result: AxisResult
    model: AxisModel
    allan: Allan | None
    reproduction: Reproduction | None
    allan_reason: str
    traps: tuple[Trap, ...]
    curves: Curves | None
    now: Now | None = None
    """The bias at the end of the longest stretch."""
    forecast: Forecast | None = None
    sheet: SheetComparison | None = None
    """Only where a data sheet was named."""
    withheld: str = ""
    """Why there is no `now`, forecast, comparison or file for other programs: what is bad, and what to do."""


@dataclass
class FileReport:
    """The results of one recording, or the failure why it could not be read."""

    name: str
    recording: Loaded | None = None
    failure: FlteaError | None = None
    axes: dict[str, AxisReport | Failure] = field(default_factory=dict)

    def compare_with(self, part: str) -> None:
        """Compare the axes of a gyroscope with the data sheet of `part`."""
        for name, axis in self.axes.items():
            if isinstance(axis, AxisReport) and axis.unit == GYRO_UNIT and self.recording is not None:
                if axis.withheld:
                    continue
                low_pass = self.recording.hello.gyro_dlpf_hz
                found = compare(part, axis.result.level, axis.result.rate_hz, axis.lsb, low_pass)
                self.axes[name] = msgspec.structs.replace(axis, sheet=found)


class Settings(msgspec.Struct, frozen=True):
    """How to identify; bias and R of the estimators may be lists, one number a channel."""

    options: IdentifyOptions
    """But for the estimator."""
    gyro: EstimatorConfig = EstimatorConfig()
    accel: AccelConfig = AccelConfig()
    figures: bool = False
    """Make what figures are drawn from."""
    forecast: bool | Goal = False

    def of_axis(self, axis: str, channels: Sequence[str]) -> IdentifyOptions:
        """Return the options of one axis of those that are identified."""
        config, names = (self.accel, ACCEL_AXES) if axis in ACCEL_AXES else (self.gyro, AXES)
        place = [name for name in channels if name in names].index(axis)
        numbers: dict[str, Any] = {}
        for key in ("bias", "R"):
            value = getattr(config, key)
            if isinstance(value, list):
                if place >= len(value):
                    raise UsageError(f"{key}: has {len(value)} numbers, but {axis} is axis {place + 1}.")
                numbers[key] = value[place]
        return msgspec.structs.replace(self.options, estimator=msgspec.structs.replace(config, **numbers))


def _at_rate(options: IdentifyOptions, h: float) -> IdentifyOptions:
    """Return the options with times as samples, h s each.

    UsageError if there are more of them than may be.
    """
    try:
        return msgspec.structs.replace(options, estimator=options.estimator.at(1 / h))
    except ValueError as error:
        raise UsageError(f"{error}.") from error


@dataclass
class _Task(Task):
    """To read a recording, or (with an axis) to identify one of its axes or a group of its copies."""

    report: FileReport
    axis: "_Axis | None" = None
    part: int | None = None
    """Number of the group of copies."""


@dataclass
class _Axis:
    """An axis whose tasks are under way. Its report comes when all of them are done."""

    name: str
    found: AxisReport | None = None
    parts: list[Copies | None] = field(default_factory=list)
    failure: Failure | None = None

    def take(self, task: _Task, result: Any) -> AxisReport | Failure | None:
        """Take what a task gave; the report if nothing more is to come."""
        if isinstance(result, BaseException):
            # Of several the axis itself knows best what is wrong with it.
            self.failure = (
                Failure(_text(result)) if task.part is None else self.failure or Failure(_text(result))
            )
        elif task.part is None:
            self.found = result
        else:
            self.parts[task.part] = result
        if self.failure is not None:
            return self.failure
        copies = [part for part in self.parts if part is not None]
        if self.found is None or len(copies) < len(self.parts):
            return None
        return msgspec.structs.replace(self.found, result=with_copies(self.found.result, copies))


def identify_all(
    requests: Sequence[Request | Unreadable],
    settings: Settings,
    workers: Workers,
    readers: Workers | None = None,
    progress: Progress = lambda text, done, total: None,
) -> list[FileReport]:
    """Identify recordings; the reports have the order of the requests.

    readers: who reads the files, if not `workers`, which may be on machines that do not have them.

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
    """Hands out tasks, axes before further recordings, so that few recordings are in memory at a time."""

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
        """Return the next of an axis, or else the next recording."""
        queue = self._alone or self._axes or self._reading
        return queue.popleft() if queue else None

    def submit(self, task: _Task) -> "Future[Any]":
        """Hand over a task, to the readers if it is to read."""
        who = self._readers if task.axis is None else self._workers
        return who.submit(task.do, *task.arguments)

    def settle(self, task: _Task, result: Any) -> None:
        """Put a result into its report, and plan what follows from it."""
        report = task.report
        self._done += 1
        if task.axis is not None:
            done = task.axis.take(task, result)
            if done is not None:
                report.axes[task.axis.name] = done
        elif isinstance(result, Loaded):
            report.recording = result._replace(axes={})
            self._plan(report, result)
        else:
            report.failure = result if isinstance(result, FlteaError) else FlteaError(_text(result))
            self._total -= USUAL_TASKS
        what = [report.name.rpartition("/")[2]]
        if task.axis is not None:
            what.append(task.axis.name)
            if task.part is not None:
                what.append(f"copies {task.part + 1}/{len(task.axis.parts)}")
        self._progress(" ".join(what), self._done, self._total)

    def _plan(self, report: FileReport, recording: Loaded) -> None:
        """Return the tasks: axes, then their copies, which are many and alike, so that no process idles."""
        axes, copies = [], []
        h = recording.h
        for name, series in recording.axes.items():
            report.axes[name] = Failure("not done")  # keeps the order of the axes
            try:
                options = _at_rate(self._settings.of_axis(name, tuple(recording.axes)), h)
            except FlteaError as error:
                report.axes[name] = Failure(str(error))
                continue
            needed = options.estimator.startup_needed + LEAST
            if len(series.y) < needed:
                report.recording, report.axes = None, {}
                report.failure = UsageError(
                    f"{report.name}: {len(series.y)} samples, {len(series.y) * h:.1f} s, are too short for a "
                    f"verdict; {needed} are the least (the start-up window takes "
                    f"{options.estimator.startup_needed}: --startup). Record ten minutes at rest, or an "
                    "hour to know the bias instability."
                )
                self._total -= USUAL_TASKS
                return
            axis = _Axis(name)
            known = of_axis(recording.traps, name)
            arguments = (series, h, options, self._settings.figures, self._settings.forecast, known)
            axes.append(_Task(identify_series, arguments, report, axis))
            epoch = longest_epoch(len(series.y), series.gaps)
            for part, group in enumerate(groups(epoch[1] - epoch[0], options.shuffles)):
                axis.parts.append(None)
                copy = (series.y, h, options.estimator, series.lsb, group, options.seed, epoch)
                copies.append(_Task(estimate, copy, report, axis, part))
        self._axes.extend(axes + copies)
        self._total += len(axes) + len(copies) - USUAL_TASKS


def identify_series(
    series: Series,
    h: float,
    options: IdentifyOptions,
    figures: bool,
    forecast: bool | Goal = False,
    known: Sequence[Trap] = (),
) -> AxisReport:
    """Return all that is found out about one axis, but for its shuffled copies.

    known: what is wrong with it already by the recording as a whole.

    Raises:
        ValueError: it is too short or constant.
    """
    looked = look(series.y, h, options, series.gaps)
    result = identified(looked, series.lsb, options)
    model = modelled(looked.figures.sentence, result.peaks, result.std, h)
    curve, drawn, reason = None, None, ""
    try:
        stretches = [np.asarray(one.y, dtype=np.float64) for one in looked.stretches]
        curve = with_level(allan(stretches, h, series.unit), result.level)
        drawn = reproduction(series.y, h, model, seed=options.seed, stretches=stretches)
    except ValueError as error:
        reason = str(error)
    traps = traps_of(looked, series, result)
    why = withheld((*known, *traps))
    bias, ahead = forecasts(looked, options, series.unit, why, forecast=forecast)
    return AxisReport(
        series.unit,
        series.lsb,
        result,
        model,
        curve,
        drawn,
        reason,
        traps,
        curves=curves(looked, series.lsb, options, result) if figures else None,
        now=bias,
        forecast=ahead,
        withheld=why,
    )


def traps_of(looked: Looked, series: Series, result: AxisResult) -> tuple[Trap, ...]:
    """Return what in an axis that was looked at can mislead."""
    return axis_traps(
        looked.y,
        looked.h,
        series.lsb,
        result.peaks,
        series.unit,
        series.gaps,
        moved=looked.motion,
        longer=_longer(result),
    )


def forecasts(
    looked: Looked, options: IdentifyOptions, unit: str, why_not: str, *, forecast: bool | Goal
) -> tuple[Now | None, Forecast | None]:
    """Return the bias now of an axis that was looked at, and the forecast if it is wanted.

    Neither if there is a reason why not.
    """
    if why_not:
        return None, None
    h = looked.h

    def first(y: NDArray[np.float64]) -> SentenceParts:
        parts = look(y, h, options).figures.sentence.parts(h)
        return parts, names(map(type, parts))

    goal = forecast if isinstance(forecast, Goal) else None
    longest = max((one.y for one in looked.stretches), key=len)
    y = np.ascontiguousarray(longest, dtype=np.float64)
    return found(looked.figures.sentence.parts(h), y, h, unit, first if forecast else None, goal)


def _longer(result: AxisResult) -> str:
    """Return how long a record should be, as the verdict has it."""
    if not result.verdict.has_order:
        return "ten minutes or more"
    return "as long as can be" if result.decides_s is None else f"about {duration(result.decides_s)}"


def _text(error: Any) -> str:
    text = str(error)
    return text if isinstance(error, FlteaError | ValueError) and text else f"{type(error).__name__}: {text}"
