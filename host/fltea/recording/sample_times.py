"""What the times of samples say: their rate, which samples are missing, and where a new run begins (pure).

Two kinds of clock are told apart. Columns of text, tables and the time stamps of a driver are those of the
**sensor's own clock**. The stamps of messages in a bag are a **computer's**: late by as much as it was busy.
These are the rules for the first kind, the same for live text, text files, tables and Linux IIO:

- **Unit.** It is the one that the user gives, or that the column's name or line of units states. Without
  either it is seconds, if the rate is then one at which gyroscopes are recorded (5 Hz to 10 kHz).
- **Rate.** It is the mean of the steps that are near the median. Near is within a fifth of it, or of times
  that are rounded within one grain (2 and 3 ms in turns are 400 Hz). A file is taken as a whole; live, the
  first 2 s decide.
- **Even.** Nine steps in ten have to be near the median, or be two, three or four times as long. Otherwise
  these are times of arrival and not a clock's, and they are refused: only a given rate can help.
- **Missing samples.** A step of n periods counts n - 1 samples as missing. What is left over is carried on to
  the next step, so that rounded times make no gaps.
- **A long step**, of more than a minute and of more than ten periods, begins a new run: whether the sensor
  went on meanwhile cannot be known, and nothing is counted as missing.
- **A step backwards** begins a new run. A counter of 32 bits (`millis()`, `micros()`) that wraps is no step
  backwards, and neither is a clock that goes on from 0 s at midnight.
- **A repeated time** is the same sample again: it is left out and counted. Where the values differ it counts
  as an uneven step, for the clock is then coarser than the samples.
- **A given rate** wins. The times still number the samples, by their own period. Times that are uneven do
  not: then the order of the rows numbers them, and the user is warned.

`message_stamps` has those for the second kind: messages are numbered in the order in which they came, a
sample is missing only where the stamps are late and stay late, and a new run begins where the clock was set.
"""

import math
from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fltea.recording.reading import Answer, Missing, not_stated
from fltea.records.errors import UsageError
from fltea.settings.how import TimeUnit

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Marks = NDArray[np.bool_]

SECONDS: dict[TimeUnit, float] = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}

EVENNESS, EVEN_SHARE = 0.2, 0.9
"""Times are a clock's if nine steps in ten are within a fifth of the median."""

PLAUSIBLE_HZ = 5.0, 10_000.0
"""Rates at which a gyroscope is recorded. A column without a unit that gives another is not in seconds."""

SHORTEST_STEP_S, LONGEST_S = 2e-5, 4e9
"""No gyroscope gives more than some 32,000 samples a second. The second is
126 years; so many nanoseconds fit into 64 bits."""

COUNTER_WRAP, DAY_S = float(1 << 32), 86_400.0
"""Of millis() and micros(), which are what boards send as times in ms and in us; and of times of day."""

LONGEST_GAP_S, LONGEST_GAP_PERIODS = 60.0, 10.0

GRAINS = (1.0, 0.1, 1e-2, 1e-3, 1e-4)
"""Of rounded times, in their own unit."""

SHORT_GAPS = 2, 3, 4
"""Steps of so many periods are a clock's, too, however many there are. Bursts leave longer ones."""

MOST_IN_TURNS = 4
"""Rows with the same time that may be of as many sensors."""

MANY_STEPS = 32
"""Over which rounded times are compared."""

NEARLY = 1e-3
"""Of a grain: times are on it."""

SAME_TIME = 4 * float(np.finfo(np.float64).eps)
"""Of a time: what two that are the same may differ by."""

SAME_RATE = 0.1
"""A given rate and one by the times that differ by less are the same."""

LIKE_MEAN = 1.5
"""A given rate and the mean of uneven times are not the same if they differ by more than this factor."""


class Elapsed:
    """Times of rows as the time since the first row, in the same unit; it never runs back.

    repeated: rows with the time of the row before them. odd: steps that are no clock's, backwards or with a
    repeated time and other values; backwards: of them the first kind. rows: how many there were. first: the
    number of the first row that repeats a time or runs backwards, None without one.
    """

    def __init__(self, unit: TimeUnit | None) -> None:
        self.repeated = self.odd = self.backwards = self.rows = 0
        self.first: int | None = None
        self._wrap = {"ms": COUNTER_WRAP, "us": COUNTER_WRAP, "ns": math.inf}.get(unit or "s", DAY_S)
        self._longest = LONGEST_GAP_S / SECONDS[unit or "s"]
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
        offset: float | Floats = self._offset
        if begins.any():
            jump = np.where(begins, -steps, 0.0)
            wrap, longest = self._wrap_of(time)
            after = steps + wrap
            wraps = begins & (after <= longest) & (time >= 0) & (time < after)
            jump[wraps] = wrap
            begins &= ~wraps
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

    def _wrap_of(self, time: Floats) -> tuple[float, float]:
        """Where the times begin again at 0, and the longest step there: parts of a second do so each second."""
        if self._second and max(self._between[1], float(time.max())) < self._second:
            return self._second, self._second / 2
        return self._wrap, self._longest


