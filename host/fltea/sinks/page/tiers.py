"""Keep rows of numbers over time in limited memory, at a suitable resolution for each time window."""

import itertools
import secrets
from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np

from fltea.records.arrays import Array

Kind = Literal["mean", "min", "max"]

MOST_ROWS = 302
"""Largest number of rows of a time window. 300 rows cover the window, and one more row at each end lets the
curves reach both edges of the diagram.
"""

_generations = itertools.count(secrets.randbelow(2**40))
"""The numbers of the generations of rows; a new generation begins when all rows are forgotten. The first
number is random, so that cursors from an earlier run of the program are not valid.
"""


class Window(NamedTuple):
    """A time window that the page can show. `bucket_ms`: duration that one row of numbers covers [ms]."""

    label: str
    length_s: float
    bucket_ms: float


WINDOWS = (
    Window("30 s", 30, 100),
    Window("2 min", 120, 400),
    Window("10 min", 600, 2_000),
    Window("1 h", 3_600, 12_000),
    Window("24 h", 86_400, 288_000),
)


class Cursor(NamedTuple):
    """A cursor, which says how far a page has read the rows. The default stands for a page that has no rows.

    `generation`: number that changes when all rows are forgotten. `rows`: number of the next row to read.
    """

    generation: int = -1
    rows: int = 0


class Rows(NamedTuple):
    """The rows that a page lacks, as an array (n, columns).

    `fresh`: whether the rows that the page already has are no longer valid.
    """

    values: Array
    fresh: bool
    cursor: Cursor


class Ring:
    """The last rows of a time window.

    Rows are numbered from 0 on, including those that are no longer kept.
    """

    def __init__(self, columns: int) -> None:
        self._rows = np.full((MOST_ROWS, columns), np.nan)
        self.end = 0

    def append(self, row: Array) -> None:
        """Add a row, which replaces the oldest one once there are `MOST_ROWS`."""
        self._rows[self.end % MOST_ROWS] = row
        self.end += 1

    def since(self, number: int) -> Array:
        """Return a copy of the rows from `number` on, as far as they are still kept."""
        first = max(number, self.end - MOST_ROWS, 0)
        return self._rows[np.arange(first, self.end) % MOST_ROWS]


class Tiers:
    """Keeps the rows of all time windows. The first column of a row is the time in ms.

    `kinds`: for each column, how the values of several rows are merged into one. NaN is ignored.
    """

    def __init__(self, kinds: Sequence[Kind]) -> None:
        self._low = np.array([kind == "min" for kind in kinds])
        self._high = np.array([kind == "max" for kind in kinds])
        self._columns = len(kinds)
        self.clear()

    def clear(self) -> None:
        """Forget all rows. Each page then gets all new rows, since its cursor is no longer valid."""
        self._generation = next(_generations)
        self._rings = [Ring(self._columns) for _ in WINDOWS]
        self._buckets = [0.0] * len(WINDOWS)
        self._waiting: list[list[Array]] = [[] for _ in WINDOWS]

    def append(self, row: Array, tier: int = 0) -> None:
        """Add a row to a time window, which keeps only one row for each duration `bucket_ms`.

        So the row waits until all rows of this duration have come, and they are merged into one. The merged
        row is kept, and is also added to the next longer window. `tier`: index of the window in `WINDOWS`.
        """
        bucket = row[0] // WINDOWS[tier].bucket_ms
        if bucket != self._buckets[tier]:
            self._close(tier)
            self._buckets[tier] = bucket
        self._waiting[tier].append(row)

    def cut(self, time_ms: float) -> None:
        """Interrupt all curves, so that no curve connects earlier rows with later ones."""
        gap = np.full(self._columns, np.nan)
        gap[0] = time_ms
        for tier, ring in enumerate(self._rings):
            self._close(tier)
            ring.append(gap)

    def read(self, window: int, cursor: Cursor) -> Rows:
        """Return the rows of a time window that a page lacks."""
        ring = self._rings[window]
        fresh = cursor.generation != self._generation
        return Rows(ring.since(0 if fresh else cursor.rows), fresh, Cursor(self._generation, ring.end))

    def _close(self, tier: int) -> None:
        if not self._waiting[tier]:
            return
        row = self._sum_up(np.array(self._waiting[tier]))
        self._waiting[tier] = []
        self._rings[tier].append(row)
        if tier + 1 < len(WINDOWS):
            self.append(row, tier + 1)

    def _sum_up(self, rows: Array) -> Array:
        good = np.isfinite(rows)
        count = good.sum(axis=0)
        result: Array = np.where(good, rows, 0.0).sum(axis=0) / np.maximum(count, 1)
        result[self._low] = np.where(good, rows, np.inf).min(axis=0)[self._low]
        result[self._high] = np.where(good, rows, -np.inf).max(axis=0)[self._high]
        result[count == 0] = np.nan
        return result
