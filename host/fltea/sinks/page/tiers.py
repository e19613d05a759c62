"""A past that does not grow: every row for some seconds, buckets of rows for windows that can be shown."""

import itertools
import secrets
from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Kind = Literal["mean", "min", "max"]

MOST_ROWS = 4_000
"""Rows of a window at most: of a quick sensor there are fewer seconds of samples."""

_generations = itertools.count(secrets.randbelow(2**40))
"""A reader's cursor of an earlier start of the program is none of this one."""


class Window(NamedTuple):
    """A length of time. bucket_ms: what one row stands for, 0 for a sample each."""

    label: str
    length_s: float
    bucket_ms: float


WINDOWS = (
    Window("samples", 10, 0),
    Window("30 s", 30, 100),
    Window("2 min", 120, 400),
    Window("10 min", 600, 2_000),
    Window("1 h", 3_600, 12_000),
    Window("24 h", 86_400, 288_000),
)
"""All but the first can be shown, with 300 rows each: so many points a figure has room for."""


class Cursor(NamedTuple):
    """How far a reader has come; the default stands before everything."""

    generation: int = -1
    rows: int = 0


class Rows(NamedTuple):
    """What a reader has not seen yet, (n, columns).

    fresh: what it has seen is void. capacity: rows that the window holds at most.
    """

    values: Array
    fresh: bool
    cursor: Cursor
    capacity: int


class Ring:
    """The last `capacity` rows, numbered from 0."""

    def __init__(self, capacity: int, columns: int) -> None:
        self.capacity = capacity
        self._rows = np.full((capacity, columns), np.nan)
        self.end = 0

    def append(self, row: Array) -> None:
        """Take a row in place of the oldest."""
        self._rows[self.end % len(self._rows)] = row
        self.end += 1

    def since(self, number: int) -> Array:
        """Copy the rows from `number` on, as far as they are still there."""
        first = max(number, self.end - len(self._rows), 0)
        return self._rows[np.arange(first, self.end) % len(self._rows)]


class Tiers:
    """Rows of numbers at all windows' resolutions; the first column is the time in ms.

    kinds: how each column is summed up in a bucket; NaN is left out. rate_hz: rows a second, roughly.
    """

    def __init__(self, kinds: Sequence[Kind], rate_hz: float) -> None:
        self._low = np.array([kind == "min" for kind in kinds])
        self._high = np.array([kind == "max" for kind in kinds])
        self._columns = len(kinds)
        self._rate_hz = rate_hz
        self.clear()

    def clear(self) -> None:
        """Forget everything, readers' cursors included."""
        self._generation = next(_generations)
        self._rings = [Ring(self._capacity(window), self._columns) for window in WINDOWS]
        self._buckets = [0.0] * len(WINDOWS)
        self._taken = [0] * len(WINDOWS)

    def append(self, row: Array) -> None:
        """Take a row; buckets that end with it go to the coarser tiers."""
        self._rings[0].append(row)
        time_ms = row[0]
        for i in range(1, len(WINDOWS)):
            bucket = time_ms // WINDOWS[i].bucket_ms
            if bucket == self._buckets[i]:
                return
            self._buckets[i] = bucket
            self._fill(i, self._rings[i - 1].end - (i == 1))  # of the finest tier, all but this row

    def cut(self, time_ms: float) -> None:
        """Let no line join what was before with what comes next."""
        gap = np.full(self._columns, np.nan)
        gap[0] = time_ms
        for i, ring in enumerate(self._rings):
            if i:
                self._fill(i, self._rings[i - 1].end - 1)
                self._taken[i] = self._rings[i - 1].end
            ring.append(gap)

    def read(self, window: int, cursor: Cursor) -> Rows:
        """What is new to a reader of one window."""
        ring = self._rings[window]
        fresh = cursor.generation != self._generation
        values = ring.since(0 if fresh else cursor.rows)
        return Rows(values, fresh, Cursor(self._generation, ring.end), ring.capacity)

    def _fill(self, tier: int, end: int) -> None:
        """Sum up the finer tier's rows that are not yet taken, those before number `end`."""
        finer = self._rings[tier - 1]
        rows = finer.since(self._taken[tier])
        rows = rows[: len(rows) - (finer.end - end)]
        self._taken[tier] = end
        if len(rows):
            self._rings[tier].append(self._sum_up(rows))

    def _sum_up(self, rows: Array) -> Array:
        good = np.isfinite(rows)
        count = good.sum(axis=0)
        result: Array = np.where(good, rows, 0.0).sum(axis=0) / np.maximum(count, 1)
        result[self._low] = np.where(good, rows, np.inf).min(axis=0)[self._low]
        result[self._high] = np.where(good, rows, -np.inf).max(axis=0)[self._high]
        result[count == 0] = np.nan
        return result

    def _capacity(self, window: Window) -> int:
        period_s = window.bucket_ms / 1000 or 1 / self._rate_hz
        return min(int(np.ceil(window.length_s / period_s)) + 2, MOST_ROWS)
