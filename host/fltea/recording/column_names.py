"""Finds in a column's name which axis or time it holds and in which unit, as all kinds of loggers write it.

A name consists of words, one of which may be an axis. A unit may stand in brackets before or after the words,
or at their end.
"""

import re
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import NamedTuple

from fltea.recording.files import LONGEST_NAME
from fltea.recording.units import (
    AMBIGUOUS,
    TIME_UNITS,
    accel_unit,
    is_angle,
    is_physical,
    is_unit,
    rate_unit,
    time_scale,
    time_unit,
)
from fltea.settings.how import TimeUnit

_OF_TIME = "time|timestamps?|time_stamp|stamp|elapsed"
_TIMES = "ms|us|t|ts|times|elapsed_time|time_elapsed|time_since_start|timestamp_sample|seconds_elapsed"
_TIMES += "|sample_time_fine|datetime|date_time|date|zeit|uhrzeit|datum|zeitstempel"
_OF_CLOCK = "app|board|device|field|header|host|imu|local|raw|sample|sensor|system|unix"

_NO_SENSOR = r"(?!(?:avg|bias|cov|err|max|mean|min|std|var)\d)"
_PREFIX = r"field|raw|data|sensor|board|device|motion|scaled|highres|imu|shimmer(?:_[\da-f]+)*"
_PREFIX += rf"|{_NO_SENSOR}[a-z]{{2,7}}\d+[a-z]{{0,4}}\d*"
_BEFORE = rf"(?:(?:{_PREFIX})_)*"
"""Matches words before an axis that name a sensor, such as imu0 or lsm6dsox. A word such as std0 or mean0
names a statistic, not a sensor.
"""

_SORT = r"(?:_(?:raw|data|cal|calibrated|uncalibrated|uncal|scaled|adc|unfilt|smooth|ln|wr))*"
_GYRO = "gyroscopes?|gyros?|gyr|(?:gyro_)?rotation_?rate|gyro_rotation|rot_?rate|w_rs_s|avel|omega"
_GYRO += "|angular_?(?:velocity|rate|speed)|ang_?(?:vel|rate)"
_ACCEL = "accelerometers?|(?:accelerometer_)?accelerations?|accel|acc|linear_?acceleration|lin_?acc|a_rs_s"


def _axis(words: str) -> re.Pattern[str]:
    return re.compile(rf"{_BEFORE}(?:{words})(?:_axis)?{_SORT}")


def _sensor(words: str, letters: str) -> re.Pattern[str]:
    """Compile a pattern for the names of a sensor's axes, such as `gyro_x`, `x_gyro` or `gx`.

    `words`: the sensor's names, separated by |. `letters`: its abbreviations of one letter.
    """
    behind, before = rf"(?:{words})\d?{_SORT}_?(?P<x>[xyz])", rf"(?P<before>[xyz])_?(?:{words})"
    return _axis(rf"{behind}|{before}|[{letters}]_?(?P<bare>[xyz])")


_GYRO_AXIS, _ACCEL_AXIS = _sensor(_GYRO, "gw"), _sensor(_ACCEL, "a")
_BARE_AXIS = _axis("(?:(?:as|axis|rate|rotation)_?)?(?P<x>[xyz])")
"""Matches names of axes that may be rates or accelerations. Only the unit shows which of the two they are.
WitMotion calls a rate AsX.
"""

_TIME = re.compile(rf"{_TIMES}|{_BEFORE}(?:(?:{_OF_CLOCK})_)*(?:{_OF_TIME})(?:_formatted)?(?:_unix)?{_SORT}")
_SECONDS = re.compile(r"(.*?)_?(?:secs?|seconds?|s)")
_LONGER = re.compile(r"(.*?)_?(?:(?P<h>h|hh|hrs?|hours?)|m|mm|mins?|minutes?)")
_FINE = re.compile(
    r"(.*?)_?(nanosec(?:ond)?s?|nsecs?|nanos|ns|usecs?|microsec(?:ond)?s?|micros|us"
    r"|millisec(?:ond)?s?|msecs?|millis|ms|frac(?:tion(?:al)?)?(?:_?(?:secs?|seconds?))?|sub_?sec(?:ond)?s?)"
)
_FINE_S = ("n", 1e-9), ("u", 1e-6), ("mic", 1e-6), ("m", 1e-3), ("", 1.0)
"""Units of `_FINE` [s], by the first letters of their names."""

