"""Determines the sampling rate of rows with a column of times, or asks the user for it."""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from fltea.recording.candidates import ticks_table, times_table
from fltea.recording.clocks import MOST_IN_TURNS, Clock, clock_of
from fltea.recording.reading import Answer, Missing, NotStated, not_stated
from fltea.recording.sample_times import (
    EVEN_SHARE,
    PLAUSIBLE_HZ,
    SAME_RATE,
    SECONDS,
    Elapsed,
    Floats,
    TimeColumn,
)
from fltea.recording.session import HIGHEST_RATE_HZ
from fltea.records.errors import UsageError
from fltea.settings.how import TimeUnit

POSSIBLE_HZ = 2.0, 50_000.0
"""If the unit of a column of times is stated, the sampling rate by these times must be in this range [Hz]. A
rate outside this range suggests that the stated unit is wrong.
"""

LEAST_HZ = 0.01
"""A rate that the user gives must be at least this, unless the user adds --overrule [Hz]. Lower rates are
likely mistakes.
"""

LIKE_MEAN = 1.5
"""If the steps between times are uneven, the mean rate may be at most this many times the rate that the user
gives. In the other direction, this limit holds only if many rows repeat a time. Otherwise the user's rate may
be far higher than the mean rate, since samples may be lost.
"""


class Timing(NamedTuple):
    """How the rows of a table get sample numbers and times.

    `period`: sampling period in the unit of the column of times. None if rows are numbered by their order
    instead of by times. `unit_s`: length of the column's unit [s].
    `warning`: warning for the user, or "". `answers`: what was found out about rate and clock, with its
    evidence. `is_rounded`: whether the times are rounded coarsely compared with the period: 2.5 ms to whole
    milliseconds, for example.
    """

    rate_hz: float
    period: float | None
    unit_s: float = 1.0
    warning: str = ""
    answers: tuple[Answer, ...] = ()
    is_rounded: bool = False


def timing(
    where: str,
    column: TimeColumn,
    clock: Clock | None,
    elapsed: Elapsed,
    place: Callable[[int], str] = str,
) -> Timing:
    """Return the sampling rate of a table's rows, and how the rows are numbered.

    `where`: file, for messages. `clock`: what the steps between times show; None if there is only one time.
    `elapsed`: has converted these times, and counted what is odd. `place`: function that returns the position
    of a row in words, for messages.

    Raises:
        UsageError: no rate is given and none follows from the times, or the rate by the times contradicts the
            rate that the user gives or the file states.
    """
    where_column = f"{where}: column '{column.name}'"
    if column.is_given and column.rate_hz is not None:
        check_given(where, column.rate_hz, overrule=column.overrule)
        return _with_rate(where_column, column, clock, elapsed, column.rate_hz)
    if clock is None:
        raise not_stated(
            where, [Missing(f"the rate; one time in '{column.name}' does not show it", "--rate ?")]
        )
    if not clock.even:
        raise _uneven(where, column, clock, elapsed, place)
    unit_s = SECONDS[column.unit or "s"]
    rate_hz = 1.0 / (clock.typical * unit_s)
    if column.unit is None and not _is_within(PLAUSIBLE_HZ, rate_hz):
        raise _unit_needed(where_column, clock.typical)
    if not _is_within(POSSIBLE_HZ, rate_hz) and not column.overrule:
        raise _impossible(where_column, column.unit or "s", clock.typical)
    if column.rate_hz is not None and abs(rate_hz / column.rate_hz - 1) > SAME_RATE and not column.overrule:
        raise UsageError(
            f"{where_column}: by its times the rate is {rate_hz:.6g} Hz, and the file states "
            f"{column.rate_hz:g} Hz. Say which is right: --rate ? --overrule."
        )
    answer = _clock_answer(column, elapsed, rate_hz)
    return Timing(rate_hz, clock.typical, unit_s, answers=(answer,), is_rounded=clock.is_rounded)


def check_given(where: str, rate_hz: float, *, overrule: bool) -> None:
    """Refuse an impossible rate that the user gives.

    Raises:
        UsageError: the rate is below `LEAST_HZ`, or above the limit for recordings.
    """
    if rate_hz > HIGHEST_RATE_HZ:
        raise UsageError(f"{where}: --rate {rate_hz:g}: no gyroscope gives so many samples a second.")
    if rate_hz < LEAST_HZ and not overrule:
        raise UsageError(
            f"{where}: --rate {rate_hz:g} would be a sample in {1 / rate_hz:.3g} s. Is it a period? It has "
            "to be in Hz, samples a second. If the rate is right, add --overrule."
        )