def differences(values: Floats, before: float) -> Floats:
    """From one value to the next; of a few values quicker than `np.diff` with `prepend`."""
    found = np.empty(len(values))
    found[0] = values[0] - before
    np.subtract(values[1:], values[:-1], out=found[1:])
    return found


class Clock(NamedTuple):
    """What steps say, in the column's unit. typical: the mean without gaps. even: they are a clock's."""

    typical: float
    median: float
    least: float
    largest: float
    even: bool


def clock_of(blocks: Callable[[], Iterable[Floats]], odd: int = 0) -> Clock | None:
    """Look at elapsed times, a block at a time; None if there is no step.

    blocks: gives them again each time it is called. odd: steps besides that are no clock's.
    """
    medians, least, largest = [], math.inf, 0.0
    for steps in _steps(blocks()):
        medians.append(float(np.median(steps)))
        least, largest = min(least, float(steps.min())), max(largest, float(steps.max()))
    if not medians:
        return None
    median = float(np.median(medians))
    single, share, typical = _even_share(blocks(), median, EVENNESS * median, odd)
    if single < EVEN_SHARE:
        grain = _grain(blocks)
        is_coarse = EVENNESS * median < grain < median * (1 + NEARLY)
        if is_coarse and (share < EVEN_SHARE or _is_rounded(blocks(), grain)):
            _, share, typical = _even_share(blocks(), median, grain * (1 + NEARLY), odd)
    return Clock(typical, median, least, largest, share >= EVEN_SHARE and typical > 0)


def _steps(blocks: Iterable[Floats]) -> Iterator[Floats]:
    last: list[float] = []
    for times in blocks:
        steps = np.diff(times, prepend=last)
        last = [float(times[-1])]
        steps = steps[steps > 0]
        if len(steps):
            yield steps


def _even_share(
    blocks: Iterable[Floats], median: float, tolerance: float, odd: int
) -> tuple[float, float, float]:
    """The shares of steps near the median, and with those near a multiple, as short gaps are.

    The third is the mean of the steps near the median.
    """
    count, near, gaps, total = odd, 0, 0, 0.0
    for steps in _steps(blocks):
        single = steps[np.abs(steps - median) <= tolerance]
        count, near, total = count + len(steps), near + len(single), total + float(single.sum())
        for times in SHORT_GAPS if tolerance < median / 2 else ():
            gaps += int((np.abs(steps - times * median) <= tolerance).sum())
    return near / count, (near + gaps) / count, total / near if near else 0.0


