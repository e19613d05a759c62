"""What the page knows of one device: its past in rows, its last records, and what happened to it."""

import threading
from typing import NamedTuple

import numpy as np

from fltea.records import clock
from fltea.records.records import (
    ACCEL_AXES,
    AXES,
    AnyRecord,
    AxisEstimate,
    AxisStats,
    DeviceAxisEstimate,
    DeviceEstimates,
    DeviceFits,
    Epoch,
    Error,
    Estimate,
    Fit,
    Gap,
    Hello,
    Sample,
    Stats,
)
from fltea.settings.estimator import EstimateOn
from fltea.sinks.page.fits import Fits
from fltea.sinks.page.happenings import EPOCH_WORDS, Happening, Happenings
from fltea.sinks.page.tables import Tables


class HeardError(NamedTuple):
    """An error, and the monotonic time when it arrived."""

    record: Error
    heard_ns: int


class DeviceHistory:
    """Takes the records of one device in one thread, and is read in others, under `lock`.

    estimate_on: who estimates the gyroscope's axes. newest: of every axis, the last estimate of the epoch;
    compared: likewise, the device's estimate that is compared with it. heard_ns: monotonic time of the last
    sample.
    """

    def __init__(self, name: str, estimate_on: EstimateOn) -> None:
        self.name = name
        self.lock = threading.Lock()
        self.hello: Hello | None = None
        self.epoch: Epoch | None = None
        self.stats: Stats | None = None
        self.sample: Sample | None = None
        self.heard_ns: int | None = None
        self.estimate: Estimate | None = None
        self.newest: dict[str, AxisEstimate] = {}
        self.compared: dict[str, DeviceAxisEstimate] = {}
        self.error: HeardError | None = None
        self.tables = Tables(estimate_on)
        self.fits = Fits()
        self.happenings = Happenings()
        self._lost = 0
        self._means: dict[str, tuple[int, float]] = {}
        self._written_seq: int | None = None

    @property
    def rate_hz(self) -> float:
        """Samples a second, as far as anybody has said."""
        return self.hello.rate_hz if self.hello else 100.0

    @property
    def axes(self) -> tuple[str, ...]:
        """Axes that are estimated, as statistics name them."""
        return self.tables.axes

    def write(self, record: AnyRecord) -> None:
        """Take a record."""
        with self.lock:
            match record:
                case Sample():
                    self._on_sample(record)
                case Estimate():
                    self._on_estimate(record)
                case DeviceEstimates():
                    self.compared |= record.axes
                    self.tables.add("compared", record.host_ns, record.axes)
                case DeviceFits():
                    self.fits.take_device(record)
                case Fit():
                    self.fits.take(record, self.rate_hz)
                    self.tables.add("fits", record.host_ns, record.axes)
                case Stats():
                    self._on_stats(record)
                case Hello():
                    self._on_hello(record)
                case Epoch():
                    self._on_epoch(record)
                case Gap():
                    if self.epoch is not None and record.epoch == self.epoch.epoch:
                        self._lost += record.missing
                    self.happenings.gap(record.host_ns, record.missing)
                case Error():
                    self.error = HeardError(record, clock.host_ns())
                    text = f"{record.kind}: {record.message}"
                    self.happenings.append(Happening(record.host_ns, "error", text))

    def missed(self, count: int) -> None:
        """Take note that `count` records did not reach the page."""
        with self.lock:
            host_ns = self.sample.host_ns if self.sample else 0
            text = f"the page missed {count} records: it was too slow"
            self.happenings.append(Happening(host_ns, "missed", text))

    @property
    def samples_of_epoch(self) -> int:
        """Samples of the epoch until the newest one; the page may not have got each of them."""
        if self.sample is None or self.epoch is None or self.sample.epoch != self.epoch.epoch:
            return 0
        return self.sample.seq - self.epoch.seq + 1 - self._lost

    def farthest(self, window: int) -> dict[str, tuple[float, float]]:
        """Return how far device and host are apart at most in a window, in α and in f; NaN: unknown."""
        return self.tables.farthest(window, self.sample.host_ns * 1e-6 if self.sample else 0.0)

    def offset(self, axis: str) -> float:
        """What is taken off the samples of an axis: its bias, or in the start-up window the mean so far."""
        stats = self._stats_of_epoch(axis)
        return stats.bias if stats and stats.bias is not None else self._means.get(axis, (0, 0.0))[1]

    def _stats_of_epoch(self, axis: str) -> AxisStats | None:
        if self.stats is None or self.epoch is None or self.stats.epoch != self.epoch.epoch:
            return None
        return self.stats.axes.get(axis)

    def _on_hello(self, record: Hello) -> None:
        changed = self.hello is None or self.hello.rate_hz != record.rate_hz
        self.hello = record
        if changed:
            self.tables.set_rate(record.rate_hz)

    def _on_epoch(self, record: Epoch) -> None:
        self._commit(None)
        self.epoch, self.estimate = record, None
        self.newest, self.compared, self._means = {}, {}, {}
        self.fits.begin()
        self._lost = 0
        self.tables.begin(record.host_ns)
        text = f"epoch {record.epoch} begins: {EPOCH_WORDS[record.reason]}"
        self.happenings.append(Happening(record.host_ns, "epoch", text))

    def _on_sample(self, record: Sample) -> None:
        self._commit(None)
        self.sample, self.heard_ns = record, clock.host_ns()
        for axis in self.axes:
            stats = self._stats_of_epoch(axis)
            if stats is None or stats.bias is None:
                count, mean = self._means.get(axis, (0, 0.0))
                self._means[axis] = count + 1, mean + (_value(record, axis) - mean) / (count + 1)

    def _on_estimate(self, record: Estimate) -> None:
        found = record.axes
        self.estimate = record
        self.newest.update(found)
        if self.tables.estimate_on == "device" and any(axis in AXES for axis in found):
            # The device's own estimates come at a pace of their own.
            own = {axis: (self.offset(axis), one) for axis, one in found.items()}
            self.tables.add("own", record.host_ns, own, record.seq)
        else:
            self._commit(record)

    def _on_stats(self, record: Stats) -> None:
        self.stats = record
        if record.device_estimator:
            self.tables.set_device_pace(record.device_estimator.every)
        if record.axes and tuple(record.axes) != self.axes:
            self.tables.set_axes(tuple(record.axes))
            self._written_seq = self.sample.seq if self.sample else None  # its offset is not known
        if self.sample is not None:
            self.tables.add("checks", self.sample.host_ns, record.axes)

    def _commit(self, estimate: Estimate | None) -> None:
        """Write the row of the last sample, with its estimate once there is one."""
        sample = self.sample
        if sample is None or sample.seq == self._written_seq or not self.axes:
            return
        self._written_seq = sample.seq
        estimates = estimate.axes if estimate is not None and estimate.seq == sample.seq else {}
        found = {axis: (self.offset(axis), _value(sample, axis), estimates.get(axis)) for axis in self.axes}
        self.tables.follow(sample.host_ns)
        self.tables.add("rows", sample.host_ns, found, sample.seq, sample.temperature_c)


def _value(sample: Sample, axis: str) -> float:
    if axis in AXES:
        return sample.gyro_dps[AXES.index(axis)]
    return sample.accel_ms2[ACCEL_AXES.index(axis)] if sample.accel_ms2 else np.nan
