"""Keep the past values of a device, from which the page draws diagrams over time.

There is one row of numbers for each sample, with the values of all axes. To save memory, the rows of
neighbouring samples are merged.
"""

from collections.abc import Mapping

import numpy as np

from fltea.records.arrays import Array
from fltea.sinks.page.tiers import WINDOWS, Cursor, Kind, Rows, Tiers

SILENCE_MS = 1000.0
"""Length of a pause between samples after which a curve is interrupted [ms]."""

STALE_MS = 5000.0
"""Time for which an estimate is drawn if no newer estimate comes [ms]."""

COMMON: dict[str, Kind] = {"time": "mean", "temperature": "mean"}

FIT = ("alpha_low", "alpha_mid", "alpha_high", "f_low", "f_mid", "f_high")

ESTIMATED: dict[str, Kind] = {
    **dict.fromkeys(("state", "state_std", "alpha", "alpha_std", "f", "f_std", "lag1", "nis"), "mean"),
    **dict.fromkeys(("device_alpha", "device_f", "apart"), "mean"),
    "apart_low": "min",
    "apart_high": "max",
    "f_apart": "max",
}
"""Columns with estimates of an axis. For each name: which value the column has after rows were merged, such
as the mean of the merged values. `apart`: α from the device minus α from this computer. `f_apart`: absolute
difference between f from the device and f from this computer.
"""

OF_AXIS: dict[str, Kind] = {
    "y_low": "min",
    "y": "mean",
    "y_high": "max",
    **dict.fromkeys(FIT, "mean"),
    **ESTIMATED,
}
"""All columns of an axis. For each name: which value the column has after rows were merged. `y`: the sample
minus an offset (see `History.offset`), so that the curve is near zero. `state`: the bias minus this offset.
"""

DRAWN = ("y_low", "y", "y_high", "state", "state_std")
"""Columns of the small diagram that the page shows for each axis."""


class Course:
    """Keeps rows of samples and estimates.

    A row consists of a sample and of the newest estimates at the sample's time.
    """

    def __init__(self) -> None:
        self._last_ms = -np.inf
        self.set_axes(())

    def set_axes(self, axes: tuple[str, ...]) -> None:
        """Forget all rows, and begin again with other axes."""
        self.axes = axes
        self._row = np.full(len(COMMON) + len(axes) * len(OF_AXIS), np.nan)
        self._places = {axis: self.columns(axis) for axis in axes}
        self._estimated_ms = dict.fromkeys(axes, -np.inf)
        self._tiers = Tiers([*COMMON.values(), *[*OF_AXIS.values()] * len(axes)])

    def columns(self, axis: str) -> dict[str, int]:
        """Return where the values of an axis are in a row: a dictionary from the column's name to its index.

        The columns that all axes share, such as the time, are included.
        """
        first = len(COMMON) + self.axes.index(axis) * len(OF_AXIS)
        return {name: i for i, name in enumerate(COMMON)} | {
            name: first + i for i, name in enumerate(OF_AXIS)
        }

    def drawn(self) -> dict[str, int]:
        """Return where the values for the small diagrams are in a row: a dictionary from names to indices.

        The names are "time", and for each axis and column "AXIS COLUMN", such as "gyro_x state".
        """
        places = {f"{axis} {name}": self.columns(axis)[name] for axis in self.axes for name in DRAWN}
        return {"time": 0} | places

    def know(self, axis: str, host_ns: int, values: Mapping[str, float | None]) -> None:
        """Note new estimates of an axis. All rows from now on contain them.

        `values`: the estimates, by the names of their columns.
        """
        places = self._places.get(axis)
        if places is None:
            return
        for name, value in values.items():
            self._row[places[name]] = np.nan if value is None else value
        if "alpha" in values or "device_alpha" in values:
            self._estimated_ms[axis] = host_ns * 1e-6

    def begin(self, host_ns: int) -> None:
        """Begin an epoch: interrupt all curves.

        If the clock was set back, so that earlier rows have later times, forget all rows.
        """
        time_ms = host_ns * 1e-6
        if time_ms < self._last_ms:
            self._tiers.clear()
        elif np.isfinite(self._last_ms):
            self._tiers.cut(time_ms)
        self._last_ms = time_ms
        for axis in self.axes:
            self._forget(axis)

    def sample(self, host_ns: int, temperature_c: float | None, y: Mapping[str, float]) -> None:
        """Append a row.

        `y`: for each axis, the sample minus the offset. The columns `y_low`, `y` and `y_high` all get this
        value, and differ only after rows were merged.
        """
        time_ms = host_ns * 1e-6
        if time_ms - self._last_ms > SILENCE_MS and np.isfinite(self._last_ms):
            self._tiers.cut(self._last_ms)
        self._last_ms = time_ms
        row = self._row
        row[:2] = time_ms, np.nan if temperature_c is None else temperature_c
        for axis, places in self._places.items():
            first = places["y_low"]
            row[first : first + 3] = y[axis]
            if time_ms - self._estimated_ms[axis] > STALE_MS:
                self._forget(axis)
        if self.axes:
            self._tiers.append(row.copy())

    def read(self, window: int, cursor: Cursor) -> Rows:
        """Return the rows that a page does not have yet.

        The method `columns` says which columns a row has.
        """
        return self._tiers.read(window, cursor)

    def farthest(self, window: int, axis: str) -> tuple[float, float]:
        """Return how far the device's estimates were from this computer's, at most, in a time window.

        There are two numbers: the largest absolute difference of α, and that of f. One that is unknown in the
        whole time window is NaN.
        """
        values, places = self.read(window, Cursor()).values, self._places[axis]
        shown: Array = values[values[:, 0] >= self._last_ms - WINDOWS[window].length_s * 1e3]
        low, high, f = (shown[:, places[name]] for name in ("apart_low", "apart_high", "f_apart"))
        alpha = np.fmax.reduce(np.fmax(-low, high), initial=np.nan)
        return float(alpha), float(np.fmax.reduce(f, initial=np.nan))

    def _forget(self, axis: str) -> None:
        for name in ESTIMATED:
            self._row[self._places[axis][name]] = np.nan