def _is_rounded(blocks: Iterable[Floats], grain: float) -> bool:
    """Whether steps of 1 and 2 ms are those of 800 Hz in whole ms, and not those of 1000 Hz with losses.

    Then stretches of as many steps are alike, to the grain; of lost samples some have more than others.
    """
    count = near = 0
    for times in blocks:
        steps = min(MANY_STEPS, max(2, len(times) // 4))
        long = np.diff(times[::steps])
        count += len(long)
        near += int((np.abs(long - np.median(long)) <= grain * (1 + NEARLY)).sum()) if len(long) else 0
    return near >= EVEN_SHARE * max(count, 1)


def _grain(blocks: Callable[[], Iterable[Floats]]) -> float:
    """The coarsest grain on which all times are; infinite if there is none."""
    for grain in GRAINS:
        if all(bool((np.abs(t / grain - np.rint(t / grain)) < NEARLY).all()) for t in blocks()):
            return grain
    return math.inf


class Timing(NamedTuple):
    """How rows are numbered and timed.

    period: in the column's unit; None: the order of the rows numbers them. unit_s: seconds in one of that
    unit. warning: what the user has to know, "" if that is nothing. answers: on the clock.
    """

    rate_hz: float
    period: float | None
    unit_s: float = 1.0
    warning: str = ""
    answers: tuple[Answer, ...] = ()


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


def timing(
    where: str,
    column: TimeColumn,
    clock: Clock | None,
    elapsed: Elapsed,
    place: Callable[[int], str] = str,
) -> Timing:
    """The rate of rows, and how they are numbered.

    where: for messages. elapsed: what the clock was found of. place: a row, for messages.

    Raises:
        UsageError: no rate is given, and the times tell none, or another one than is given or stated.
    """
    name, unit = column.name, column.unit
    where_column = f"{where}: column '{name}'"
    if column.is_given and column.rate_hz is not None:
        return _with_rate(where_column, column, clock, elapsed, column.rate_hz)
    if clock is None:
        raise not_stated(where, [Missing(f"the rate; one time in '{name}' tells none", "--rate ?")])
    unit_s = SECONDS[unit or "s"]
    if unit is None and clock.even and not _is_plausible(1 / clock.typical):
        raise _unit_needed(where_column, clock.typical)
    if clock.even and clock.typical * unit_s < SHORTEST_STEP_S:
        raise UsageError(
            f"{where_column}: a step of {clock.typical:.3g} {unit or 's'} is no gyroscope's. Is "
            "the unit right (--time-unit)?"
        )
    if not clock.even:
        raise _uneven(where, where_column, unit, clock, elapsed, place)
    rate_hz = 1.0 / (clock.typical * unit_s)
    if column.rate_hz is not None and abs(rate_hz / column.rate_hz - 1) > SAME_RATE and not column.overrule:
        raise UsageError(
            f"{where_column}: by its times the rate is {rate_hz:.6g} Hz, and the file states "
            f"{column.rate_hz:g} Hz. Say which is right: --rate ? --overrule."
        )
    return Timing(rate_hz, clock.typical, unit_s, answers=(_clock_answer(column, rate_hz),))


def _clock_answer(column: TimeColumn, rate_hz: float) -> Answer:
    ticks = f"{column.ticks:g} " if column.ticks != 1.0 else ""
    unit = f" in {ticks}{column.unit}" if column.unit else ", which can only be seconds"
    return Answer("clock", f"{rate_hz:.6g} Hz", "measured", f"the times of {column.name}{unit}")


def _uneven(
    where: str,
    where_column: str,
    unit: TimeUnit | None,
    clock: Clock,
    elapsed: Elapsed,
    place: Callable[[int], str],
) -> UsageError:
    """What is wrong with times that are no sensor's clock, and what to do."""
    shown = unit or "s"
    is_coarse = _is_coarse(elapsed)
    rate_hz = _mean_hz(clock, elapsed, SECONDS[shown])
    first = "" if elapsed.first is None else place(elapsed.first).removeprefix(where).strip(": ")
    at = f", the first in {f'line {first}' if first.isdigit() else first}" if first else ""
    mean = (
        f"The mean of these times is {rate_hz:.4g} Hz" if unit is not None or _is_plausible(rate_hz) else ""
    )
    remedy = f"{mean or 'They tell no rate'}; if every row is a sample of one sensor: --rate "
    remedy += f"{rate_hz:.4g} (the times then tell no gaps)." if mean else "?"
    turns = elapsed.rows / max(elapsed.rows - elapsed.repeated, 1)
    if elapsed.backwards > (1 - EVEN_SHARE) * elapsed.rows:
        rate_hz = (elapsed.rows - 1) / max(elapsed.between * SECONDS[shown], SHORTEST_STEP_S)
        return UsageError(
            f"{where_column}: {elapsed.backwards} of {elapsed.rows} times are earlier than the one before{at}. If "
            f"the rows stand in the order in which they were measured, give their rate: --rate {rate_hz:.4g}. "
            "Otherwise sort them by their times."
        )
    if is_coarse and MOST_IN_TURNS >= round(turns) >= 2 and abs(turns - round(turns)) < 0.01:
        n = round(turns)
        return not_stated(
            where,
            [Missing(f"whether {n} sensors take turns, or the clock is coarser than the samples", "?")],
            (),
            f"Each time in '{where_column.rpartition(' ')[2].strip(chr(39))}' stands {n} times{at}:\n"
            f"  --sensor 1/{n}: the first of {n} sensors in turns, --sensor 2/{n} the second …\n"
            f"  --rate {rate_hz:.4g}: one sensor, whose clock is coarser than its samples",
        )
    if is_coarse:
        return UsageError(
            f"{where_column}: {elapsed.repeated} of {elapsed.rows} times are the same as the one before{at}: the "
            f"clock is coarser than the samples, with steps of {clock.median:.3g} {shown}. {remedy}"
        )
    return UsageError(
        f"{where_column}: the steps are too uneven for a sensor's clock (median {clock.median:.3g} {shown}, from "
        f"{clock.least:.3g} to {clock.largest:.3g} {shown}{at}), as times of arrival are. {remedy}"
    )


def _is_coarse(elapsed: Elapsed) -> bool:
    return elapsed.repeated > (1 - EVEN_SHARE) * elapsed.rows


def _mean_hz(clock: Clock, elapsed: Elapsed, unit_s: float) -> float:
    """Return the rate by the first time and the last."""
    steps, span = (elapsed.rows, clock.median) if _is_coarse(elapsed) else (elapsed.rows - 1, 0.0)
    return steps / (elapsed.span + span) / unit_s if elapsed.span > 0 else math.nan


def _is_plausible(rate_hz: float) -> bool:
    return PLAUSIBLE_HZ[0] <= rate_hz <= PLAUSIBLE_HZ[1]


def _unit_needed(where_column: str, step: float) -> UsageError:
    rates = {unit: 1 / (step * unit_s) for unit, unit_s in SECONDS.items()}
    likely = [f"  --time-unit {unit}: {rate:.6g} Hz" for unit, rate in rates.items() if _is_plausible(rate)]
    table = [f"A step of {step:.6g} would be:", *likely, "  or in ticks of its own: --rate ?"]
    return not_stated(where_column, [Missing("what its times count", "--time-unit ?")], (), "\n".join(table))


def _with_rate(
    where_column: str, column: TimeColumn, clock: Clock | None, elapsed: Elapsed, rate_hz: float
) -> Timing:
    unit = column.unit
    if clock is None:
        return Timing(rate_hz, None)
    if not clock.even:
        mean_hz = math.nan if unit is None else _mean_hz(clock, elapsed, SECONDS[unit])
        is_slower = mean_hz > LIKE_MEAN * rate_hz  # than there are rows; it is faster where samples are lost
        is_faster = _is_coarse(elapsed) and LIKE_MEAN * mean_hz < rate_hz
        if (is_slower or is_faster) and not column.overrule:
            raise _other_rate(where_column, mean_hz, rate_hz)
        return Timing(
            rate_hz,
            None,
            warning=f"{where_column} has steps too uneven for a clock, so it cannot tell which samples are "
            f"missing: with --rate {rate_hz:g} all rows count as evenly spaced.",
        )
    found = [1 / (clock.typical * SECONDS[u]) for u in ([unit] if unit else SECONDS)]
    nearest = min(found, key=lambda rate: abs(math.log(rate / rate_hz)))
    if abs(nearest / rate_hz - 1) <= SAME_RATE:
        return Timing(rate_hz, clock.typical)
    in_seconds_hz = 1 / clock.typical
    if (unit is not None or _is_plausible(in_seconds_hz)) and not column.overrule:
        raise _other_rate(where_column, nearest if unit is not None else in_seconds_hz, rate_hz)
    warning = (
        f"{where_column}: its unit is not known; with --rate {rate_hz:g} a step of {clock.typical:.6g} is one "
        "sample, and the column tells only which are missing."
    )
    return Timing(rate_hz, clock.typical, warning=warning)


def _other_rate(where_column: str, found_hz: float, rate_hz: float) -> UsageError:
    return UsageError(
        f"{where_column}: by its times the rate is {found_hz:.6g} Hz, and --rate {rate_hz:g} says otherwise. "
        "Leave --rate out. If the times are wrong, add --overrule."
    )


def between(times: Floats, period: float) -> Marks:
    """Mark rows that stand between two samples of an even clock: their neighbours are one period apart.

    times: (n,) elapsed, in the unit of `period`. Of two neighbours that could both be so, the one that is
    farther from where the next sample is due stands between.
    """
    found = np.zeros(len(times), np.bool_)
    steps = np.diff(times) / period
    if len(steps) < 2 or (steps > 1 - EVENNESS).all():
        return found
    two = steps[:-1] + steps[1:]
    found[1:-1] = (np.abs(two - 1) <= EVENNESS) & (np.minimum(steps[:-1], steps[1:]) < 1 - EVENNESS)
    for k in np.flatnonzero(found[:-1] & found[1:]).tolist():
        if found[k] and found[k + 1]:
            due = times[k - 1] + period
            found[k if abs(times[k] - due) < abs(times[k + 1] - due) else k + 1] = False
    return found
