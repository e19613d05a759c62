"""Compares what a line among the rows of a text states with the columns, units and rate that are read.

Such a line is a comment, a row of units, or a comment with names of columns as numpy's savetxt writes it.
"""

import re
from collections.abc import Iterator, Sequence

from fltea.recording.column_names import axis_of, is_time, time_scale_of, unit_in, without_unit
from fltea.recording.columns import Chosen
from fltea.recording.sample_times import SAME_RATE
from fltea.recording.text_fields import COMMENTS, is_comment, split, words_with_units
from fltea.recording.text_head import LONGEST_LINE, stated_in
from fltea.recording.units import (
    PER_UNIT,
    accel_unit,
    is_physical,
    parse_units,
    rate_unit,
    time_scale,
)
from fltea.recording.wanted import is_number

SAME_SCALE = 0.02
"""Scales count as equal if their relative difference is at most this."""

_COUNTS = ("lsb", "lsbs", "count", "counts", "raw", "adc", "digit", "digits")
_MAGNETIC = ("ut", "µt", "μt", "nt", "mt", "gauss", "mgauss")

_RANGE = re.compile(
    r"\b(?:range|full[ _-]?scale|fsr?)\W{1,5}(?:(?:is|of)\W{1,3})?(?:\+/-|\+-|±)?"
    r"\s?(\d{1,6}(?:\.\d{1,6})?)\s?([^\s,;)\]]+)",
    re.I,
)
_UNIT = re.compile(r"[\[(]([^\[\]()]{1,20})[\])]|\bin\s+(\S{1,20})")
"""Matches a word that may be a unit, since it stands in brackets or after "in"."""


def contradict(units: Sequence[str], chosen: Chosen, above: Sequence[str]) -> bool:
    """Return whether a row of units contradicts those that are read.

    `above`: the row of units above the first row, whose words do not contradict what is read.
    """
    clock = None if chosen.time is None or chosen.clock.unit is None else time_scale(units[chosen.time])
    if clock not in (None, (chosen.clock.unit, chosen.clock.factor)):
        return True
    is_known = len(above) == len(units)
    return any(
        _is_other_unit(units[place], chosen)
        for place in chosen.gyro
        if not (is_known and units[place] == above[place])
    )


def are_first_names(names: Sequence[str], chosen: Chosen, width: int) -> bool:
    """Return whether names of columns that had none so far agree with what is read from the columns.

    A board that starts again, for instance, prints its header to a program that began to read below it.
    `width`: number of the columns.
    """
    if len(names) != width or not all(name.isdecimal() for name in chosen.names):
        return False
    axes = tuple(axis_of(names[place]) for place in chosen.gyro)
    return axes == chosen.axes and not contradict([unit_in(name) for name in names], chosen, ())


def names_say_otherwise(text: str, chosen: Chosen) -> bool:
    """Return whether names in a comment give the columns that are read other axes, units or places."""
    names = next((one for one in _names(text) if len(one) == len(chosen.names)), None)
    if names is None or any(map(is_number, names)):  # a row that is commented out
        return False
    if not any(axis_of(name) or name in chosen.names for name in names):
        return False
    old, bases = chosen.names, [without_unit(name) for name in names]
    for place, axis in zip(chosen.gyro, chosen.axes, strict=True):
        base = without_unit(old[place])
        is_moved = bases[place] != base and base in bases
        if is_moved or axis_of(names[place]) not in (None, axis):
            return True
        unit = unit_in(names[place])
        if unit and unit != unit_in(old[place]) and not chosen.rate.overrule and _is_other_unit(unit, chosen):
            return True
    if (
        chosen.time is None
        or chosen.clock.unit is None
        or chosen.rate.overrule
        or not is_time(names[chosen.time])
    ):
        return False
    scales = [time_scale_of(one[chosen.time]) for one in (names, old)]
    return scales[0] not in (None, scales[1], (chosen.clock.unit, chosen.clock.factor))


def _names(text: str) -> Iterator[list[str]]:
    """Yield the words of a comment, once for each separator."""
    for mark in COMMENTS:
        text = text.removeprefix(mark)
    for separator in "\t;,":
        yield split(text, separator)
    yield words_with_units(text)


def said(text: str, chosen: Chosen, ranges_dps: Sequence[float]) -> list[bool]:
    """Return, for each unit, rate and range that a line states in words, whether it is that which is read.

    `ranges_dps`: full scales of the gyroscope that stand above the first row. A range tells the scale of
    counts, and nothing of numbers in a unit.
    """
    rates, units = stated_in(text)
    found = [_same_unit(unit, chosen.unit.name) for unit in units.values()]
    if chosen.time is None and chosen.rate.hz is not None:
        found += [abs(rate_hz / chosen.rate.hz - 1) <= SAME_RATE for rate_hz in rates.values()]
    if chosen.unit.lsb is not None and ranges_dps:
        found += [range_dps in ranges_dps for range_dps in ranges_in(text)]
    return [one for one in found if one is not None]


def ranges_in(text: str) -> list[float]:
    """Return the full scales of a gyroscope that a line states [deg/s]."""
    found = ((float(number), rate_unit(unit)) for number, unit in _RANGE.findall(text[:LONGEST_LINE]))
    return [number * PER_UNIT[unit] for number, unit in found if unit is not None]


def may_say_otherwise(text: str, chosen: Chosen) -> bool:
    """Return whether a comment has a unit of another sensor, or another one of the gyroscope.

    Here the other words of the comment are not understood, so nothing is known of the rows below it.
    """
    if len(text) > LONGEST_LINE or not (is_comment(text) or text[:1] in (";", "[", "-", "=", "*")):
        return False
    if chosen.unit.lsb is not None and ranges_in(text):
        return True
    words = text.strip("#%/ ").split()
    rates = [
        word.strip(",;.:()[]")
        for before, word in zip(["", *words], words, strict=False)
        if not is_number(before.strip("+-±<>=~")) and rate_unit(word.strip(",;.:()[]"))
    ]
    if any(_same_unit(unit, chosen.unit.name) is False for unit in rates):
        return True
    units = [(one or other).strip(" ,;.:") for one, other in _UNIT.findall(text)]
    return any(accel_unit(unit) is not None or unit.lower() in _MAGNETIC for unit in units)


def _is_other_unit(unit: str, chosen: Chosen) -> bool:
    """Return whether the unit of a column contradicts that in which the gyroscope's columns are read."""
    is_same = _same_unit(unit, chosen.unit.name)
    if is_same is not None:
        return not is_same
    is_rate = rate_unit(unit) is not None
    return (is_physical(unit) and not is_rate) or (
        chosen.unit.lsb is None and unit.strip(" []()").lower() in _COUNTS
    )


def _same_unit(said: str, name: str) -> bool | None:
    """Return whether two units are the same; None if they cannot be compared."""
    if rate_unit(said) is None and not said.startswith("lsb:"):
        return None
    (factor, lsb), (known, counts) = parse_units(said), parse_units(name)
    if (lsb is None) != (counts is None):
        return None
    return abs(factor / (lsb or 1.0) / (known / (counts or 1.0)) - 1) <= SAME_SCALE
