"""Keep what the page shows about one device: its past for diagrams, its last records, and its events."""

import threading
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from fltea.records import clock
from fltea.records.estimate import AxisEstimate, DeviceAxisEstimate
from fltea.records.records import (
    AXES,
    AnyRecord,
    DeviceEstimates,
    DeviceFits,
    Epoch,
    Error,
    Estimate,
    Fit,
    Gap,
    Hello,
    Motion,
    Sample,
    Stats,
    Step,
)
from fltea.records.sensor_kind import kind_of
from fltea.records.stats import AxisStats
from fltea.settings.estimator import EstimateOn
from fltea.sinks.changes import sentence
from fltea.sinks.page.answer import order
from fltea.sinks.page.course import FIT, Course
from fltea.sinks.page.fits import Fits
from fltea.sinks.page.happenings import EPOCH_WORDS, Happening, Happenings
from fltea.sinks.page.marks import Marks


class HeardError(NamedTuple):
    """An `error` record, and the monotonic time of its arrival."""

    record: Error
    heard_ns: int


class HeardSample:
    """The last `sample` record, and the monotonic time of its arrival [ns]; None before the first."""

    def __init__(self) -> None:
        self.record: Sample | None = None
        self.heard_ns: int | None = None


class PresentEpoch:
    """What is known about the present epoch of a device. All of it begins anew with each epoch.

    `record`: the record of its begin; None before the first epoch. `estimate`: the last estimates. `newest`:
    for each axis, the last estimate. `compared`: for each axis, the last estimate that the device itself
    made, with its differences from this computer's estimate. `lost`: number of samples lost in gaps.
    """

    def __init__(self, record: Epoch | None = None) -> None:
        self.record = record
        self.estimate: Estimate | None = None
        self.newest: dict[str, AxisEstimate] = {}
        self.compared: dict[str, DeviceAxisEstimate] = {}
        self.lost = 0
        self._means: dict[str, tuple[int, float]] = {}

    def is_of(self, record: Sample | Stats | Gap | None) -> bool:
        """Return whether a record belongs to this epoch."""
        return record is not None and self.record is not None and record.epoch == self.record.epoch

    def average(self, axis: str, value: float) -> float:
        """Take a sample of an axis into the mean of the axis's samples, and return this mean."""
        count, mean = self._means.get(axis, (0, 0.0))
        mean += (value - mean) / (count + 1)
        self._means[axis] = count + 1, mean
        return mean

    def mean(self, axis: str) -> float:
        """Return the mean of an axis's samples for which `average` was called; 0 if there is none."""
        return self._means.get(axis, (0, 0.0))[1]


