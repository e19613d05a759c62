"""The past of a device in rows, which the figures draw: one table for each pace at which rows come."""

from collections.abc import Callable, Mapping, Sequence
from operator import attrgetter
from typing import Any, Literal

import numpy as np

from fltea.records.fit import AxisFit
from fltea.records.records import AXES, AxisEstimate, DeviceAxisEstimate
from fltea.settings.estimator import EstimateOn
from fltea.sinks.page.answer import order
from fltea.sinks.page.tiers import WINDOWS, Cursor, Kind, Rows, Tiers

SILENCE_MS = 1000.0
"""After a pause of this length a line is interrupted."""

Table = Literal["rows", "fits", "checks", "own", "compared"]
"""fits: α and f of the fit with their intervals, NaN where undefined; own: estimates of the device in place
of the host's; compared: those of the device that are compared with the host's, at its own pace."""

ESTIMATE: dict[str, Kind] = dict.fromkeys(("state", "alpha", "alpha_std", "f", "f_std"), "mean")

COMMON: dict[Table, dict[str, Kind]] = {
    "rows": {"time": "mean", "seq": "max", "temperature": "mean"},
    "fits": {"time": "mean"},
    "checks": {"time": "mean"},
    "own": {"time": "mean", "seq": "max"},
    "compared": {"time": "mean"},
}
OF_AXIS: dict[Table, dict[str, Kind]] = {
    "rows": {"y_low": "min", "y": "mean", "y_high": "max", **ESTIMATE},
    "fits": dict.fromkeys(("alpha_low", "alpha_mid", "alpha_high", "f_low", "f_mid", "f_high"), "mean"),
    "checks": dict.fromkeys(("lag1", "nis"), "mean"),
    "own": ESTIMATE,
    "compared": {
        "alpha": "mean",
        "f": "mean",
        "apart_low": "min",
        "apart": "mean",
        "apart_high": "max",
        "f_apart": "max",
    },
}
"""Columns of each axis. y: the sample without its offset; apart: α of the device minus that of the host;
f_apart: how far its f is from the host's."""


Numbers = Sequence[float | None]


def _of_estimate(found: tuple[float, AxisEstimate]) -> Numbers:
    """What is known of an axis, without the offset that is drawn as 0."""
    offset, e = found
    state = None if e.bias is None else e.bias - offset
    return [state, e.fltea.alpha, e.fltea.alpha_std, e.fltea.f, e.fltea.f_std]


def _of_sample(found: tuple[float, float, AxisEstimate | None]) -> Numbers:
    """A sample without its offset, and its estimate."""
    offset, value, e = found
    y = value - offset
    return [y, y, y, *(_of_estimate((offset, e)) if e else [None] * len(ESTIMATE))]


def _of_fit(found: AxisFit) -> Numbers:
    """α and f with their intervals."""
    row: list[float | None] = []
    for p in order(found):
        row += [p.low, p.value, p.high] if p else [None] * 3
    return row


def _of_compared(e: DeviceAxisEstimate) -> Numbers:
    """What a device's own estimate says, and how far it is from the host's."""
    apart, f_apart = e.alpha_difference, e.f_difference
    return [e.alpha, e.f, apart, apart, apart, None if f_apart is None else abs(f_apart)]


NUMBERS: dict[Table, Callable[[Any], Numbers]] = {
    "rows": _of_sample,
    "fits": _of_fit,
    "checks": attrgetter("innovation_lag1", "innovation_nis"),
    "own": _of_estimate,
    "compared": _of_compared,
}
"""What a record's axis says, in the order of the columns."""


