"""What the times of samples say: their rate, which samples are missing, and where a new run begins (pure).

Two kinds of clock are told apart. Columns of text, tables and the time stamps of a driver are those of the
**sensor's own clock**. The stamps of messages in a bag are a **computer's**: late by as much as it was busy.
These are the rules for the first kind, the same for live text, text files, tables and Linux IIO:

- **Unit.** It is the one that the user gives, or that the column's name or line of units states. Without
  either it is seconds, if the rate is then one at which gyroscopes are recorded (5 Hz to 10 kHz). A stated
  one that gives less than 2 Hz or more than 50 kHz is not believed, and the rate is asked for (`timing`).
- **Rate.** It is the mean of the steps that are within a fifth of the median. A file is taken as a whole;
  live, the first 2 s decide. Of times that are rounded to a good part of the period (2 and 3 ms in turns are
  400 Hz) long stretches tell it, and those that are shortest lack no sample (`clocks`).
- **Even.** Nine steps in ten have to be near the median, or be two, three or four times as long. Otherwise
  these are times of arrival and not a clock's, as are those of rows in bursts, a few at once and then a long
  time none: they are refused, and the rate is asked for.
- **Missing samples.** A step of n periods counts n - 1 samples as missing. What is left over is carried on to
  the next step, so that rounded times make no gaps.
- **A long step**, of more than a minute and of more than ten periods, begins a new run: whether the sensor
  went on meanwhile cannot be known, and nothing is counted as missing.
- **A step backwards** begins a new run. A counter of 32 bits (`millis()`, `micros()`) that wraps is no step
  backwards, and neither is a clock that goes on from 0 s at midnight.
- **A step of an hour**, forwards or back, is what a clock of local time has in a night of daylight saving. It
  begins a new run like any other of that size, and the user is told what it may be.
- **Times of day without colons**: from 95959.99 to 100000.00 (hhmmss) is 0.01 s, and no gap of an hour.
- **A repeated time** is the same sample again: it is left out and counted. Where the values differ it counts
  as an uneven step, for the clock is then coarser than the samples.
- **A given rate** wins. The times still number the samples, by their own period. Times that are uneven do
  not: then the order of the rows numbers them, and the user is warned.

`message_stamps` has those for the second kind: messages are numbered in the order in which they came, a
sample is missing only where the stamps are late and stay late, and a new run begins where the clock was set.
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
"""Times are a clock's if nine steps in ten are within a fifth of the median."""

PLAUSIBLE_HZ = 5.0, 10_000.0
"""Rates at which a gyroscope is recorded. A column without a unit that gives another is not in seconds."""

LONGEST_S = 4e9
"""126 years; so many nanoseconds fit into 64 bits."""

COUNTER_WRAP, DAY_S = float(1 << 32), 86_400.0
"""Of millis() and micros(), which are what boards send as times in ms and in us; and of times of day."""

LONGEST_GAP_S, LONGEST_GAP_PERIODS = 60.0, 10.0

HOUR_S = 3600.0
MINUTE_TURNS_S, NEAR_TURN_S = 39.0, 1.0
"""Times of day as hhmmss jump by more than the first at each minute, within the second of its 60th second."""

SAME_TIME = 4 * float(np.finfo(np.float64).eps)
"""Of a time: what two that are the same may differ by."""

SAME_RATE = 0.1
"""A given rate and one by the times that differ by less are the same."""


