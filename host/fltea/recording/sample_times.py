"""States how the rate, lost samples, and the beginnings of runs follow from the times of samples.

Times come from two kinds of clock. Times in columns of text or of tables, and the time stamps of a driver,
come from the **sensor's own clock**. The time stamps of messages in a bag come from a **computer's clock**,
and are late whenever the computer was busy. The rules for a sensor's own clock are the same for live text,
text files, tables and Linux IIO:

- **Unit.** The user gives it, or the column's name or a row of units states it. Otherwise the unit is taken
  to be seconds if this gives a sampling rate that is usual for gyroscopes (5 Hz to 10 kHz). If a stated unit
  gives a rate below 2 Hz or above 50 kHz, the unit is not accepted, and the user is asked for the rate
  (`timing`).
- **Rate.** The sampling period is the mean of all steps between times that are within a fifth of the median
  step. A file is examined as a whole; of live text, the first 2 s decide. Times may be rounded to a large
  part of the period, so that steps are alternately 2 and 3 ms at 400 Hz. Then the rate follows from the
  duration of long stretches with equal numbers of samples. Only the stretches of shortest duration are used,
  since they contain no lost sample (`clocks`).
- **Even steps.** Nine steps in ten have to be near the median step, or near two, three or four times this
  step. Otherwise the times do not come from a sensor's clock: they are times of arrival at a computer. Bursts
  of rows with long pauses between them are a sign of times of arrival, too. Times of arrival are refused, and
  the user is asked for the rate.
- **Lost samples.** A step of n periods counts as n - 1 lost samples. A remainder that is no whole period is
  carried to the next step, so that rounded times cause no gaps.
- **A long step**, of more than a minute and more than ten periods, begins a new run and does not count as a
  loss, since it is unknown whether the sensor was running.
- **A step backwards** begins a new run, except when a 32-bit counter (`millis()`, `micros()`) wraps or a
  clock restarts at 0 s at midnight.
- **A step of an hour**, forwards or backwards, occurs at a change to or from daylight saving time. Like any
  step of this size, it begins a new run. The user is told the likely cause.
- **Times of day without colons** (hhmmss) are read as numbers. The step from 95959.99 to 100000.00 is then
  0.01 s, not a gap of an hour.
- **A repeated time** means a repeated sample, which is left out and counted. If two rows with the same time
  hold different values, the clock is too coarse, and the second row counts as an uneven step.
- **A rate that the user gives** has priority. The sample numbers still follow from the times and their own
  period. If the times are uneven, the rows are numbered in their order instead, and the user is warned.

`message_stamps` has the rules for a computer's clock. Messages are numbered in order of arrival. A sample
counts as lost only where the stamps are late and stay late. A new run begins where the clock was set.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fltea.settings.how import TimeUnit

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Marks = NDArray[np.bool_]

SECONDS: dict[TimeUnit, float] = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}

EVENNESS, EVEN_SHARE = 0.2, 0.9
"""Times are taken as those of a sensor's clock if nine tenths of their steps are even. A step from one time
to the next is even if it differs by less than a fifth from the median step.
"""

PLAUSIBLE_HZ = 5.0, 10_000.0
"""Usual sampling rates of gyroscopes.