class Tables:
    """Has the tables of all axes, and makes them again when axes or rates change.

    estimate_on: who estimates the gyroscope's axes. axes: those that have columns.
    """

    def __init__(self, estimate_on: EstimateOn) -> None:
        self.estimate_on = estimate_on
        self.axes: tuple[str, ...] = ()
        self._rate_hz = 100.0
        self._every = 1
        self._last_ms = -np.inf
        self._make()

    def set_rate(self, rate_hz: float) -> None:
        """Begin with samples of another rate."""
        self._rate_hz = rate_hz
        self._make()

    def set_axes(self, axes: tuple[str, ...]) -> None:
        """Begin with other axes."""
        self.axes = axes
        self._make()

    def set_device_pace(self, every: int) -> None:
        """Take note that the device estimates one sample in `every`."""
        if every and every != self._every:
            self._every = every
            self._make_of_device()

    def estimator(self, axis: str) -> EstimateOn:
        """Return who estimates an axis."""
        return self.estimate_on if axis in AXES else "host"

    def drawn(self, axis: str) -> list[Table]:
        """Tables that the figures of an axis draw."""
        of: dict[EstimateOn, list[Table]] = {
            "host": ["rows", "fits", "checks"],
            "device": ["rows", "fits", "own"],
            "both": ["rows", "fits", "checks", "compared"],
        }
        return [table for table in of[self.estimator(axis)] if table in self._tables]

    def begin(self, host_ns: int) -> None:
        """Interrupt all lines, since an epoch begins; what is later than it, after a change of date, goes."""
        now_ms = host_ns * 1e-6
        if now_ms < self._last_ms:
            for table in self._tables.values():
                table.clear()
            self._last_ms = -np.inf
        else:
            self._cut(now_ms)
            self._last_ms = now_ms

    def follow(self, host_ns: int) -> None:
        """Take note of the time of a sample: after a silence all lines are interrupted."""
        time_ms = host_ns * 1e-6
        if time_ms - self._last_ms > SILENCE_MS:
            self._cut(self._last_ms if np.isfinite(self._last_ms) else time_ms)
        self._last_ms = time_ms

    def add(self, table: Table, host_ns: int, found: Mapping[str, Any], *common: float | None) -> None:
        """Append a row: the time, what is common to all axes, and the columns of each axis."""
        if not self.axes:
            return
        row: list[float | None] = [host_ns * 1e-6, *common]
        for axis in self.axes:
            row += NUMBERS[table](found[axis]) if axis in found else [None] * len(OF_AXIS[table])
        self._tables[table].append(np.array(row, dtype=np.float64))

    def read(self, table: Table, window: int, cursor: Cursor) -> Rows:
        """Return rows that are new to a reader; columns as in `columns`."""
        return self._tables[table].read(window, cursor)

    def columns(self, table: Table, axis: str) -> dict[str, int]:
        """Return where the columns that concern an axis stand in the table's rows."""
        common, names = COMMON[table], OF_AXIS[table]
        first = len(common) + self.axes.index(axis) * len(names)
        return {name: i for i, name in enumerate(common)} | {name: first + i for i, name in enumerate(names)}

    def farthest(self, window: int, end_ms: float) -> dict[str, tuple[float, float]]:
        """Return how far device and host are apart at most in a window, in α and in f; NaN: unknown."""
        values = self.read("compared", window, Cursor()).values
        shown = values[values[:, 0] >= end_ms - WINDOWS[window].length_s * 1e3]
        found = {}
        for axis in self.axes:
            places = self.columns("compared", axis)
            low, high, f = (shown[:, places[name]] for name in ("apart_low", "apart_high", "f_apart"))
            alpha = np.fmax.reduce(np.fmax(-low, high), initial=np.nan)
            found[axis] = float(alpha), float(np.fmax.reduce(f, initial=np.nan))
        return found

    def _cut(self, time_ms: float) -> None:
        for table in self._tables.values():
            table.cut(time_ms)

    def _make(self) -> None:
        self._tables: dict[Table, Tiers] = {}
        self._add_table("rows", self._rate_hz)
        self._add_table("fits", 1.0)
        self._add_table("checks", 1.0)
        self._make_of_device()

    def _make_of_device(self) -> None:
        tables: dict[EstimateOn, Table] = {"device": "own", "both": "compared"}
        if self.estimate_on in tables:
            self._add_table(tables[self.estimate_on], self._rate_hz / self._every)

    def _add_table(self, table: Table, rate_hz: float) -> None:
        kinds = [*COMMON[table].values(), *[*OF_AXIS[table].values()] * len(self.axes)]
        self._tables[table] = Tiers(kinds, rate_hz)
