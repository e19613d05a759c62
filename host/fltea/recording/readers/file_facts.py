"""Reads units, rates, scales and column names that a file states in attributes or in arrays next to the data.

Each fact has a name. For example, `imu.gyro@units` is an attribute of the array `imu.gyro`. Facts may also be
arrays: `imu.gyro_units` and `imu.units.gyro` describe only the array `imu.gyro`, and `imu.units` describes
all arrays in the group `imu`.
"""

import math
import re
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from fltea.recording.column_names import accel_axis_of, axis_of, is_time
from fltea.recording.files import listed
from fltea.recording.groups import around, group_of, gyroscopes_in, is_of_accelerometer
from fltea.recording.sample_times import SECONDS
from fltea.recording.units import time_scale
from fltea.recording.wanted import NUMBER

UNITS = "units?|unit_string|ni_unitdescription"
COLUMNS = "columns?(?:_names?)?|labels?|channels?(?:_names?)?|axes"
COUNTS = "(?:lsb|counts)_per_(?:dps|deg_s)"
"""Matches names of facts that state the number of counts in 1 deg/s. Such a scale can be applied. The names
of other scales do not tell whether to multiply or to divide by the scale.
"""

SCALES = "scale(?:_?factor)?|scaling|gain|sensitivity|offset|multiplier|factor|lsb|slope|resolution"
SCALES += rf"|conversion(?:_?factor)?|{COUNTS}"
"""Matches names of facts that state a scale or an offset. Such a name does not tell whether to multiply or to
divide by the scale.
"""

_RATE = re.compile(
    r"(?:imu_|gyro_)?(?:fs|rate|odr|sfreq|data_rate|sampl(?:e|ing)_?(?:rate|freq|frequency))(?:_?(k?hz))?"
)
_PERIOD = re.compile(r"(?:dt|(?:sampl(?:e|ing)_?)?(?:period|interval))(?:_(s|ms|us|ns))?|(wf_increment)")
_NUMBER = re.compile(rf"\s*({NUMBER})\s*[(\[]?([^)\]]*)[)\]]?\s*")

PER_S = {"": 1.0, "1/s": 1.0, "s-1": 1.0, "s^-1": 1.0, "sps": 1.0, "samples/s": 1.0, "s/s": 1.0}
PER_S |= {"hz": 1.0, "hertz": 1.0, "khz": 1e3, "samples per second": 1.0}


def texts_of(value: Any) -> list[str]:
    """Return the texts in the value of a fact, which is a text or a list of texts.

    For other values, return an empty list.
    """
    if not isinstance(value, str | bytes | np.ndarray | np.generic | list | tuple):
        return []
    found = np.asarray(value, object).reshape(-1).tolist()
    found = [one.decode(errors="replace") if isinstance(one, bytes) else one for one in found]
    return list(map(str, found)) if all(isinstance(one, str) for one in found) else []


def number_of(value: Any, other: float = math.nan) -> float:
    """Return the single number in the value of a fact.

    If the value holds no number or several numbers, return NaN. If the value is None, return `other`.
    """
    try:
        return float(other if value is None else np.asarray(value, np.float64).reshape(()))
    except (TypeError, ValueError, OverflowError):
        return math.nan


def rate_of(name: str, value: Any, unit: str = "") -> float | None:
    """Return the sampling rate [Hz] that a number, or a text such as `100 Hz`, states.

    Return None if it states no rate.

    `name`: name of the fact that holds the number or text. `unit`: unit that another fact states for it.
    """
    leaf = re.sub(r"[\s\-]+", "_", name.rpartition(".")[2].rpartition("@")[2].strip().lower())
    found, period = _RATE.fullmatch(leaf), _PERIOD.fullmatch(leaf)
    if found is None and period is None:
        return None
    number = number_of(value)
    if len(texts := texts_of(value)) == 1 and (text := _NUMBER.fullmatch(texts[0])) is not None:
        number, unit = float(text[1]), text[2] or unit
    in_name = (found[1] if found else period and period[1]) or ""
    units = {one.strip().lower() for one in (unit, in_name) if one.strip()}
    if len(units) > 1 or not number > 0:
        return None
    if found is not None:
        number *= PER_S.get(next(iter(units), ""), math.nan)
    else:
        ticks = time_scale(next(iter(units), "s" if period and period[2] else ""))
        number = 1 / (number * SECONDS[ticks[0]] * ticks[1]) if ticks else math.nan
    return number if 0 < number < math.inf else None


