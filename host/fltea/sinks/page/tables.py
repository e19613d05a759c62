"""The past of a device in rows, which the figures draw: one table for each pace at which rows come."""

from collections.abc import Callable, Mapping
from typing import TypeVar

import numpy as np

from fltea.records.records import AXES
from fltea.settings.estimator import EstimateOn
from fltea.sinks.page import row_layout
from fltea.sinks.page.row_layout import Table
from fltea.sinks.page.tiers import WINDOWS, Cursor, Rows, Tiers

SILENCE_MS = 1000.0
"""After a pause of this length a line is interrupted."""

Of = TypeVar("Of")


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

    def add(
        self,
        table: Table,
        host_ns: int,
        found: Mapping[str, Of],
        columns: Callable[[Of | None], list[float | None]],
        *common: float | None,
    ) -> None:
        """Append a row: the time, what is common to all axes, and the columns of each axis."""
        if not self.axes:
            return
        row: list[float | None] = [host_ns * 1e-6, *common]
        for axis in self.axes:
            row += columns(found.get(axis))
        self._tables[table].append(np.array(row, dtype=np.float64))

    def read(self, table: Table, window: int, cursor: Cursor) -> Rows:
        """Return rows that are new to a reader; columns as in `columns`."""
        return self._tables[table].read(window, cursor)

    def columns(self, table: Table, axis: str) -> dict[str, int]:
        """Return where the columns that concern an axis stand in the table's rows."""
        return row_layout.places(table, self.axes, axis)

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
        axes = len(self.axes)
        self._tables: dict[Table, Tiers] = {
            "rows": row_layout.make("rows", axes, self._rate_hz),
            "fits": row_layout.make("fits", axes, 1.0),
            "checks": row_layout.make("checks", axes, 1.0),
        }
        self._make_of_device()

    def _make_of_device(self) -> None:
        tables: dict[EstimateOn, Table] = {"device": "own", "both": "compared"}
        table = tables.get(self.estimate_on)
        if table is not None:
            self._tables[table] = row_layout.make(table, len(self.axes), self._rate_hz / self._every)
