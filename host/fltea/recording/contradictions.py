"""Checks whether the chosen columns contradict each other, the logger's dialect, or the first rows."""

import math
import re
from collections.abc import Sequence

import numpy as np

from fltea.recording import candidates
from fltea.recording.column_names import accel_unit_of, is_time, rate_unit_of, time_scale_of
from fltea.recording.dialects import GRAVITY_TOLERANCE
from fltea.recording.evidence import Choice
from fltea.recording.files import Note, listed
from fltea.recording.reading import OVERRULE, Missing, given_options, not_stated, says_otherwise
from fltea.recording.sample_times import EVEN_SHARE, EVENNESS, SAME_RATE, SECONDS, ClockColumns, Floats
from fltea.recording.units import accel_unit, rate_unit, time_scale, time_unit
from fltea.records.errors import UsageError
from fltea.records.units import STANDARD_GRAVITY_MS2

MOST_OFFSET_DPS = 5.0
"""Largest usual offset of a gyroscope at rest [deg/s]. Rates of 1 deg/s may look like gravity in g. So
columns are suspected to hold accelerations only if their vector, taken as rates, is longer than this.
"""

FEWEST_STEPS = 8
"""Two clocks are compared if there are at least this many steps between times."""


def check_clock(choice: Choice, clock: ClockColumns) -> None:
    """Compare the chosen clock with the dialect, the rate in the file's head and other columns of times.

    Raises:
        UsageError: the user's rate differs from the rate in the file's head.
        NotStated: two clocks run at different rates, and the user chose neither.
    """
    how, dialect = choice.how, choice.dialect
    given_hz = how.rate_hz or 0.0
    for why, stated_hz in choice.stated_rates().items() if given_hz and not how.overrule else ():
        if len(choice.stated_rates()) == 1 and abs(given_hz / stated_hz - 1) > SAME_RATE:
            fact = f'"{why.removeprefix("the head: ")}" stands in the head'
            raise says_otherwise(choice.where, fact, "--rate", f"{given_hz:g}")
    if clock.time is None:
        return
    name = choice.names[clock.time]
    if dialect is not None and how.time_unit is not None and name in _of_dialect(choice):
        scale, counted = choice.scale(dialect.time_scale), time_scale(dialect.time_unit)
        is_in_head = bool(dialect.time_scale) and scale is not None and counted is not None
        if scale is not None and counted is not None and is_in_head and how.time_unit != counted[0]:
            ratio = SECONDS[counted[0]] * counted[1] * scale / SECONDS[how.time_unit]
            if abs(ratio - 1) > SAME_RATE and not how.overrule:
                fact = (
                    f"{dialect.time_scale} {scale:g} stands in the head, by which 1 in {listed([name])} is "
                )
                fact += f"{scale:g} {dialect.time_unit}"
                raise says_otherwise(choice.where, fact, "--time-unit", how.time_unit)
        ticks = dialect.time_scale or ("" if dialect.time_ticks == 1.0 else f"{dialect.time_ticks:g}")
        if not is_in_head and (ticks or time_unit(dialect.time_unit) != how.time_unit):
            counts = f"by {dialect.name} it counts {ticks} {dialect.time_unit}".replace("  ", " ")
            text = f"{listed([name])} is read in {how.time_unit}, as --time-unit says; {counts}."
            choice.notes.append(Note("reading", f"{choice.where}: {text}"))
    if how.time_column is None and not how.overrule:
        unit_s = None if clock.unit is None else SECONDS[clock.unit] * clock.factor
        _compare_clocks(choice, clock.time, unit_s, clock)


def _compare_clocks(choice: Choice, time: int, unit_s: float | None, clock: ClockColumns) -> None:
    values, names = choice.first_rows(), choice.names
    if values is None:
        return
    parts = [*clock.coarse, *([] if clock.fine is None else [(clock.fine, clock.fine_s)])]
    times = values[:, time] + sum(values[:, place] * of_s for place, of_s in parts)
    read = {time, *(place for place, _ in parts)}
    none = choice.dialect.no_time if choice.dialect is not None else ()
    for place, name in enumerate(names):
        if place in read or not is_time(name) or any(re.fullmatch(pattern, name) for pattern in none):
            continue
        found = _runs_as(values[:, place], times)
        if found is None:
            continue
        other = time_scale(choice.units[place]) or time_scale_of(name)
        other_s = None if other is None else SECONDS[other[0]] * other[1]
        if other is None and {*_of_dialect(choice)} >= {name, names[time]}:
            other_s = unit_s
        if other_s is not None and unit_s is not None:
            ratio = found * other_s / unit_s
        else:  # a unit is unknown: if one clock runs 1000 times as fast, only its unit is taken to differ
            ratio = found / 1000 ** round(math.log(found, 1000))
        if abs(ratio - 1) > SAME_RATE:
            what = f"which clock is right: {listed([names[time], name])} differ by a factor of {ratio:.4g}"
            raise not_stated(choice.where, [Missing(what, "--time-column ?")], given_options(choice.how))