class DeviceHistory:
    """Keeps what is known about one device.

    One thread writes records to this object; other threads read it, and hold `lock` while they do.

    `estimate_on`: where the estimates of the gyroscope's axes are made.
    """

    def __init__(self, name: str, estimate_on: EstimateOn) -> None:
        self.name = name
        self.lock = threading.Lock()
        self.hello: Hello | None = None
        self.epoch = PresentEpoch()
        self.stats: Stats | None = None
        self._heard = HeardSample()
        self.error: HeardError | None = None
        self.course = Course()
        self._estimate_on = estimate_on
        self.fits = Fits()
        self.happenings = Happenings()
        self.marks = Marks()

    @property
    def sample(self) -> Sample | None:
        """The last sample."""
        return self._heard.record

    @property
    def heard_ns(self) -> int | None:
        """Monotonic arrival time of the last sample [ns]."""
        return self._heard.heard_ns

    @property
    def rate_hz(self) -> float:
        """Sampling rate as HELLO states it; 100 Hz before the first HELLO."""
        return self.hello.rate_hz if self.hello else 100.0

    @property
    def axes(self) -> tuple[str, ...]:
        """Axes for which estimates are made, as the record `stats` names them."""
        return self.course.axes

    def estimator(self, axis: str) -> EstimateOn:
        """Return where the estimates of an axis are made: on this computer, on the device, or on both."""
        return self._estimate_on if axis in AXES else "host"

    def write(self, record: AnyRecord) -> None:
        """Remember a record."""
        with self.lock:
            match record:
                case Sample():
                    self._on_sample(record)
                case Estimate():
                    self._on_estimate(record)
                case DeviceEstimates():
                    self.epoch.compared |= record.axes
                    for axis, found in record.axes.items():
                        self.course.know(axis, record.host_ns, _compared(found))
                case DeviceFits():
                    self.fits.take_device(record)
                case Fit():
                    self.fits.take(record, self.rate_hz)
                    for axis, fit in record.axes.items():
                        values = [
                            v for p in order(fit) for v in ([p.low, p.value, p.high] if p else [None] * 3)
                        ]
                        self.course.know(axis, record.host_ns, dict(zip(FIT, values, strict=True)))
                case Stats():
                    self._on_stats(record)
                case Hello():
                    self.hello = record
                case Epoch():
                    self._on_epoch(record)
                case Gap():
                    if self.epoch.is_of(record):
                        self.epoch.lost += record.missing
                    self.happenings.gap(record.host_ns, record.missing)
                case Step():
                    self.marks.step(record)
                    self.happenings.append(Happening(record.host_ns, "step", sentence(record)))
                case Motion():
                    self.marks.motion(record, self.rate_hz)
                    self.happenings.motion(record)
                case Error():
                    self.error = HeardError(record, clock.host_ns())
                    text = f"{record.kind}: {record.message}"
                    self.happenings.append(Happening(record.host_ns, "error", text))

    def missed(self, count: int) -> None:
        """Note that `count` records were lost before they reached the page."""
        with self.lock:
            host_ns = self.sample.host_ns if self.sample else 0
            text = f"the page missed {count} records: it was too slow"
            self.happenings.append(Happening(host_ns, "missed", text))
            # the present motion may be over: the record of its end may be among the missed records
            self.marks.end(host_ns)

    @property
    def samples_of_epoch(self) -> int:
        """Number of samples of this epoch so far.

        This number includes samples that did not reach the page, but not samples that were lost in gaps.
        """
        sample, epoch = self.sample, self.epoch.record
        if sample is None or epoch is None or not self.epoch.is_of(sample):
            return 0
        return sample.seq - epoch.seq + 1 - self.epoch.lost

    def offset(self, axis: str) -> float:
        """Return the offset that is subtracted from an axis's samples in diagrams.

        This offset is the bias, or the mean of the samples as long as the bias is unknown.
        """
        stats = self._axes_of_epoch().get(axis)
        return stats.bias if stats and stats.bias is not None else self.epoch.mean(axis)

    def _axes_of_epoch(self) -> dict[str, AxisStats]:
        return self.stats.axes if self.stats is not None and self.epoch.is_of(self.stats) else {}

    def _on_epoch(self, record: Epoch) -> None:
        self.epoch = PresentEpoch(record)
        self.fits.begin()
        self.course.begin(record.host_ns)
        self.marks.begin(record.host_ns)
        text = f"epoch {record.epoch} begins: {EPOCH_WORDS[record.reason]}"
        self.happenings.append(Happening(record.host_ns, "epoch", text))

    def _on_sample(self, record: Sample) -> None:
        self._heard.record, self._heard.heard_ns = record, clock.host_ns()
        y: dict[str, float] = {}
        known = self._axes_of_epoch()
        for axis in self.axes:
            value = _value(record, axis)
            stats = known.get(axis)
            offset = stats.bias if stats else None
            y[axis] = value - (self.epoch.average(axis, value) if offset is None else offset)
        self.course.sample(record.host_ns, record.temperature_c, y)

    def _on_estimate(self, record: Estimate) -> None:
        self.epoch.estimate = record
        self.epoch.newest.update(record.axes)
        for axis, e in record.axes.items():
            own, state = e.fltea, None if e.bias is None else e.bias - self.offset(axis)
            values = {
                "state": state,
                "state_std": e.bias_std,
                "alpha": own.alpha,
                "alpha_std": own.alpha_std,
                "f": own.f,
            }
            self.course.know(axis, record.host_ns, values | {"f_std": own.f_std})

    def _on_stats(self, record: Stats) -> None:
        self.stats = record
        if record.axes and tuple(record.axes) != self.axes:
            self.course.set_axes(tuple(record.axes))
        for axis, found in record.axes.items():
            checks = {"lag1": found.innovation_lag1, "nis": found.innovation_nis}
            self.course.know(axis, record.host_ns, checks)


def _compared(e: DeviceAxisEstimate) -> dict[str, float | None]:
    """Return the device's own estimate and its differences from this computer's estimate.

    The keys are the names of the columns in `Course`.
    """
    apart, f_apart = e.alpha_difference, e.f_difference
    differences = dict.fromkeys(("apart_low", "apart", "apart_high"), apart)
    far = None if f_apart is None else abs(f_apart)
    return {"device_alpha": e.fltea.alpha, "device_f": e.fltea.f, "f_apart": far, **differences}


def _value(sample: Sample, axis: str) -> float:
    kind = kind_of(axis)
    values: Sequence[float] | None = getattr(sample, kind.samples_field)
    return values[kind.axes.index(axis)] if values else np.nan