def rate_of(times: Floats, unit: TimeUnit | None) -> float | None:
    """Return the sampling rate that follows from times, if the times are even; else None.

    Times without a unit are taken as seconds.
    """
    times = times[np.isfinite(times)]
    if not len(times):
        return None
    elapsed = Elapsed(unit)
    since, _ = elapsed.add(times, times[:, np.newaxis])
    clock = clock_of(lambda: [since], elapsed)
    if clock is None or not clock.even:
        return None
    rate_hz = 1 / (clock.typical * SECONDS[unit or "s"])
    return rate_hz if _is_within(POSSIBLE_HZ if unit else PLAUSIBLE_HZ, rate_hz) else None


def _clock_answer(column: TimeColumn, elapsed: Elapsed, rate_hz: float) -> Answer:
    ticks = f"{column.ticks:g} " if column.ticks != 1.0 else ""
    unit = f" in {ticks}{column.unit}" if column.unit else ", which can only be seconds"
    form = ", with hours and minutes before the seconds (hhmmss)" if elapsed.local.of_day else ""
    return Answer("clock", f"{rate_hz:.6g} Hz", "measured", f"the times of {column.name}{unit}{form}")


def _uneven(
    where: str, column: TimeColumn, clock: Clock, elapsed: Elapsed, place: Callable[[int], str]
) -> NotStated:
    """Return the error that asks for the rate, and says why the times are not from a sensor's clock."""
    name, shown, unit_s = column.name, column.unit or "s", SECONDS[column.unit or "s"]
    first = "" if elapsed.first is None else place(elapsed.first).removeprefix(where).strip(": ")
    at = f", the first in {f'line {first}' if first.isdigit() else first}" if first else ""
    turns = elapsed.rows / max(elapsed.rows - elapsed.repeated, 1)
    rate_hz = _mean_hz(clock, elapsed, unit_s)
    remark = "With the rate of the sensor all rows count as evenly spaced, and the times tell no gaps."
    if elapsed.backwards > (1 - EVEN_SHARE) * elapsed.rows:
        rate_hz = (elapsed.rows - 1) / max(elapsed.between * unit_s, 1 / POSSIBLE_HZ[1])
        why = f"{elapsed.backwards} of {elapsed.rows} times of '{name}' are earlier than the one before{at}"
        remark = (
            "If the rows do not stand in the order in which they were measured, sort them by their times."
        )
    elif clock.in_turn and not column.is_of_one:
        n = clock.in_turn
        return not_stated(
            where,
            [Missing(f"whether {n} sensors take turns, or one has uneven times", "?")],
            (),
            f"The steps of '{name}', {clock.least:.3g} to {clock.largest:.3g} {shown}, come again after {n} "
            "rows:\n"
            f"  --sensor 1/{n}: the first of {n} sensors in turns, --sensor 2/{n} the second …\n"
            f"  --rate ?: one sensor; {_mean(column, rate_hz)}",
        )
    elif clock.bursts is not None:
        rows, every = clock.bursts
        rate_hz = rows / (every * unit_s)
        why = (
            f"the rows come in bursts, {rows} every {every:.3g} {shown}, and the times in '{name}', "
            f"{clock.typical:.3g} {shown} apart, are those at which the rows were fetched"
        )
        if rows <= MOST_IN_TURNS and not column.is_of_one:
            remark = (
                f"If they are of {rows} sensors that take turns: --sensor 1/{rows} for the first. {remark}"
            )
    elif not column.is_of_one and _is_coarse(elapsed) and _are_turns(turns):
        return _turns(where, name, round(turns), at, _mean(column, rate_hz))
    elif _is_coarse(elapsed) or clock.is_coarse:
        why = (
            f"{elapsed.repeated} of {elapsed.rows} times of '{name}' are the same as the one before{at}: the "
            f"clock is coarser than the samples, with steps of {clock.median:.3g} {shown}"
        )
    else:
        why = (
            f"the steps of '{name}' are too uneven for a sensor's clock (median {clock.median:.3g} {shown}, "
            f"from {clock.least:.3g} to {clock.largest:.3g} {shown}{at}), as times of arrival are, or where "
            "rows are missing"
        )
    text = f"{_mean(column, rate_hz)}. {remark}"
    return not_stated(where, [Missing(f"the rate, as {why}", "--rate ?")], (), text[0].upper() + text[1:])


def _are_turns(rows: float) -> bool:
    """Return whether so many rows for each time may be those of sensors that take turns."""
    return MOST_IN_TURNS >= round(rows) >= 2 and abs(rows - round(rows)) < 0.01


def _turns(where: str, name: str, count: int, at: str, mean: str) -> NotStated:
    """Return the error that asks if `count` sensors take turns, since each time stands in `count` rows."""
    what = f"whether {count} sensors take turns, or the clock is coarser than the samples"
    table = [
        f"Each time in '{name}' stands {count} times{at}:",
        f"  --sensor 1/{count}: the first of {count} sensors in turns, --sensor 2/{count} the second …",
        f"  --rate ?: one sensor, whose clock is coarser than its samples; {mean}",
    ]
    return not_stated(where, [Missing(what, "?")], (), "\n".join(table))


