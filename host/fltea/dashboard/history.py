"""What the page knows of one device: its past in rows, its last records, and what happened to it."""

import threading
from collections import deque
from typing import Literal, NamedTuple

import numpy as np

from fltea import clock
from fltea.config import EstimatorConfig
from fltea.dashboard.tiers import Cursor, Kind, Rows, Tiers
from fltea.dashboard.white_follower import STEP, Sensor, WhiteFollower
from fltea.model import (
    ACCEL_AXES,
    AXES,
    AccelEstimate,
    AccelStats,
    AnyRecord,
    AxisEstimate,
    AxisStats,
    Epoch,
    Error,
    Estimate,
    Gap,
    Hello,
    Sample,
    Stats,
)
from fltea.units import accel_resolution_ms2, resolution_dps

COMMON: dict[str, Kind] = {"time": "mean", "seq": "max", "temperature": "mean"}
OF_AXIS: dict[str, Kind] = {
    "y_low": "min",
    "y": "mean",
    "y_high": "max",
    "state": "mean",
    "alpha": "mean",
    "alpha_std": "mean",
    "f": "mean",
    "f_std": "mean",
}
"""Columns of an axis's rows; y is the sample without its offset."""

WHITE = ("alpha_low", "alpha_mid", "alpha_high", "f_low", "f_mid", "f_high")
CHECKS = ("lag1", "nis")
SILENCE_MS = 1000.0
EVENTS = 60

Table = Literal["rows", "white", "checks"]


class Happening(NamedTuple):
    """An entry of the event list. host_ns: as in the records."""

    host_ns: int
    kind: Literal["epoch", "gap", "error", "missed"]
    text: str


