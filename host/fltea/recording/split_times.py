"""Finds columns that say the time together: one of whole seconds, and one of the fraction of a second.

Columns of minutes and hours may stand before the seconds.
"""

from collections.abc import Iterator, Sequence
from typing import Literal, NamedTuple

import numpy as np

from fltea.recording.column_names import (
    fraction_of_seconds,
    is_clock_of_seconds,
    minutes_or_hours,
    whole_seconds,
)
from fltea.recording.sample_times import EVEN_SHARE, Floats

LONGEST_STEP_S = 0.5
"""A time here is the sum of two columns: whole seconds, and the fraction of a second. If the fraction is read
in a wrong unit, the time jumps whenever a new second begins. So if the median of these steps from one sample
to the next is longer than this [s], the unit is wrong.
"""


MOST_OF = {60.0: 60, 3600.0: 24}
"""The number of minutes in an hour, and of hours in a day, by their lengths [s]."""


class SplitTime(NamedTuple):
    """Columns that say the time together: `whole` seconds, and `fine`, whose unit is `fine_s` [s].

    `coarse`: columns of minutes and of hours, each with its unit [s].
    """

    whole: int
    fine: int
    fine_s: float
    coarse: tuple[tuple[int, float], ...] = ()


class SplitTimes(NamedTuple):
    """Pairs of columns that say the time together.

    `doubtful`: pairs of which the first rows show that the second column is the fraction of the seconds in
    the first, but in another unit than its name states.
    """

    found: list[SplitTime]
    doubtful: list[SplitTime]


def split_times(names: Sequence[str], values: Floats | None) -> SplitTimes:
    """Return the pairs of columns that say the time together, by their names and by the first rows.

    `values`: numbers in the first rows (n, columns), None if they are not available.
    """
    result = SplitTimes([], [])
    for pair, is_same in _named(names):
        told = "few" if values is None else _told(values[:, pair.whole], values[:, pair.fine] * pair.fine_s)
        is_likely = is_same or (
            told == "few" and values is not None and is_clock_of_seconds(names[pair.whole])
        )
        if told == "parts" or (told in ("few", "unsorted") and is_likely):
            result.found.append(pair._replace(coarse=_coarse(names, pair, values)))
        elif told == "other unit":
            result.doubtful.append(pair)
    return result


def _named(names: Sequence[str]) -> Iterator[tuple[SplitTime, bool]]:
    """Yield the pairs that names allow, and whether the rest of both names is the same.

    A column of fractions is paired with columns of whole seconds of the same name, as in `stamp.sec` and
    `stamp.nanosec`; a column whose name is a unit alone, as `msec`, also with other columns of times.
    """
    fractions = {k: found for k, name in enumerate(names) if (found := fraction_of_seconds(name)) is not None}
    if not fractions:
        return
    seconds = {
        k: base
        for k, name in enumerate(names)
        if k not in fractions and (base := whole_seconds(name)) is not None
    }
    for fine, (base, fine_s) in fractions.items():
        for whole in sorted(seconds, key=lambda k: (abs(k - fine), k)):
            if seconds[whole] == base or not base:
                yield SplitTime(whole, fine, fine_s), seconds[whole] == base


def _coarse(names: Sequence[str], pair: SplitTime, values: Floats | None) -> tuple[tuple[int, float], ...]:
    """Return the columns of minutes and hours that stand before one of seconds, each with its unit [s].

    Their names may mean lengths, so the first rows have to show that they are minutes and hours.
    """
    found: list[tuple[int, float]] = []
    if values is None:
        return ()
    base, time = whole_seconds(names[pair.whole]), values[:, pair.whole] + values[:, pair.fine] * pair.fine_s
    if (time >= 60).any():
        return ()
    for place, unit_s in zip((pair.whole - 1, pair.whole - 2), MOST_OF, strict=True):
        if place < 0 or minutes_or_hours(names[place]) != (base, unit_s):
            break
        number = values[:, place]
        time = time + number * unit_s
        known = np.isfinite(time)
        is_one = (number >= 0) & (number < MOST_OF[unit_s]) & (number == np.rint(number))
        steps = np.diff(time[known])
        if not known.any() or is_one[known].mean() < EVEN_SHARE:
            break
        if len(steps) and (steps >= 0).mean() < EVEN_SHARE:
            break
        found.append((place, unit_s))
    return tuple(found)


def are_parts(whole: Floats, fine_s: Floats) -> bool:
    """Return whether numbers can be whole seconds and fractions of these [s]; True if there is no number."""
    known = np.isfinite(whole) & np.isfinite(fine_s)
    is_part = (fine_s >= 0) & (fine_s < 1) & (whole == np.rint(whole))
    return not known.any() or float(is_part[known].mean()) >= EVEN_SHARE


def _told(whole: Floats, fine_s: Floats) -> Literal["parts", "other unit", "unsorted", "no parts", "few"]:
    """Return what first rows tell of a column of whole seconds and one of their fractions [s].

    "parts": they are that; "other unit": they are, but the fractions have another unit; "unsorted": too many
    steps are none of a clock; "few": there are too few rows to tell.
    """
    known = np.isfinite(whole) & np.isfinite(fine_s)
    whole, fine_s = whole[known], fine_s[known]
    if not len(whole):
        return "few"
    if not are_parts(whole, fine_s):
        return "no parts"
    if len(whole) == 1:
        return "few"
    seconds, parts = np.diff(whole), np.diff(fine_s)
    within, next_second = seconds == 0, (seconds == 1) & (parts < 0)
    if not (within & (parts > 0)).any() and (within.any() or not next_second.any()):
        return "no parts"
    rises = (within & (parts >= 0)) | next_second | (seconds > 1)
    if rises.mean() < EVEN_SHARE:
        return "unsorted"
    is_late = next_second.any() and float(np.median((seconds + parts)[next_second])) > LONGEST_STEP_S
    return "other unit" if is_late else "parts"