_SENSORS = {
    *("i", "instance", "imu", "sensor", "device", "dev", "node", "id", "mac", "addr", "address", "topic"),
    *("channel", "serial", "serial_number", "device_name", "device_address", "sensor_name"),
    *(f"{of}_{by}" for of in ("imu", "sensor", "device", "node") for by in ("id", "index")),
}

_UNIT_BEHIND = re.compile(
    r"(.*[^\s\[({<])\s*(?:\[([^\[\]]*)\]|\(((?:[^()]|\([^()]*\))*)\)|\{([^{}]*)\}|<([^<>]*)>)"
)
_UNIT_BEFORE = re.compile(r"(?:\[([^\[\]]+)\]|\(([^()]+)\))\s*([^\s\[(].*)")
_AXIS_BEHIND = re.compile(r"(.*[^\s._])[\s._]([xyzXYZ])")
_SEPARATOR = re.compile(r"[\s./:\-_]+")
_HUMP = re.compile(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])")
_MOST_WORDS_OF_UNIT = 4
_INDICES = {"0", "1", "2"}
_CLOCKS = re.compile(
    r"\b(?:utc|gmt|local|unix|epoch|gps|tow|tai|iso|txt|text|string|datetime|date|time)\b|^[+-]\d|yyyy"
)
"""Matches text in brackets after the name of a column of times that states a clock or a format, not a unit.
"""

_BODY_AXES = ("x", "y", "z"), ("p", "q", "r"), ("roll", "pitch", "yaw")
"""Sets of names for the three angular rates. The second and the third set are usual in aviation and for
vehicles.
"""

_NOT_MEASURED = re.compile(
    "(?:.*_)?(?:bias|offset|std|stdev|sigma|var|variance|cov|err|error|noise|target|desired|des|setpoint|sp|ref"
    "|reference|cmd|command|demand|mean|avg|max|min|est|estimated|truth|gt|filtered|filt|lpf)(?:_.*)?"
)
"""Matches names of rates that are not a gyroscope's measurements, such as biases, targets or filtered rates.
"""


class _Name(NamedTuple):
    """A parsed name of a column.

    `base`: name without the unit. `words`: words of `base` in small letters, joined by _. `unit`: unit in the
    name. `is_in_brackets`: whether the name has brackets with a unit, or with the axis as in `gyro[0]`.
    """

    base: str
    words: str
    unit: str
    is_in_brackets: bool


@lru_cache(maxsize=1 << 12)
def _parts(name: str) -> _Name:
    name = name.strip()
    if len(name) > LONGEST_NAME:
        return _Name(name, "", "", is_in_brackets=False)
    if (found := _UNIT_BEHIND.fullmatch(name)) is not None:
        base, unit = found[1], next(filter(None, found.groups()[1:]), "").strip()
        if unit in _INDICES:  # in brackets, Betaflight and PX4 write the axis; PX4 writes _rad for rad/s
            inner = _parts(base)
            stated = "rad/s" if inner.unit == "rad" else inner.unit
            return _Name(base, f"{inner.words}_{'xyz'[int(unit)]}", stated, is_in_brackets=True)
        words = _parts(base).words if base[-1:] == "]" and base[-2:-1] in _INDICES else _plain(base)
        return _Name(base, words, unit, is_in_brackets=True)
    if (found := _UNIT_BEFORE.fullmatch(name)) is not None and is_unit(found[1] or found[2]):
        return _Name(found[3], _plain(found[3]), found[1] or found[2], is_in_brackets=True)
    # here the axis is a field of a structure, as in `gyro_dps.x`
    if (found := _AXIS_BEHIND.fullmatch(name)) is not None:
        inner = _parts(found[1])
        if rate_unit(inner.unit) or accel_unit(inner.unit):
            return inner._replace(base=name, words=f"{inner.words}_{found[2].lower()}")
    for separator in list(_SEPARATOR.finditer(name, 1))[-_MOST_WORDS_OF_UNIT:]:
        unit = name[separator.end() :]
        if rate_unit(unit) or accel_unit(unit) or time_unit(unit) or is_angle(unit):
            base = name[: separator.start()].removesuffix(" in")
            return _Name(base, _plain(base), unit, is_in_brackets=False)
    return _Name(name, _plain(name), "", is_in_brackets=False)


def unit_in(name: str) -> str:
    """Return the unit that a name states, as written; "" if it states none."""
    return _parts(name).unit


def without_unit(name: str) -> str:
    """Return a name without the unit that it states."""
    found = _parts(name)
    return found.base.strip() if found.unit and name.strip() != found.base else name


