"""What the page knows of one device: its past in rows, its last records, and what happened to it."""

import itertools
import threading
from collections import deque
from typing import Literal, NamedTuple

import numpy as np

from fltea.records import clock
from fltea.records.device_fit import DeviceAxisFit, DeviceSpectrum
from fltea.records.fit import AxisFit, FitAllan, FitSpectrum
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
from fltea.sinks.page import row_layout
from fltea.sinks.page.row_layout import Table
from fltea.sinks.page.tiers import WINDOWS, Cursor, Rows, Tiers

SILENCE_MS = 1000.0
EVENTS = 60

_numbers = itertools.count(1)


class Happening(NamedTuple):
    """An entry of the event list. host_ns: as in the records."""

    host_ns: int
    kind: Literal["epoch", "gap", "error", "missed"]
    text: str


class Curves(NamedTuple):
    """The newest curves of an axis. number: another one for every change."""

    number: int
    spectrum: FitSpectrum | None = None
    allan: FitAllan | None = None


class DeviceHistory:
    """Takes the records of one device in one thread, and is read in others, under `lock`.

    estimate_on: who estimates the gyroscope's axes. newest: of every axis, the last estimate of the epoch;
    newest_beside: the device's. device_fits, device_spectra: its own fits of every axis, and their newest
    bins. fit: the last fit, which goes on through epochs of the same sensor; fits: of every axis; curves:
    likewise.
    """

    def __init__(self, name: str, estimate_on: EstimateOn) -> None:
        self.name = name
        self.lock = threading.Lock()
        self.hello: Hello | None = None
        self.epoch: Epoch | None = None
        self.stats: Stats | None = None
        self.sample: Sample | None = None
        self.estimate: Estimate | None = None
        self.newest: dict[str, AxisEstimate] = {}
        self.newest_beside: dict[str, DeviceAxisEstimate] = {}
        self.device_fits: dict[str, DeviceAxisFit] = {}
        self.device_spectra: dict[str, DeviceSpectrum] = {}
        self.fit: Fit | None = None
        self.fits: dict[str, AxisFit] = {}
        self.curves: dict[str, Curves] = {}
        self.error: Error | None = None
        self.error_heard_ns = 0
        self.heard_ns: int | None = None
        """monotonic time of the last sample"""
        self.axes: tuple[str, ...] = ()
        self.happenings: deque[Happening] = deque(maxlen=EVENTS)
        self._estimator = estimate_on
        self._gaps = (0, 0)
        self._lost = 0
        self._means: dict[str, tuple[int, float]] = {}
        self._every = 1
        self._written_seq: int | None = None
        self._last_ms = -np.inf
        self._make_tables()

    def write(self, record: AnyRecord) -> None:
        """Take a record."""
        with self.lock:
            match record:
                case Sample():
                    self._on_sample(record)
                case Estimate():
                    self._on_estimate(record)
                case DeviceEstimates():
                    self._on_device_estimates(record)
                case DeviceFits():
                    self._on_device_fits(record)
                case Fit():
                    self._on_fit(record)
                case Stats():
                    self._on_stats(record)
                case Hello():
                    self._on_hello(record)
                case Epoch():
                    self._on_epoch(record)
                case Gap():
                    self._on_gap(record)
                case Error():
                    self.error, self.error_heard_ns = record, clock.host_ns()
                    self._happen(record.host_ns, "error", f"{record.kind}: {record.message}")

    def missed(self, count: int) -> None:
        """Take note that `count` records did not reach the page."""
        with self.lock:
            host_ns = self.sample.host_ns if self.sample else 0
            self._happen(host_ns, "missed", f"the page missed {count} records: it was too slow")

    @property
    def samples_of_epoch(self) -> int:
        """Samples of the epoch until the newest one; the page may not have got each of them."""
        if self.sample is None or self.epoch is None or self.sample.epoch != self.epoch.epoch:
            return 0
        return self.sample.seq - self.epoch.seq + 1 - self._lost

    def estimator(self, axis: str) -> EstimateOn:
        """Who estimates an axis."""
        return self._estimator if axis in AXES else "host"

    def farthest(self, window: int) -> dict[str, tuple[float, float]]:
        """How far device and host are apart at most in a window, in α and in f; NaN: unknown."""
        values = self.read("beside", window, Cursor()).values
        end_ms = self.sample.host_ns * 1e-6 if self.sample else 0.0
        shown = values[values[:, 0] >= end_ms - WINDOWS[window].length_s * 1e3]
        found = {}
        for axis in self.axes:
            places = self.columns("beside", axis)
            low, high, f = (shown[:, places[name]] for name in ("apart_low", "apart_high", "f_apart"))
            alpha = np.fmax.reduce(np.fmax(-low, high), initial=np.nan)
            found[axis] = float(alpha), float(np.fmax.reduce(f, initial=np.nan))
        return found

    def read(self, table: Table, window: int, cursor: Cursor) -> Rows:
        """Rows that are new to a reader; columns as in `columns`. Call it under `lock`."""
        return self._tables[table].read(window, cursor)

    def columns(self, table: Table, axis: str) -> dict[str, int]:
        """Where the columns that concern an axis stand in the table's rows."""
        return row_layout.places(table, self.axes, axis)

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
            self._make_tables()

    def _on_epoch(self, record: Epoch) -> None:
        self._commit(None)
        self.epoch, self.estimate = record, None
        self.newest, self.newest_beside, self._means = {}, {}, {}
        self.device_fits, self.device_spectra = {}, {}
        self._lost = 0
        now_ms = record.host_ns * 1e-6
        if now_ms < self._last_ms:  # the date was set back
            self._clear()
        else:
            self._cut(now_ms)
            self._last_ms = now_ms
        self._happen(record.host_ns, "epoch", f"epoch {record.epoch} begins: {EPOCH_WORDS[record.reason]}")

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
        if self._estimator == "device" and any(axis in AXES for axis in found):
            self._keep_own(record)
        else:
            self._commit(record)

    def _keep_own(self, record: Estimate) -> None:
        """Take the device's own estimates, which come at a pace of their own."""
        if not self.axes:
            return
        row: list[float | None] = [record.host_ns * 1e-6, record.seq]
        for axis in self.axes:
            row += row_layout.estimate(record.axes.get(axis))
        self._tables["own"].append(np.array(row, dtype=np.float64))

    def _on_device_estimates(self, record: DeviceEstimates) -> None:
        self.newest_beside |= record.axes
        if not self.axes:
            return
        row: list[float | None] = [record.host_ns * 1e-6]
        for axis in self.axes:
            row += row_layout.beside(record.axes.get(axis))
        self._tables["beside"].append(np.array(row, dtype=np.float64))

    def _on_device_fits(self, record: DeviceFits) -> None:
        self.device_fits |= record.axes
        for axis, found in record.axes.items():
            if found.spectrum is not None:
                self.device_spectra[axis] = found.spectrum

    def _on_fit(self, record: Fit) -> None:
        if self.fit is not None and record.samples < self.fit.samples:  # of another sensor
            self.fits, self.curves = {}, {}
        self.fit = record
        self.fits |= record.axes
        for axis, found in record.axes.items():
            if found.spectrum is not None or found.allan is not None:
                before = self.curves.get(axis, Curves(0))
                spectrum, allan = found.spectrum or before.spectrum, found.allan or before.allan
                self.curves[axis] = Curves(next(_numbers), spectrum, allan)
        if self.axes:
            row: list[float | None] = [record.host_ns * 1e-6]
            for axis in self.axes:
                row += row_layout.fit(record.axes.get(axis))
            self._tables["fits"].append(np.array(row, dtype=np.float64))

    def _on_stats(self, record: Stats) -> None:
        self.stats = record
        every = record.device_estimator.every if record.device_estimator else self._every
        if every and every != self._every:
            self._every = every
            self._make_table_of_device()
        both = record.axes
        if both and tuple(both) != self.axes:
            self.axes = tuple(both)
            self._make_tables()
            self._written_seq = self.sample.seq if self.sample else None  # its offset is not known
        if self.axes and self.sample is not None:
            time_ms = self.sample.host_ns * 1e-6
            checks: list[float | None] = [time_ms]
            for axis in self.axes:
                found = both.get(axis)
                checks += [found.innovation_lag1, found.innovation_nis] if found else [None, None]
            self._tables["checks"].append(np.array(checks, dtype=np.float64))

    def _on_gap(self, record: Gap) -> None:
        if self.epoch is not None and record.epoch == self.epoch.epoch:
            self._lost += record.missing
        newest = self.happenings[-1] if self.happenings else None
        gaps, missing = self._gaps if newest is not None and newest.kind == "gap" else (0, 0)
        if gaps:
            self.happenings.pop()
        self._gaps = gaps + 1, missing + record.missing
        what = "a gap" if not gaps else f"{gaps + 1} gaps"
        self._happen(record.host_ns, "gap", f"{what}: {self._gaps[1]} samples lost")

    def _commit(self, estimate: Estimate | None) -> None:
        """Write the row of the last sample, with its estimate once there is one."""
        sample = self.sample
        if sample is None or sample.seq == self._written_seq or not self.axes:
            return
        self._written_seq = sample.seq
        both = estimate.axes if estimate is not None and estimate.seq == sample.seq else {}
        time_ms = sample.host_ns * 1e-6
        if time_ms - self._last_ms > SILENCE_MS:
            self._cut(self._last_ms if np.isfinite(self._last_ms) else time_ms)
        self._last_ms = time_ms
        row: list[float | None] = [time_ms, sample.seq, sample.temperature_c]
        for axis in self.axes:
            y = _value(sample, axis) - self.offset(axis)
            row += [y, y, y]
            row += row_layout.estimate(both.get(axis))
        self._tables["rows"].append(np.array(row, dtype=np.float64))

    def _cut(self, time_ms: float) -> None:
        for table in self._tables.values():
            table.cut(time_ms)

    def _clear(self) -> None:
        for table in self._tables.values():
            table.clear()
        self._last_ms = -np.inf

    def _make_tables(self) -> None:
        rate_hz = self.hello.rate_hz if self.hello else 100.0
        axes = len(self.axes)
        self._tables: dict[Table, Tiers] = {
            "rows": row_layout.make("rows", axes, rate_hz),
            "fits": row_layout.make("fits", axes, 1.0),
            "checks": row_layout.make("checks", axes, 1.0),
        }
        self._make_table_of_device()

    def _make_table_of_device(self) -> None:
        rate_hz = (self.hello.rate_hz if self.hello else 100.0) / self._every
        if self._estimator == "device":
            self._tables["own"] = row_layout.make("own", len(self.axes), rate_hz)
        if self._estimator == "both":
            self._tables["beside"] = row_layout.make("beside", len(self.axes), rate_hz)

    def _happen(self, host_ns: int, kind: Literal["epoch", "gap", "error", "missed"], text: str) -> None:
        self.happenings.append(Happening(host_ns, kind, text))


EPOCH_WORDS = {
    "start": "the first since the program started",
    "restart": "the device restarted",
    "sensor_restart": "the device set up its sensor again",
    "discontinuity": "sequence and time disagreed",
    "gap": "a gap too long to bridge",
    "silence": "half an hour of silence",
    "resumed": "resumed from a snapshot",
}


def _value(sample: Sample, axis: str) -> float:
    if axis in AXES:
        return sample.gyro_dps[AXES.index(axis)]
    return sample.accel_ms2[ACCEL_AXES.index(axis)] if sample.accel_ms2 else np.nan