class Elapsed:
    """Times of rows as the time since the first row, in the same unit; it never runs back.

    repeated: rows with the time of the row before them. odd: steps that are no clock's, backwards or with a
    repeated time and other values; backwards: of them the first kind. rows: how many there were. first: the
    number of the first row that repeats a time or runs backwards, None without one. of_day: minutes that
    began in times of day as hhmmss. hours: steps of an hour, within a second, either way. longest: a longer
    step begins a new run, infinite without a known unit. unit_s: seconds in one of the unit.
    """

    def __init__(self, unit: TimeUnit | None) -> None:
        self.repeated = self.odd = self.backwards = self.rows = self.of_day = self.hours = 0
        self.first: int | None = None
        self._wrap = {"ms": COUNTER_WRAP, "us": COUNTER_WRAP, "ns": math.inf}.get(unit or "s", DAY_S)
        self.unit_s = SECONDS[unit or "s"]
        self._longest = LONGEST_GAP_S / self.unit_s
        self.longest = math.inf if unit is None else self._longest
        self._second = 1 / SECONDS[unit] if unit in ("ms", "us", "ns") else 0.0
        self._offset = 0.0
        self._last: tuple[float, float, Floats] | None = None
        self._between = math.inf, -math.inf

    @property
    def between(self) -> float:
        """From the earliest time to the latest, in whatever order they stand."""
        return self._between[1] - self._between[0]

    @property
    def span(self) -> float:
        """From the first row to the last."""
        return 0.0 if self._last is None else self._last[1]

    def add(self, time: Floats, values: Floats, numbers: Ints | None = None) -> tuple[Floats, Marks]:
        """Take the next rows, (n,) and (n, columns); elapsed times, and marks where a new run begins.

        numbers: of the rows, for messages.
        """
        is_first = self._last is None
        last_time, last_elapsed, last_values = self._last or (float(time[0]), 0.0, values[0])
        if is_first:
            self._offset = -last_time
        steps = differences(time, last_time)
        begins = steps < 0
        jump = self._minutes(time, steps)
        offset: float | Floats = self._offset
        if jump is not None or begins.any():
            jump = np.zeros(len(time)) if jump is None else jump
            begins &= jump == 0
            wrap, longest = self._wrap_of(time)
            after = steps + wrap
            wraps = begins & (after <= longest) & (time >= 0) & (time < after)
            begins &= ~wraps
            jump[wraps] = wrap
            jump[begins] = -steps[begins]
            offset = self._offset + np.cumsum(jump)
            self._offset = float(offset[-1])
            self.backwards += int(begins.sum())
            self.odd += int(begins.sum())
        elapsed = time + offset
        # Times that differ by the rounding of a float only are the same.
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

    def _minutes(self, time: Floats, steps: Floats) -> Floats | None:
        """What is to be added where times of day as hhmmss go on to a minute; None if they do so nowhere."""
        turns = np.flatnonzero(np.abs(steps) * self.unit_s > MINUTE_TURNS_S)
        if not len(turns):
            return None
        off_s = np.abs(np.abs(steps[turns]) * self.unit_s - HOUR_S)
        self.hours += int((off_s < NEAR_TURN_S).sum())
        after_s, before_s = time[turns] * self.unit_s, (time[turns] - steps[turns]) * self.unit_s
        real_s = (_of_day(after_s) - _of_day(before_s)) % DAY_S  # NaN where one is no time of day
        ends = (before_s % 100 >= 60 - NEAR_TURN_S) & (after_s % 100 < NEAR_TURN_S)
        is_turn = ends & (real_s > 0) & (real_s < 2 * NEAR_TURN_S)
        self.of_day += int(is_turn.sum())
        jump = np.zeros(len(time))
        jump[turns[is_turn]] = real_s[is_turn] / self.unit_s - steps[turns[is_turn]]
        return jump if is_turn.any() else None

    def _wrap_of(self, time: Floats) -> tuple[float, float]:
        """Where the times begin again at 0, and the longest step there: parts of seconds do each second."""
        if self._second and max(self._between[1], float(time.max())) < self._second:
            return self._second, self._second / 2
        return self._wrap, self._longest


def _of_day(times: Floats) -> Floats:
    """The seconds of a day at times as hhmmss, NaN where one is none."""
    hours, minutes, seconds = times // 10_000, times // 100 % 100, times % 100
    is_one = (times >= 0) & (hours < 24) & (minutes < 60) & (seconds < 60)
    return np.where(is_one, 3600 * hours + 60 * minutes + seconds, math.nan)


def differences(values: Floats, before: float) -> Floats:
    """From one value to the next; of a few values quicker than `np.diff` with `prepend`."""
    found = np.empty(len(values))
    found[0] = values[0] - before
    np.subtract(values[1:], values[:-1], out=found[1:])
    return found


class TimeColumn(NamedTuple):
    """A column of times. unit: None if nothing says it. ticks: of that unit, which were counted.

    rate_hz: of the rows, where the user gives it or the file states it; is_given: by the user. overrule: that
    counts, whatever the times say.
    """

    name: str
    unit: TimeUnit | None
    rate_hz: float | None = None
    is_given: bool = False
    overrule: bool = False
    ticks: float = 1.0


def between(times: Floats, period: float) -> Marks:
    """Mark rows that stand between two samples of an even clock: their neighbours are one period apart.

    times: (n,) elapsed, in the unit of `period`; the same time again is passed over. Of two neighbours that
    could both be so, the one that is farther from where the next sample is due stands between.
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