def time_unit_of(name: str) -> TimeUnit | None:
    """Return the unit of times that a name states, or None."""
    found = _parts(name)
    if found.unit:
        return time_unit(found.unit)
    words = found.words.split("_")
    if len(words) > 1 or len(words[0]) > 3 or _TIME.fullmatch(words[0]):
        return TIME_UNITS.get(words[-1]) or (TIME_UNITS.get(words[0]) if len(words[0]) > 3 else None)
    return None


def time_scale_of(name: str) -> tuple[TimeUnit, float] | None:
    """Return the unit of times that a name states, and a number of such units: for minutes, s and 60.

    Abbreviations of minutes and of longer units are accepted only where they must be units, for instance in
    brackets, since they may mean other things.
    """
    found = _parts(name)
    if found.unit:
        return time_scale(found.unit)
    unit, last = time_unit_of(name), found.words.rpartition("_")[2]
    return (unit, 1.0) if unit else time_scale(last) if len(last) > 3 else None


def counts_unknown(name: str, unit: str) -> str:
    """Return the unit of times that a name or the file states, if fltea does not know that unit; else ""."""
    stated = (unit or unit_in(name)).strip()
    is_clock = ":" in stated or _CLOCKS.search(stated.lower())
    return "" if not stated or is_clock or time_scale(stated) or time_scale_of(name) else stated


def rate_unit_of(name: str) -> str | None:
    """Return the unit of angular rates that a name states, as a key of `units.PER_UNIT`, or None."""
    return rate_unit(_parts(name).unit)


def accel_unit_of(name: str) -> float | None:
    """Return the unit of accelerations that a name states [m/s²], or None."""
    return accel_unit(_parts(name).unit)


def is_time(name: str) -> bool:
    """Return whether a name can be that of a column of times. T can be; `times_in` decides about T."""
    found = _parts(name)
    if is_physical(found.unit) and time_scale(found.unit) is None:
        return False
    base, _, end = found.words.rpartition("_")
    is_unit_at_end = end in TIME_UNITS or (len(end) > 3 and time_scale(end) is not None)
    is_base = is_unit_at_end and _TIME.fullmatch(base) is not None
    return (
        is_base or _TIME.fullmatch(found.words) is not None or (len(end) > 3 and not base and is_unit_at_end)
    )


def times_in(names: Sequence[str]) -> list[str]:
    """Return the names of columns of times.

    T may be a temperature, so a column T is used only if no other column holds times.
    """
    found = [name for name in names if is_time(name)]
    return [name for name in found if name.strip() != "T"] or found


def tells_sensors(name: str) -> bool:
    """Return whether a column of this name distinguishes sensors, provided that it has several values."""
    words = _plain(name) if len(name) <= LONGEST_NAME else ""
    return (
        _plain(name.rpartition(".")[2]) in _SENSORS
        or re.fullmatch("(?:.*_)?header_frame_id", words) is not None
    )


def states_units(name: str) -> bool:
    """Return whether a column of this name states a unit in each row."""
    return len(name) <= LONGEST_NAME and re.fullmatch("(?:.*_)?units?", _plain(name)) is not None


def split_seconds(names: Sequence[str]) -> dict[int, tuple[int, float]]:
    """Return, for each column of whole seconds, the column of their fractions, and the fractions' unit [s].

    The names show which columns belong together, such as `stamp.sec` and `stamp.nanosec`.
    """
    parts: dict[int, tuple[int, float]] = {}
    bases = {}
    for place, name in enumerate(names):
        found = fraction_of_seconds(name)
        if found is not None:
            bases[found[0]] = place, found[1]
    for place, name in enumerate(names if bases else ()):
        base = whole_seconds(name)
        if base is not None and base in bases and bases[base][0] != place:
            parts[place] = bases[base]
    return parts


def fraction_of_seconds(name: str) -> tuple[str, float] | None:
    """Return the rest of a name that can be that of a column of fractions of seconds, and their unit [s].

    None: the name is another one.
    """
    found = _FINE.fullmatch(_with_unit(name))
    if found is None:
        return None
    return found[1], next(s for letter, s in _FINE_S if found[2].startswith(letter))


def whole_seconds(name: str) -> str | None:
    """Return the rest of a name that can be that of a column of seconds, or None."""
    plain = _with_unit(name)
    found = _SECONDS.fullmatch(plain)
    if found is not None:
        return found[1]
    return plain if is_time(name) and time_scale_of(name) is None else None


