"""Reads lines that name each number: JSON objects, and numbers with labels, as boards print them.

`gx:1.2,gy:3.4` has a label for each number. `Gyro X: 1.2 Y: 3.4 Z: 5.6 rad/s` has one word (the group) before
the labels, and one unit after the numbers. `Gyr (DPS) [ 0.1, 0.2, 0.3 ]` has one label for three numbers.
"""

import re
from collections.abc import Mapping
from typing import Any, NamedTuple

import msgspec

from fltea.recording.column_names import accel_axis_of, axis_of, is_time, named_axis
from fltea.recording.readers.file_facts import unit_of, units_of
from fltea.recording.units import accel_unit, is_unit, rate_unit, time_scale
from fltea.recording.wanted import NUMBER
from fltea.records.records import AXES

LONGEST_LABEL = 80
"""Longest label of a number, with its group and unit [characters]. The limit keeps the search for labels
fast.
"""

COMMA = r"[-+]?\d+,\d+(?=[\s;|]|$)"
_PAIR = re.compile(
    rf"(?P<label>[^\W\d][^:=,;|\t\[\]{{}}\"]{{0,{LONGEST_LABEL}}}?)\s*(?:[:=]\s*\[?|\[)\s*"
    rf"(?P<first>{COMMA}|(?>{NUMBER})(?![\d,.]*:))"
    rf"(?:\s*[,\s]\s*(?P<second>{NUMBER})\s*[,\s]\s*(?P<third>{NUMBER})(?![\w:=.]|\s*[,\s]\s*[-+\d]))?\s*\]?"
)
_MARK = re.compile(r"[:=\[]\s*\[?\s*[-+.\d]")
"""Matches in every line in which `_PAIR` does, and takes much less time for lines without labels."""
_UNIT_BEHIND = re.compile(r"[\s)}]*\(?([^\s,;|\])(]+(?: per [a-z]+)?)\)?")
_GROUP_BEFORE = re.compile(r"([^\W\d][\w .]*?)\s*(?:[\[(]([^\[\]()]*)[\])])?\s*[:=]\s*(?:\w*\s*[({\[])?\s*$")
"""Matches the name of the group in `Gyro (dps): X: 1.2`, `Gyro: (x=1.2`, and `gyro=Vector3(x=1.2`."""
_AXES = ("x", "y", "z")
_AXIS = re.compile(r"[._ ]?[xyz]$", re.I)


_decode = msgspec.json.Decoder(dict[str, Any]).decode
DEEPEST = 4
"""Largest number of levels to which JSON objects in a line are read."""


def decode_object(line: str | bytes) -> dict[str, Any]:
    """Read a JSON object. The name `x` in a nested object `gyro` becomes `gyro.x`.

    The numbers in a list of three get the names `gyro_x`, `gyro_y` and `gyro_z`.

    Raises:
        ValueError: the line is no JSON object.
    """
    return flat(_decode(line))


def flat(found: dict[str, Any]) -> dict[str, Any]:
    """Return the values in an object and its nested objects, by the names that `decode_object` gives."""
    if any(type(value) in (dict, list) for value in found.values()):
        inner: dict[str, Any] = {}
        _flatten("", found, inner, DEEPEST)
        return inner
    return found


def _flatten(name: str, value: Any, flat: dict[str, Any], depth: int) -> None:
    if isinstance(value, dict) and depth:
        for key, inner in value.items():
            _flatten(f"{name}.{key}" if name else key, inner, flat, depth - 1)
    elif isinstance(value, list) and len(value) == len(AXES):
        flat.update((named_axis(name, axis), inner) for axis, inner in enumerate(value))
    else:
        flat[name] = value


def units_beside(found: Mapping[str, Any]) -> list[str]:
    """Return the unit of each name in an object.

    A text in the object may state the unit, else the unit is "".
    """
    units = units_of(found)
    return [_fitting(name, unit_of(units, name, without_axis(name), 0, 1)) if units else "" for name in found]


def without_axis(name: str) -> str:
    """Return a name without its axis: `gyro` for `gyro.x` and for `gyro_x`."""
    return _AXIS.sub("", name)


def _fitting(name: str, unit: str) -> str:
    """Return `unit` if it is a unit of the quantity that `name` means, else "".

    This check is needed because an object may state only one unit for a sensor, which may be that of another
    quantity in the object.
    """
    is_rate = axis_of(name, unit) and (rate_unit(unit) or unit.startswith("lsb:"))
    is_other = (accel_axis_of(name, unit) and accel_unit(unit)) or (is_time(name) and time_scale(unit))
    return unit if is_rate or is_other else ""


class Labelled(NamedTuple):
    """The numbers in a line by their names, and the units of these numbers by the same names.

    A unit is "" if the line states none.
    """

    values: dict[str, float]
    units: dict[str, str]


def labelled(line: str) -> Labelled | None:
    """Return the labelled numbers in a line, or None if it has none."""
    if _MARK.search(line) is None:
        return None
    values: dict[str, float] = {}
    units: dict[str, str] = {}
    members: list[str] = []
    group, end = "", 0
    for found in _PAIR.finditer(line):
        text, start = found["label"], found.start()
        # the text before a bracket is the name of the group to which the numbers belong
        if text.count("(") > text.count(")"):
            start += text.rfind("(") + 1
            text = text.rpartition("(")[2]
        before = _GROUP_BEFORE.search(line[max(end, start - LONGEST_LABEL) : start])
        words = text.split() or [""]
        # in "X: 1.2 rad/s Y: 3.4", the label found for 3.4 begins with the unit of 1.2
        while members and len(words) > 1 and is_unit(words[0]):
            units.update(dict.fromkeys(members, words.pop(0)))
        unit = ""
        if len(words) > 1 and words[-1][0] in "([":
            unit = words.pop().strip("()[]")
        label = " ".join(words)
        if before is not None:
            group, members, unit = before[1].split()[-1], [], unit or before[2] or ""
        if label.lower() in _AXES and group:
            label = f"{group} {label}"
        elif label.lower() not in _AXES:
            is_axis = len(words) > 1 and words[-1].lower() in _AXES
            group, members = (" ".join(words[:-1]) if is_axis else ""), []
            label = " ".join(words) if is_axis else words[-1]
        names = [label] if found["third"] is None else [f"{label} {axis}" for axis in _AXES]
        for name, text in zip(names, found.group("first", "second", "third"), strict=False):
            values[name], units[name] = float(text.replace(",", ".")), unit or units.get(name, "")
        members += [name for name in names if name not in members]
        end = found.end()
        behind = _UNIT_BEHIND.match(line, end)
        if behind is not None and is_unit(behind[1]):
            units.update(dict.fromkeys(members, behind[1]))
    return Labelled(values, units) if values else None


def values_in(line: str) -> dict[str, float]:
    """Return the numbers in a line by their names."""
    found = labelled(line)
    return {} if found is None else found.values