def rates_of(facts: Mapping[str, Any]) -> dict[str, float]:
    """Return the sampling rates [Hz] that the file states.

    The key of each rate is the name of the fact that states the rate.
    """
    units = {owner: texts_of(facts[name])[:1] for name, owner in _owners(facts, UNITS)}
    found = {}
    for name, value in facts.items():
        beside = texts_of(facts.get(f"{name.rpartition('@')[0]}@wf_xunit_string")) if "@" in name else []
        unit = next(iter(beside if name.endswith("@wf_increment") else units.get(name, [])), "")
        if (rate_hz := rate_of(name, value, unit)) is not None:
            found[name] = rate_hz
    return found


def units_of(facts: Mapping[str, Any]) -> dict[str, list[str]]:
    """Return the units that the file states for arrays and for groups of arrays.

    The key is the name of the array, or the name of the group followed by a dot. The value is a list of one
    unit, or of one unit for each column.

    A file may state no unit, but the number of counts in 1 deg/s, such as 131. The unit is then `lsb:131`.
    """
    found = {owner: texts for name, owner in _owners(facts, UNITS) if any(texts := texts_of(facts[name]))}
    for name, owner in _owners(facts, COUNTS):
        if (counts := number_of(facts[name])) > 0 and owner not in found:
            found[owner] = [f"lsb:{counts:.17g}"]
    return found


def unit_of(units: Mapping[str, list[str]], label: str, array: str, place: int, width: int) -> str:
    """Return the unit that is stated for a column, or else for its array, or else for the nearest group.

    `label`: name of the column. `place`, `width`: index of the column in its array, and the array's number of
    columns.
    """
    groups = [f"{one}." for one in (array, *around(array), "")]
    by = next((known for known in (label, array, *_of_sensor(units, label), *groups) if known in units), None)
    own = [""] if by is None else units[by]
    unit = own[0] if len(own) == 1 else own[place] if len(own) == width else ""
    unit = unit.partition(" since ")[0]  # netCDF states the unit of times as `seconds since 2023-05-03`
    is_of_all = len(own) == 1 and (by in groups or width > 1)
    return "" if is_of_all and is_time(label.rpartition(".")[2]) and not time_scale(unit) else unit


def _of_sensor(units: Mapping[str, list[str]], label: str) -> Iterator[str]:
    """Yield the keys of `units` that apply to the sensor of a column, in the groups around the column.

    For example, the fact `gyro_units` applies to the column `gx` in the same group: its key is `gyro`.
    """
    axis = axis_of if gyroscopes_in([label]) else accel_axis_of if is_of_accelerometer(label) else None
    is_clock = axis is None and is_time(label.rpartition(".")[2])
    for level in (*around(label), "") if axis or is_clock else ():
        for known in units:
            word = known.removesuffix(".").rpartition(".")[2]
            is_its = is_time(word) if axis is None else axis(f"{word}_x") is not None
            if is_its and group_of(known.removesuffix(".")) == level:
                yield known


class Near:
    """Facts of one kind, such as names of columns, stored by the array or group that they describe."""

    def __init__(self, facts: Mapping[str, Any], words: str) -> None:
        self._found = defaultdict[str, dict[str, Any]](dict)
        for name, owner in _owners(facts, words):
            self._found[owner if "@" in name else f"{group_of(owner)}."][name] = facts[name]

    def of(self, array: str) -> Mapping[str, Any]:
        """Return the facts about an array, and the facts in the group that contains the array."""
        return self._found.get(array, {}) | self._found.get(f"{group_of(array)}.", {})