def minutes_or_hours(name: str) -> tuple[str, float] | None:
    """Return the rest of a name that can be that of a column of minutes or of hours, and their unit [s].

    None: the name is another one.
    """
    found = _LONGER.fullmatch(_with_unit(name))
    return None if found is None else (found[1], 3600.0 if found["h"] else 60.0)


def is_clock_of_seconds(name: str) -> bool:
    """Return whether a name states a clock, and that its unit is seconds."""
    found = _SECONDS.fullmatch(_with_unit(name))
    return found is not None and (not found[1] or _TIME.fullmatch(found[1]) is not None)


def _with_unit(name: str) -> str:
    """Return a name in small letters, and its unit, if that is in brackets, as its last word."""
    if len(name) > LONGEST_NAME:
        return ""
    parts = _parts(name)
    return _plain(f"{parts.words}_{parts.unit}" if parts.is_in_brackets else name)


def axis_of(name: str, unit: str = "") -> str | None:
    """Return the gyroscope axis (x, y or z) that a column's name means, or None.

    `unit`: unit of the column if it is stated elsewhere.
    """
    return _axis_in(name, unit, _GYRO_AXIS, rate_unit)


def axes_in_units(names: Sequence[str], units: Sequence[str]) -> dict[str, int]:
    """Return the columns of the axes x, y and z, recognised by their units.

    The unit of all three is an angular rate, and their names differ only in the axis: `turn_x`, `turn_y`,
    `turn_z`. The result is empty if several such triples exist. `units`: unit of each column, if the file
    has a row of units.
    """
    found: dict[tuple[str, ...], list[tuple[str, int]]] = {}
    for place, name in enumerate(names):
        parts = _parts(name)
        stated = _stated(parts, units[place] if place < len(units) else "")
        is_other = _NOT_MEASURED.fullmatch(parts.words) or _ACCEL_AXIS.fullmatch(parts.words)
        if rate_unit(stated) is None or stated in AMBIGUOUS or is_other:
            continue
        words = parts.words.split("_")
        for letters in _BODY_AXES:
            if len(inside := [word for word in words if word in letters]) == 1:
                alike = letters[0], *(word for word in words if word != inside[0])
                found.setdefault(alike, []).append(("xyz"[letters.index(inside[0])], place))
    triples = [sorted(axes) for axes in found.values() if len(axes) >= 3]
    is_one = len(triples) == 1 and [axis for axis, _ in triples[0]] == ["x", "y", "z"]
    return dict(triples[0]) if is_one else {}


def accel_axis_of(name: str, unit: str = "") -> str | None:
    """Return the accelerometer axis that a column's name means, or None.

    `unit`: unit of the column if it is stated elsewhere.
    """
    return _axis_in(name, unit, _ACCEL_AXIS, accel_unit)


def _axis_in(name: str, unit: str, axis: re.Pattern[str], kind: Callable[[str], object]) -> str | None:
    """Return the axis of a sensor that a column's name means; None if it means none.

    The result is also None if the column's unit is not one of the sensor's. If the unit is clearly one of
    them, the name `x` alone is an axis, too.

    `axis`: matches the names of the sensor's axes. `kind`: function that returns None for other units.
    """
    parts = _parts(name)
    stated = _stated(parts, unit)
    if is_physical(stated) and kind(stated) is None:
        return None
    found = axis.fullmatch(parts.words)
    if found is None and is_physical(stated) and stated not in AMBIGUOUS:
        found = _BARE_AXIS.fullmatch(parts.words)
    return None if found is None else found[found.lastgroup or "x"]


def _stated(parts: _Name, unit: str) -> str:
    return parts.unit if is_physical(parts.unit) else unit


def named_axis(name: str, axis: int) -> str:
    """Return the name of axis number `axis` (from 0) of the array `name`: `gyro_x_dps` for `gyro_dps`."""
    found = _parts(name)
    if found.is_in_brackets and found.unit:
        return f"{found.base}_{'xyz'[axis]} [{found.unit}]"
    return f"{found.base}_{'xyz'[axis]}{name.strip()[len(found.base) :]}"


def _plain(name: str) -> str:
    """Return a name in small letters with _ between its words; `gyroX` becomes `gyro_x`."""
    return _SEPARATOR.sub("_", _HUMP.sub("_", name.strip()).lower()).strip("_")


def common_beginning(names: Sequence[str]) -> str:
    """Return the longest text with which all names begin."""
    first, last = min(names, default=""), max(names, default="")
    same = (k for k, (a, b) in enumerate(zip(first, last, strict=False)) if a != b)
    return first[: next(same, min(len(first), len(last)))]