class DeviceHistory:
    """Takes the records of one device in one thread, and is read in others, under `lock`.

    gyro, accel: settings of the axes of each sensor; None leaves an accelerometer without a white band.
    """

    def __init__(self, name: str, gyro: EstimatorConfig, accel: EstimatorConfig | None = None) -> None:
        self.name = name
        self.lock = threading.Lock()
        self.hello: Hello | None = None
        self.epoch: Epoch | None = None
        self.stats: Stats | None = None
        self.sample: Sample | None = None
        self.estimate: Estimate | None = None
        self.error: Error | None = None
        self.error_heard_ns = 0
        self.heard_ns: int | None = None
        """monotonic time of the last sample"""
        self.samples_of_epoch = 0
        self.axes: tuple[str, ...] = ()
        self.followers: dict[str, WhiteFollower | None] = {}
        self.happenings: deque[Happening] = deque(maxlen=EVENTS)
        self._gyro, self._accel = gyro, accel
        self._gaps = (0, 0)
        self._estimates = 0
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

    def read(self, table: Table, window: int, cursor: Cursor) -> Rows:
        """Rows that are new to a reader; columns as in `columns`. Call it under `lock`."""
        return self._tables[table].read(window, cursor)

    def columns(self, table: Table, axis: str) -> dict[str, int]:
        """Where the columns that concern an axis stand in the table's rows."""
        common = list(COMMON) if table == "rows" else ["time"]
        names = {"rows": tuple(OF_AXIS), "white": WHITE, "checks": CHECKS}[table]
        first = len(common) + self.axes.index(axis) * len(names)
        return {name: i for i, name in enumerate(common)} | {name: first + i for i, name in enumerate(names)}

    def offset(self, axis: str) -> float:
        """What is taken off the samples of an axis: its bias, or in the start-up window the mean so far."""
        stats = self.stats
        if stats is not None and self.epoch is not None and stats.epoch == self.epoch.epoch:
            found = axis_stats(stats).get(axis)
            bias = found.bias_dps if isinstance(found, AxisStats) else found.bias_ms2 if found else None
            if bias is not None:
                return bias
        follower = self.followers.get(axis)
        return follower.mean if follower else 0.0

    def _on_hello(self, record: Hello) -> None:
        changed = self.hello is None or self.hello.rate_hz != record.rate_hz
        self.hello = record
        if changed:
            self._make_tables()

    def _on_epoch(self, record: Epoch) -> None:
        self._commit(None)
        self.epoch, self.estimate = record, None
        self.samples_of_epoch = self._estimates = 0
        self._follow()
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
        self.samples_of_epoch += 1
        for axis, follower in self.followers.items():
            if follower is not None:
                follower.on_sample(_value(record, axis))

    def _on_estimate(self, record: Estimate) -> None:
        self.estimate = record
        self._commit(record)
        self._estimates += 1
        both = axis_estimates(record)
        for axis, follower in self.followers.items():
            if follower is not None:
                follower.on_estimate(axis in both and both[axis].valid)
        if self._estimates % STEP == 0 and self.axes:
            row = [record.host_ns * 1e-6]
            for axis in self.axes:
                follower = self.followers[axis]
                row += [np.nan] * 6 if follower is None else [*np.concatenate(follower.quantiles)]
            self._tables["white"].append(np.array(row))

    def _on_stats(self, record: Stats) -> None:
        self.stats = record
        both = axis_stats(record)
        if both and tuple(both) != self.axes:
            self.axes = tuple(both)
            self._make_tables()
            self._follow()
            self._written_seq = self.sample.seq if self.sample else None  # its offset is not known
        if self.axes and self.sample is not None:
            row: list[float | None] = [self.sample.host_ns * 1e-6]
            for axis in self.axes:
                found = both.get(axis)
                row += [found.innovation_lag1, found.innovation_nis] if found else [None, None]
            self._tables["checks"].append(np.array(row, dtype=np.float64))

    def _on_gap(self, record: Gap) -> None:
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
        both = axis_estimates(estimate) if estimate is not None and estimate.seq == sample.seq else {}
        time_ms = sample.host_ns * 1e-6
        if time_ms - self._last_ms > SILENCE_MS:
            self._cut(self._last_ms if np.isfinite(self._last_ms) else time_ms)
        self._last_ms = time_ms
        row: list[float | None] = [time_ms, sample.seq, sample.temperature_c]
        for axis in self.axes:
            y = _value(sample, axis) - self.offset(axis)
            e = both.get(axis)
            row += [y, y, y]
            row += [_state(e), e.alpha, e.alpha_std, e.f, e.f_std] if e else [None] * 5
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
            "rows": Tiers([*COMMON.values(), *[*OF_AXIS.values()] * axes], rate_hz),
            "white": Tiers(["mean"] * (1 + len(WHITE) * axes), rate_hz / STEP),
            "checks": Tiers(["mean"] * (1 + len(CHECKS) * axes), 1.0),
        }

    def _follow(self) -> None:
        """Begin to watch the axes of an epoch."""
        self.followers = {}
        hello = self.hello
        for number, axis in enumerate(self.axes):
            of_gyro = axis in AXES
            config = self._gyro if of_gyro else self._accel
            if hello is None or config is None:
                self.followers[axis] = None
                continue
            resolution = resolution_dps(hello) if of_gyro else accel_resolution_ms2(hello)
            R = config.R if isinstance(config.R, int | float) else None
            if isinstance(config.R, list):
                R = config.R[[a for a in self.axes if (a in AXES) == of_gyro].index(axis)]
            self.followers[axis] = WhiteFollower(Sensor(config, 1 / hello.rate_hz, resolution), R, number)

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


def axis_stats(record: Stats) -> dict[str, AxisStats | AccelStats]:
    """Statistics of the axes of both sensors."""
    return {**record.axes, **(record.accel_axes or {})}


def axis_estimates(record: Estimate) -> dict[str, AxisEstimate | AccelEstimate]:
    """Estimates of the axes of both sensors."""
    return {**record.axes, **(record.accel_axes or {})}


def _state(e: AxisEstimate | AccelEstimate) -> float | None:
    return e.state_dps if isinstance(e, AxisEstimate) else e.state_ms2


def _value(sample: Sample, axis: str) -> float:
    if axis in AXES:
        return sample.gyro_dps[AXES.index(axis)]
    return sample.accel_ms2[ACCEL_AXES.index(axis)] if sample.accel_ms2 else np.nan