def _mean(column: TimeColumn, rate_hz: float) -> str:
    """Return a remark for the user: the mean rate of uneven times, which is too low if rows are missing."""
    if column.unit is None and not _is_within(PLAUSIBLE_HZ, rate_hz):
        return "the times tell no rate"
    return f"in the mean these times give {rate_hz:.4g} Hz, which is wrong if rows are missing"


def _is_coarse(elapsed: Elapsed) -> bool:
    return elapsed.repeated > (1 - EVEN_SHARE) * elapsed.rows


def _mean_hz(clock: Clock, elapsed: Elapsed, unit_s: float) -> float:
    """Return the mean rate of rows between the first and the last time [Hz]."""
    steps, span = (elapsed.rows, clock.median) if _is_coarse(elapsed) else (elapsed.rows - 1, 0.0)
    return steps / (elapsed.span + span) / unit_s if elapsed.span > 0 else math.nan


def _is_within(limits: tuple[float, float], rate_hz: float) -> bool:
    least, most = _widened(limits)
    return least <= rate_hz <= most


def _widened(limits: tuple[float, float]) -> tuple[float, float]:
    """Return limits that are wider by the rounding error of a computed rate."""
    return limits[0] * (1 - 1e-6), limits[1] * (1 + 1e-6)


def _unit_needed(where_column: str, step: float) -> NotStated:
    table = ticks_table(step, times_table(step, _widened(PLAUSIBLE_HZ)))
    return not_stated(where_column, [Missing("in which unit its times are", "--time-unit ?")], (), table)


def _impossible(where_column: str, unit: TimeUnit, step: float) -> NotStated:
    limits = f"{POSSIBLE_HZ[0]:g} Hz to {POSSIBLE_HZ[1] / 1000:g} kHz"
    why = f"the rate: a step of {step:.6g} {unit} is no gyroscope's ({limits})"
    meant = f"  --overrule: {1 / (step * SECONDS[unit]):.6g} Hz, in {unit}"
    table = ["Such a step would be:", *times_table(step, _widened(PLAUSIBLE_HZ), " --overrule"), meant]
    return not_stated(where_column, [Missing(why, "--rate ?")], (), "\n".join(table))


def _with_rate(
    where_column: str, column: TimeColumn, clock: Clock | None, elapsed: Elapsed, rate_hz: float
) -> Timing:
    unit = column.unit
    if clock is None:
        return Timing(rate_hz, None)
    if unit is not None and clock.even and not _is_within(POSSIBLE_HZ, 1 / (clock.typical * SECONDS[unit])):
        unit = None  # the stated unit gives an impossible rate, so this unit is ignored
    own_s = 1 / (rate_hz * clock.typical) if clock.typical > 0 else 1.0
    by_times = Timing(rate_hz, clock.typical, own_s, is_rounded=clock.is_rounded)
    nearest = math.nan
    if clock.even or clock.bursts is not None:
        found = [1 / (clock.typical * SECONDS[u]) for u in ([unit] if unit else SECONDS)]
        nearest = min(found, key=lambda rate: abs(math.log(rate / rate_hz)))
        if abs(nearest / rate_hz - 1) <= SAME_RATE:
            return by_times
    if not clock.even:
        mean_hz = math.nan if unit is None else _mean_hz(clock, elapsed, SECONDS[unit])
        is_slower = (
            mean_hz > LIKE_MEAN * rate_hz
        )  # the user's rate may be higher than the mean rate, since samples may be lost
        is_faster = _is_coarse(elapsed) and LIKE_MEAN * mean_hz < rate_hz
        if (is_slower or is_faster) and not column.overrule:
            raise _other_rate(where_column, mean_hz, rate_hz)
        return Timing(
            rate_hz,
            None,
            warning=f"{where_column} has steps too uneven for a clock, so it cannot tell which samples are "
            f"missing: with --rate {rate_hz:g} all rows count as evenly spaced.",
        )
    is_in_s = column.unit is None and _is_within(PLAUSIBLE_HZ, 1 / clock.typical)
    is_free = column.unit is None and not is_in_s and _is_within(POSSIBLE_HZ, rate_hz)
    if not is_free and not column.overrule:
        raise _other_rate(where_column, 1 / clock.typical if is_in_s else nearest, rate_hz)
    warning = (
        f"{where_column}: its unit is not known; with --rate {rate_hz:g} a step of {clock.typical:.6g} is "
        "one sample, and the column tells only which are missing."
    )
    return by_times._replace(warning=warning)


def _other_rate(where_column: str, found_hz: float, rate_hz: float) -> UsageError:
    return UsageError(
        f"{where_column}: by its times the rate is {found_hz:.6g} Hz, and --rate {rate_hz:g} says otherwise. "
        "Leave --rate out. If the times are wrong, add --overrule."
    )
