"""Many recordings: each axis is a task, results come in the order of the recordings, failures stay apart."""

from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Future, wait
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import msgspec

from fltea.config import AccelConfig, EstimatorConfig
from fltea.errors import FlteaError, UsageError
from fltea.identify.allan import Allan, allan
from fltea.identify.axis import AxisResult, IdentifyOptions, identify_axis
from fltea.identify.curves import Curves, curves
from fltea.identify.load import GYRO_UNIT, Loaded, Request, Series, Unreadable, load
from fltea.identify.noise_model import AxisModel, identified
from fltea.identify.reproduction import Reproduction, reproduction
from fltea.identify.traps import Trap, axis_traps
from fltea.identify.workers import Workers
from fltea.model import ACCEL_AXES, AXES

CHECK_S = 5.0
"""Between two looks at whether the workers are still there."""

USUAL_AXES = 3
"""Of a recording that has not been read yet."""

Progress = Callable[[str, int, int], None]
"""Is told what has just been done, and how many tasks of how many are done."""


class Failure(msgspec.Struct, frozen=True):
    """Why there is no result."""

    error: str


class AxisReport(msgspec.Struct, frozen=True):
    """One axis. allan and reproduction: None for `allan_reason`. curves: only if figures are wanted."""

    unit: str
    lsb: float | None
    result: AxisResult
    model: AxisModel
    allan: Allan | None
    reproduction: Reproduction | None
    allan_reason: str
    traps: tuple[Trap, ...]
    curves: Curves | None


@dataclass
class FileReport:
    """One recording. failure: why it could not be read; else `recording` is what was, without the samples."""

    name: str
    recording: Loaded | None = None
    failure: FlteaError | None = None
    axes: dict[str, AxisReport | Failure] = field(default_factory=dict)


class Settings(msgspec.Struct, frozen=True):
    """How to identify; bias and R of the estimators may be lists, one number a channel."""

    options: IdentifyOptions
    """but for the estimator"""
    gyro: EstimatorConfig = EstimatorConfig()
    accel: AccelConfig = AccelConfig()
    figures: bool = False
    """make what figures are drawn from"""

    def of_axis(self, axis: str, channels: Sequence[str]) -> IdentifyOptions:
        """The options of one axis of those that are identified."""
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


class _Task(NamedTuple):
    """To read a recording, or (with an axis) to identify one of its axes."""

    report: FileReport
    axis: str | None
    do: Callable[..., Any]
    arguments: tuple[Any, ...]


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
    for request in requests:
        reports.append(FileReport(request.name))
        if isinstance(request, Unreadable):
            reports[-1].failure = request.error
        else:
            reading.append(_Task(reports[-1], None, load, (request,)))
    _Loop(settings, workers, readers or workers, progress).run(reading)
    return reports


class _Loop:
    """Hands out tasks, axes before further recordings, so that few recordings are in memory at a time."""

    def __init__(self, settings: Settings, workers: Workers, readers: Workers, progress: Progress) -> None:
        self._settings = settings
        self._workers = workers
        self._readers = readers
        self._progress = progress
        self._done = self._total = 0
        self._axes: deque[_Task] = deque()
        self._alone: deque[_Task] = deque()
        self._pending: dict[Future[Any], _Task] = {}

    def run(self, reading: deque[_Task]) -> None:
        """Do all, the recordings to read first."""
        self._total = len(reading) * (1 + USUAL_AXES)
        while reading or self._axes or self._alone or self._pending:
            self._hand_out(reading)
            done, _ = wait(self._pending, CHECK_S, FIRST_COMPLETED)
            if not done:
                self._workers.check()
            broken = [future for future in done if not self._take(future)]
            if broken:
                self._after_death()

    def _hand_out(self, reading: deque[_Task]) -> None:
        while len(self._pending) < (1 if self._alone else self._workers.slots):
            queue = self._alone or self._axes or reading
            if not queue:
                return
            task = queue.popleft()
            who = self._readers if task.axis is None else self._workers
            try:
                future = who.submit(task.do, *task.arguments)
            except BrokenExecutor:  # died since the last look
                queue.appendleft(task)
                self._after_death()
                continue
            self._pending[future] = task

    def _take(self, future: Future[Any]) -> bool:
        """Take a result; False if there is none because a process died."""
        task = self._pending[future]
        try:
            result = future.result()
        except BrokenExecutor:
            return False
        except (Exception, CancelledError) as error:
            result = error
        del self._pending[future]
        self._settle(task, result)
        return True

    def _settle(self, task: _Task, result: Any) -> None:
        report = task.report
        self._done += 1
        if task.axis is not None:
            report.axes[task.axis] = Failure(_text(result)) if isinstance(result, BaseException) else result
        elif isinstance(result, Loaded):
            report.recording = result._replace(axes={})
            self._plan(report, result)
        else:
            report.failure = result if isinstance(result, FlteaError) else FlteaError(_text(result))
            self._total -= USUAL_AXES
        text = f"{report.name.rpartition('/')[2]} {task.axis or ''}".strip()
        self._progress(text, self._done, self._total)

    def _plan(self, report: FileReport, recording: Loaded) -> None:
        before = len(self._axes)
        for axis, series in recording.axes.items():
            report.axes[axis] = Failure("not done")  # keeps the order of the axes
            try:
                options = self._settings.of_axis(axis, tuple(recording.axes))
            except FlteaError as error:
                report.axes[axis] = Failure(str(error))
                continue
            arguments = (series, recording.h, options, self._settings.figures)
            self._axes.append(_Task(report, axis, identify_series, arguments))
        self._total += len(self._axes) - before - USUAL_AXES

    def _after_death(self) -> None:
        """One of those under way killed its process; each is tried again alone, so the culprit is found."""
        tasks = list(self._pending.values())
        self._pending.clear()
        if len(tasks) == 1:
            self._settle(
                tasks[0], FlteaError("the process that worked on it was killed; did memory run out?")
            )
        else:
            self._alone.extend(tasks)
        self._workers.renew()


def identify_series(series: Series, h: float, options: IdentifyOptions, figures: bool) -> AxisReport:
    """All that is found out about one axis.

    Raises:
        ValueError: it is too short or constant.
    """
    result = identify_axis(series.y, h, series.lsb, options)
    model = identified(result.rivals, result.peaks, result.std, h)
    found, drawn, reason = None, None, ""
    if series.unit != GYRO_UNIT:
        reason = "only of gyroscopes"
    else:
        try:
            found = allan(series.y, h)
            drawn = reproduction(series.y, h, model, seed=options.seed)
        except (UsageError, ValueError) as error:
            reason = str(error)
    traps = axis_traps(series.y, h, series.lsb, result.peaks, series.unit)
    shown = curves(series.y, h, series.lsb, options, result) if figures else None
    return AxisReport(series.unit, series.lsb, result, model, found, drawn, reason, traps, shown)


def _text(error: Any) -> str:
    text = str(error)
    return text if isinstance(error, FlteaError | ValueError) and text else f"{type(error).__name__}: {text}"