def columns_of(facts: Mapping[str, Any], array: str, width: int) -> tuple[list[str], str]:
    """Return the names that the file states for an array's columns, and a text on errors in these names.

    The list is empty if the file states no usable names. The text is empty if nothing is wrong.
    """
    for name, owner in _owners(facts, COLUMNS):
        is_own = owner == array
        if width < 2 or not (is_own or owner == f"{array.rpartition('.')[0]}."):
            continue
        texts = texts_of(facts[name])
        if len(texts) == 1:
            texts = list(texts[0]) if len(texts[0]) == width else re.split(r"[\s,;]+", texts[0].strip())
        if any(text[:1] in "+-" for text in texts if len(text) > 1):
            return [], f"{name} names axes with signs ({listed(texts)}), which are not applied here."
        if len(texts) == width == len({*texts}) and all(text.strip() for text in texts):
            return texts, ""
        # in NeXus files, `axes` holds the names of dimensions
        if is_own and len(texts) > 1 and not name.endswith("axes"):
            return [], f"{name} names {len(texts)} columns ({listed(texts)}), and there are {width}."
    return [], ""


def is_of_columns(name: str) -> bool:
    """Return whether a fact of this name (unit, scale or column name) may have one value for each column."""
    return any(_owners({name: None}, f"{UNITS}|{COLUMNS}|{SCALES}"))


def scale_of(
    facts: Mapping[str, Any], array: str, labels: Sequence[str], unit: str, *, is_whole: bool
) -> str:
    """Return a scale or an offset that may have to be applied to an array's numbers.

    It is returned as a text such as `gyro_scale 0.0153`. The text is empty if the file states none.

    `labels`: names of the array's columns. If they are a gyroscope's, a scale such as `gyro_scale` applies.
    `unit`: unit of the columns. `is_whole`: whether the columns hold whole numbers. If they do not, a fact
    called resolution is no scale.
    """
    group, _, leaf = array.rpartition(".")
    is_of_gyro = any(axis_of(label.rpartition(".")[2]) for label in labels)
    for name, owner in _owners(facts, SCALES):
        each = {number_of(one) for one in np.reshape(facts[name], -1)}
        value = each.pop() if len(each) == 1 else math.nan
        is_offset, is_counts = name.lower().endswith("offset"), re.search(rf"(?:{COUNTS})$", name, re.I)
        if value == float(not is_offset) or (is_counts and unit.startswith("lsb:")):
            continue
        if name.lower().endswith("resolution") and not is_whole:
            continue
        of_group, _, of = owner.rpartition(".")
        is_like = leaf.lower().startswith(of.lower()) or (is_of_gyro and axis_of(f"{of}_x"))
        is_beside = of_group == group and (is_like if of else not is_offset)
        is_ours = owner == array if "@" in name else is_beside and not (is_time(leaf) and not of)
        if is_ours and not (is_offset and is_time(leaf)):
            return f"{name} {value:g}" if math.isfinite(value) else f"{name}, which is not one number,"
    return ""


def _owners(facts: Mapping[str, Any], words: str) -> Iterator[tuple[str, str]]:
    """Yield each fact whose name matches `words`, and the name of the array or group that it describes.

    The name of a group ends with a dot.
    """
    for name in facts:
        array, mark, key = name.rpartition("@")
        group, _, leaf = name.rpartition(".")
        outer, _, inner = group.rpartition(".")
        if mark:
            owner = array if re.fullmatch(words, key, re.I) else None
        elif re.fullmatch(words, leaf, re.I):
            owner = f"{group}."
        elif (end := re.fullmatch(rf"(.+?)_(?:{words})", leaf, re.I)) is not None:
            owner = f"{group}.{end[1]}" if group else end[1]
        else:
            owner = f"{outer}.{leaf}".removeprefix(".") if re.fullmatch(words, inner, re.I) else None
        if owner is not None:
            yield name, owner
