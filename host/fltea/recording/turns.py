"""Selects the rows of one sensor from a table in which the rows of several sensors alternate.

No column of the table names the sensor.
"""

import numpy as np

from fltea.recording.sample_times import SAME_TIME, Floats, Ints, Marks
from fltea.recording.table import Rows, joined

MEASURED_ROUNDS, STEADY = 8, 0.2
"""A round is one row of each sensor. The first MEASURED_ROUNDS rounds show the steps of time between the rows
of a round. If all later steps differ from them by at most STEADY times the shortest step, no row is missing.
"""


class Turns:
    """Takes the rows of all sensors, and returns the rows of one sensor.

    `which`: index of the sensor, from 0. `count`: number of sensors. `time`: column of times, or None.

    If several rows have the same time, there is one row of each sensor at each time, in a fixed order. If a
    row is missing at a time, all rows at that time are left out, since it is unknown which sensor's row is
    missing. If all times differ, the steps between times show which sensor's row is missing. Without times,
    the order of the rows decides.
    """

    def __init__(self, which: int, count: int, time: int | None) -> None:
        self._which, self._count, self._time = which, count, time
        self._held: list[Rows] = []
        self._are_groups: bool | None = None
        self._steps: Floats | None = None
        self._last: tuple[float, int] | None = None
        self._ordinal = 0

    def take(self, rows: Rows) -> list[Rows]:
        """Return the sensor's rows from the rows that were held back and from `rows`.

        Hold the last few rows back.
        """
        found = self.finish() if rows.begins else []
        self._held.append(rows)
        if (
            self._time is not None
            and sum(len(one.values) for one in self._held) < MEASURED_ROUNDS * self._count
        ):
            return found
        return found + self._release(is_last=False)

    def finish(self) -> list[Rows]:
        """Return the sensor's rows from the rows that were held back. Call this at the end of a run."""
        found = self._release(is_last=True)
        self._are_groups = self._steps = self._last = None
        return found

    def _release(self, *, is_last: bool) -> list[Rows]:
        if not self._held:
            return []
        numbers, values, ordinal, begins = joined(self._held)
        self._held = []
        if self._time is None:
            ours = ordinal % self._count == self._which
            return _some(numbers[ours], values[ours], ordinal[ours] // self._count, begins)
        time = values[:, self._time]
        same = np.abs(np.diff(time)) <= SAME_TIME * np.abs(time[1:])
        if self._are_groups is None:
            self._are_groups = bool(same.any())
        if not self._are_groups:
            ours = self._turn_of(time) == self._which
        else:
            edges = np.flatnonzero(~same) + 1
            if not is_last:  # more rows with the last time may follow
                end = int(edges[-1]) if len(edges) else 0
                self._held = [Rows(numbers[end:], values[end:], ordinal[end:], begins and not end)]
                numbers, values, edges = numbers[:end], values[:end], edges[:-1]
            ours = self._of_groups(len(values), edges)
        first, self._ordinal = self._ordinal, self._ordinal + int(ours.sum())
        return _some(numbers[ours], values[ours], np.arange(first, self._ordinal), begins)

    def _of_groups(self, rows: int, edges: Ints) -> Marks:
        """Mark the rows of the sensor to read. A group of rows with equal times has one row of each sensor.

        `rows`: number of rows. `edges`: rows, other than row 0, at which a group begins. A group gets no mark
        if a row is missing in it. It may hold several complete rounds of the sensors.
        """
        ours = np.zeros(rows, np.bool_)
        begin = np.concatenate([[0], edges])
        sizes = np.diff(begin, append=rows)
        for size in np.unique(sizes[(sizes > 0) & (sizes % self._count == 0)]).tolist():
            for k in range(self._which, size, self._count):
                ours[begin[sizes == size] + k] = True
        return ours

    def _turn_of(self, time: Floats) -> Ints:
        """Return for each row the index of its sensor, which follows from the steps between times."""
        if self._steps is None:
            # A round is one row of each sensor. For each step of a round, the median over a few rounds is
            # taken. These are few since, after a missing row, each step stands in the place of another.
            rounds = min(len(time[1:]) // self._count, MEASURED_ROUNDS)
            steps = np.diff(time[: 1 + rounds * self._count])
            self._steps = np.nanmedian(steps.reshape(-1, self._count), axis=0)
        if self._last is None:
            turn, taken = [0], np.diff(time)
        else:
            turn, taken = [], np.diff(time, prepend=self._last[0])
        now = 0 if self._last is None else self._last[1]
        usual = self._steps[(now + np.arange(len(taken))) % self._count]
        if (np.abs(taken - usual) <= STEADY * self._steps.min()).all():
            turns = (np.concatenate([turn, now + 1 + np.arange(len(taken))]) % self._count).astype(np.int64)
        else:
            for step in taken.tolist():
                now = self._after(now, step)
                turn.append(now)
            turns = np.array(turn, np.int64)
        self._last = float(time[-1]), int(turns[-1])
        return turns

    def _after(self, turn: int, step: float) -> int:
        """Return the index of the sensor whose row comes a time `step` after a row of sensor number `turn`.

        Rows of other sensors may be missing between these two rows.
        """
        assert self._steps is not None
        around = float(self._steps.sum())
        if not np.isfinite(step) or around <= 0:
            return (turn + 1) % self._count
        ahead = np.cumsum(self._steps[(turn + np.arange(self._count)) % self._count])
        off = (step - ahead) / around
        k = int(np.argmin(np.abs(off - np.maximum(np.rint(off), 0.0))))
        return (turn + 1 + k) % self._count


def _some(numbers: Ints, values: Floats, ordinal: Ints, begins: bool) -> list[Rows]:
    return [Rows(numbers, np.ascontiguousarray(values), ordinal, begins)] if len(numbers) else []