A column of times without a unit is taken as seconds only if the resulting rate is in this range [Hz].
"""

LONGEST_S = 4e9
"""Longest accepted time [s]. This is 126 years; nanoseconds in 64 bits allow not much more."""

COUNTER_WRAP, DAY_S = float(1 << 32), 86_400.0
"""Values at which times restart at 0. 32-bit counters (millis() and micros()) restart after 2^32 counts, and
times of day in seconds after a day.
"""

LONGEST_GAP_S, LONGEST_GAP_PERIODS = 60.0, 10.0

HOUR_S = 3600.0
MINUTE_TURNS_S, NEAR_TURN_S = 39.0, 1.0
"""Limits for times of day written as hhmmss [s]. Read as numbers, such times jump at the end of each minute:
095959 (9:59:59) is followed by 100000 (10:00:00), a step of 4041, although 1 s has passed. A step is taken
for such a jump only if it is more than MINUTE_TURNS_S, the time before it is at most NEAR_TURN_S before the
end of the minute, and the time after it less than NEAR_TURN_S after this end.
"""

SAME_TIME = 4 * float(np.finfo(np.float64).eps)
"""Two times count as equal if their relative difference is at most this."""

SAME_RATE = 0.1
"""The user's sampling rate and the measured rate count as equal if their relative difference is at most this.
"""


class LocalTime:
    """Finds steps that only a clock of local time makes. `unit_s`: length of the unit of the times [s].

    `of_day`: number of steps across the end of a minute in times of day written as hhmmss. `hours`: number of
    steps of one hour (to within a second), forwards or backwards.
    """

    def __init__(self, unit_s: float) -> None:
        self.of_day = self.hours = 0
        self._unit_s = unit_s

    def minutes(self, time: Floats, steps: Floats) -> Floats | None:
        """Return what to add to each step so that it is right in seconds, for times written as hhmmss (n,).

        Only steps across the end of a minute need a correction: the step from 95959 to 100000 is 4041, but
        one second has passed. Return None if there are no such steps.
        """
        turns = np.flatnonzero(np.abs(steps) * self._unit_s > MINUTE_TURNS_S)
        if not len(turns):
            return None
        off_s = np.abs(np.abs(steps[turns]) * self._unit_s - HOUR_S)
        self.hours += int((off_s < NEAR_TURN_S).sum())
        after_s, before_s = time[turns] * self._unit_s, (time[turns] - steps[turns]) * self._unit_s
        # NaN where the number before or after the step is no time of day
        real_s = (_of_day(after_s) - _of_day(before_s)) % DAY_S
        ends = (before_s % 100 >= 60 - NEAR_TURN_S) & (after_s % 100 < NEAR_TURN_S)
        is_turn = ends & (real_s > 0) & (real_s < 2 * NEAR_TURN_S)
        self.of_day += int(is_turn.sum())
        jump = np.zeros(len(time))
        jump[turns[is_turn]] = real_s[is_turn] / self._unit_s - steps[turns[is_turn]]
        return jump if is_turn.any() else None


class _Restarts(NamedTuple):
    """Where times restart at 0. All fields are in the unit of the times.

    `wrap`: value at which the times restart. `longest`: a longer step begins a new run. `second`: one second
    in this unit; 0 if the unit is s. A column in ms, µs or ns may hold only the fractions of seconds.
    """

    wrap: float
    longest: float
    second: float

    def at(self, latest: float) -> tuple[float, float]:
        """Return the value at which times restart at 0, and the longest step within a run.

        `latest`: largest time so far. If it is below 1 s, the times are taken for fractions of seconds, which
        restart after 1 s.
        """
        if self.second and latest < self.second:
            return self.second, self.second / 2
        return self.wrap, self.longest


# Why more than 12 attributes: most of them are counts of what the messages report.
class Elapsed:
    """Converts the times of rows to the time since the first row, in the same unit.

    Converted times never decrease.

    `rows`: number of rows. `repeated`: number of rows with the same time as the previous row. `odd`: number
    of steps that no sensor's clock makes: steps backwards, and repeated times in rows with different values.
    `backwards`: number of steps backwards. `seconds`: number of times that restarted at a full second, as the
    fractions of seconds do. `first`: number of the first row whose time is not later than the
    time of the row before, or None. `local`: finds the steps that only a clock of local time makes.
    `longest`: a longer step than this begins a new run (in the unit of the times; infinite if this unit is
    unknown).
    `unit_s`: length of the unit of the times [s].
    """

    def __init__(self, unit: TimeUnit | None) -> None:
        self.repeated = self.odd = self.backwards = self.seconds = self.rows = 0
        self.first: int | None = None
        self.unit_s = SECONDS[unit or "s"]
        self.local = LocalTime(self.unit_s)
        wrap = {"ms": COUNTER_WRAP, "us": COUNTER_WRAP, "ns": math.inf}.get(unit or "s", DAY_S)
        second = 1 / SECONDS[unit] if unit in ("ms", "us", "ns") else 0.0
        self._restarts = _Restarts(wrap, LONGEST_GAP_S / self.unit_s, second)
        self.longest = math.inf if unit is None else self._restarts.longest
        self._offset = 0.0
        self._last: tuple[float, float, Floats] | None = None
        self._between = math.inf, -math.inf

    @property
    def between(self) -> float:
        """Difference between the largest and the smallest time in the column, in the unit of the times."""
        return self._between[1] - self._between[0]

    @property
    def span(self) -> float:
        """Converted time of the last row, which is the time since the first row."""
        return 0.0 if self._last is None else self._last[1]

    def add(self, time: Floats, values: Floats, numbers: Ints | None = None) -> tuple[Floats, Marks]:
        """Return the times of the next rows since the first row (n,), and marks: True where a new run begins.

        `values`: the other numbers in the rows (n, columns). They show whether a row only repeats the row
        before it, or has another sample at the same time. `numbers`: numbers of the rows in the file, for
        messages.
        """
        is_first = self._last is None
        last_time, last_elapsed, last_values = self._last or (float(time[0]), 0.0, values[0])
        if is_first:
            self._offset = -last_time
        steps = differences(time, last_time)
        begins = steps < 0
        jump = self.local.minutes(time, steps)
        offset: float | Floats = self._offset
        if jump is not None or begins.any():
            jump = np.zeros(len(time)) if jump is None else jump
            begins &= jump == 0
            wrap, longest = self._restarts.at(max(self._between[1], float(time.max())))
            after = steps + wrap
            wraps = begins & (after <= longest) & (time >= 0) & (time < after)
            begins &= ~wraps
            jump[wraps] = wrap
            self.seconds += int(wraps.sum()) if wrap == self._restarts.second else 0
            jump[begins] = -steps[begins]
            offset = self._offset + np.cumsum(jump)
            self._offset = float(offset[-1])
            self.backwards += int(begins.sum())
            self.odd += int(begins.sum())
        elapsed = time + offset
        # Two times count as equal if they differ only by the rounding of a float.
        flat = (differences(elapsed, last_elapsed) <= SAME_TIME * np.abs(time)) & ~begins
        flat[0] &= not is_first
        if flat.any():
            before = np.concatenate([last_values[np.newaxis], values[:-1]])
            self.repeated += int(flat.sum())
            self.odd += int((flat & (values != before).any(axis=1)).sum())
        self.rows += len(time)
        self._between = min(self._between[0], float(time.min())), max(self._between[1], float(time.max()))
        if self.first is None and numbers is not None and (flat.any() or begins.any()):
            self.first = int(numbers[int(np.argmax(flat | begins))])
        self._last = float(time[-1]), float(elapsed[-1]), values[-1]
        return elapsed, begins


def _of_day(times: Floats) -> Floats:
    """Return seconds since midnight for times of day written as hhmmss; NaN for other numbers."""
    hours, minutes, seconds = times // 10_000, times // 100 % 100, times % 100
    is_one = (times >= 0) & (hours < 24) & (minutes < 60) & (seconds < 60)
    return np.where(is_one, 3600 * hours + 60 * minutes + seconds, math.nan)


def differences(values: Floats, before: float) -> Floats:
    """Return the differences between successive values. The first one is from `before` to the first value.

    If there are few values, this function is faster than `np.diff` with `prepend`.
    """
    found = np.empty(len(values))
    found[0] = values[0] - before
    np.subtract(values[1:], values[:-1], out=found[1:])
    return found


class ClockColumns(NamedTuple):
    """The columns that say the time of each row.

    `time`: column of times, None if there is none; `unit`: unit of the times, None if unknown; `factor`: the
    numbers in the column are multiplied by this to be in that unit. `fine`: column with fractions that are
    added to whole seconds; `fine_s`: unit of this column [s]. `coarse`: columns of minutes and of hours that
    are added to them, each with its unit [s].
    """

    time: int | None = None
    unit: TimeUnit | None = None
    factor: float = 1.0
    fine: int | None = None
    fine_s: float = 0.0
    coarse: tuple[tuple[int, float], ...] = ()


class TimeColumn(NamedTuple):
    """A column of times. `unit`: unit of the times, None if unknown.

    `ticks`: how many of this unit a 1 in the column means (0.1 if the column counts tenths of it).

    `rate_hz`: sampling rate that the user or the file states; `is_given`: whether the user states it.
    `overrule`: whether the user's rate is used even if the times contradict it.
    `is_of_one`: whether the user says which sensor's rows these are, or that all are of one.
    """

    name: str
    unit: TimeUnit | None
    rate_hz: float | None = None
    is_given: bool = False
    overrule: bool = False
    ticks: float = 1.0
    is_of_one: bool = False


def between(times: Floats, period: float) -> Marks:
    """Mark surplus rows: a row is surplus if the rows before and after it are only one period apart.

    `times`: elapsed times (n,) in the unit of `period`. Rows that repeat a time are not marked. Two
    neighbouring rows may both seem surplus. Then the one is marked whose time is farther from when a sample
    is due, which is one period after the row before both.
    """
    marks = np.zeros(len(times), np.bool_)
    places = np.flatnonzero(np.diff(times, prepend=-math.inf) > 0)
    if len(places) < 3:
        return marks
    times = times[places]
    steps = np.diff(times) / period
    if (steps > 1 - EVENNESS).all():
        return marks
    found = np.zeros(len(times), np.bool_)
    two = steps[:-1] + steps[1:]
    found[1:-1] = (np.abs(two - 1) <= EVENNESS) & (np.minimum(steps[:-1], steps[1:]) < 1 - EVENNESS)
    for k in np.flatnonzero(found[:-1] & found[1:]).tolist():
        if found[k] and found[k + 1]:
            due = times[k - 1] + period
            found[k if abs(times[k] - due) < abs(times[k + 1] - due) else k + 1] = False
    marks[places] = found
    return marks