def _of_dialect(choice: Choice) -> list[str]:
    """Return the names of the columns of times for which the dialect states a unit."""
    dialect = choice.dialect
    patterns = dialect.time if dialect is not None and dialect.time_unit else ()
    return [name for name in choice.names if any(re.fullmatch(pattern, name) for pattern in patterns)]


def _runs_as(times: Floats, others: Floats) -> float | None:
    """Return the ratio of the steps of `times` to those of `others`.

    If the ratio varies from step to step, one of the two columns is no clock: return None. Also return None
    if there are too few steps.
    """
    steps, ahead = np.diff(times), np.diff(others)
    known = np.isfinite(steps) & np.isfinite(ahead) & (ahead > 0)
    if known.sum() < FEWEST_STEPS:
        return None
    ratios = steps[known] / ahead[known]
    middle = float(np.median(ratios))
    even = middle > 0 and (np.abs(ratios / middle - 1) < EVENNESS).mean() >= EVEN_SHARE
    return middle if even and math.isfinite(middle) else None


def check_gravity(
    choice: Choice, gyro: Sequence[int], dps: float, accel: Sequence[int], accel_ms2: float
) -> None:
    """Check that the accelerometer measures gravity, and that the gyroscope's numbers do not look like it.

    `gyro`: columns of the gyroscope's axes. `dps`: unit of their numbers [deg/s]. `accel`: columns of the
    accelerometer's axes. `accel_ms2`: unit of these columns [m/s²].

    Raises:
        UsageError: the accelerations have the length of gravity in another unit than the user says. Or the
            numbers in the gyroscope's columns have the length of gravity, and the accelerations have not.
    """
    how, dialect, values = choice.how, choice.dialect, choice.first_rows()
    if how.overrule or values is None:
        return
    if len(accel) != 3:
        _check_alone(choice, gyro, values[:, list(gyro)], dps)
        return
    by_dialect = "" if dialect is None else dialect.accel_unit
    is_other = by_dialect and (accel_unit(by_dialect) != accel_ms2 or (dialect and dialect.accel_scale))
    if dialect is not None and how.accel_units is not None and is_other:
        text = f"the accelerometer is read in {how.accel_units}, as --accel-units says; by {dialect.name} it "
        choice.notes.append(Note("reading", f"{choice.where}: {text}is in {by_dialect}."))
    length_ms2 = candidates.length_of(values[:, list(accel)]) * accel_ms2
    if abs(length_ms2 / STANDARD_GRAVITY_MS2 - 1) < candidates.GRAVITY_TOLERANCE:
        return
    measured = candidates.gravity_units(values[:, list(accel)])
    stated = {accel_unit_of(choice.names[place]) or accel_unit(choice.units[place]) for place in accel}
    if how.accel_units is not None and measured and stated == {None}:
        raise UsageError(
            f"{choice.where}: the length of the acceleration is that of gravity in {' or '.join(measured)}, "
            f"and --accel-units {how.accel_units} says otherwise. {OVERRULE}"
        )
    if how.columns is None and len(gyro) == 3 and _is_gravity(values[:, list(gyro)], accel_ms2):
        raise UsageError(
            f"{choice.where}: {listed([choice.names[place] for place in gyro])} have the length of gravity, "
            f"and {listed([choice.names[place] for place in accel])} have not: are their names swapped? Name "
            f"the gyroscope's columns with --columns. {OVERRULE}"
        )


def _check_alone(choice: Choice, gyro: Sequence[int], values: Floats, dps: float) -> None:
    """Raise UsageError if rates look like accelerations, and nothing but the user's option states their unit.

    They look like accelerations if their vector is as long as gravity in some unit.
    """
    names = [choice.names[place] for place in gyro]
    is_stated = any(rate_unit_of(choice.names[p]) or rate_unit(choice.units[p]) for p in gyro)
    measured = candidates.gravity_units(values) if len(gyro) == 3 and not is_stated else []
    units = [unit for unit in measured if _is_gravity(values, accel_unit(unit) or math.nan)]
    length = candidates.length_of(values)
    if choice.how.units is not None and units and length * dps > MOST_OFFSET_DPS:
        raise UsageError(
            f"{choice.where}: {listed(names)} have the length {length:.4g}, which is gravity in "
            f"{' or '.join(units)}: they seem an accelerometer's. Name the gyroscope's columns with "
            "--columns; if these are, add --overrule."
        )


def _is_gravity(values: Floats, unit_ms2: float) -> bool:
    is_as_long = abs(candidates.length_of(values) * unit_ms2 / STANDARD_GRAVITY_MS2 - 1) < GRAVITY_TOLERANCE
    return is_as_long and bool(candidates.gravity_units(values))
