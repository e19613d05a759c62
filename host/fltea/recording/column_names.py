"""What the names of columns say, as loggers of all kinds write them: axis, time, unit (pure)."""

import re
from collections.abc import Iterable, Sequence

from fltea.recording.files import LONGEST_NAME
from fltea.records.units import STANDARD_GRAVITY_MS2
from fltea.settings.how import TimeUnit

TIME_UNITS: dict[str, TimeUnit] = {
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds"), "s"),
    **dict.fromkeys(("ms", "msec", "msecs", "millis", "milliseconds", "millisecond"), "ms"),
    **dict.fromkeys(("us", "µs", "μs", "usec", "usecs", "micros", "microseconds", "microsecond"), "us"),
    **dict.fromkeys(("ns", "nsec", "nsecs", "nanos", "nanoseconds", "nanosecond"), "ns"),
}
"""As they are written behind a name, in small letters."""

RATE_UNITS = {
    **dict.fromkeys(
        ("deg/s", "°/s", "º/s", "dps", "degs^-1", "degs-1", "deg/sec", "degps", "deg_s"), "deg/s"
    ),
    **dict.fromkeys(("degree/s", "degrees/s", "deg_per_s", "deg_per_sec", "degrees/sec"), "deg/s"),
    **dict.fromkeys(("mdps", "mdeg/s", "m°/s"), "mdps"),
    **dict.fromkeys(
        (
            "rad/s",
            "rads^-1",
            "rads-1",
            "rad/sec",
            "radps",
            "rad_s",
            "rads",
            "rad_per_s",
            "radians/s",
            "radian/s",
            "radians/sec",
        ),
        "rad/s",
    ),
}
ACCEL_MS2 = {
    **dict.fromkeys(("m/s^2", "m/s2", "m/s²", "m/s/s", "ms^-2", "ms-2", "ms2", "mps2"), 1.0),
    **dict.fromkeys(("g", "gs"), STANDARD_GRAVITY_MS2),
    "mg": 1e-3 * STANDARD_GRAVITY_MS2,
}
"""m/s² in one of each unit."""

OTHER_UNITS = {"c", "°c", "degc", "k", "ut", "µt", "gauss", "pa", "hpa", "v", "mv", "hz", "deg", "rad", "°"}
OTHER_UNITS |= {"lsb", "counts", "raw", "%"}
"""Of columns beside them; a second line of a header has them too."""

TIME_NAMES = {
    "ms",
    "us",
    "time",
    "t",
    "timestamp",
    "timestamps",
    "time_stamp",
    "stamp",
    "ts",
    "times",
    "elapsed",
}
TIME_NAMES |= {
    "elapsed_time",
    "device_time",
    "sensor_time",
    "sample_time",
    "header_stamp",
    "time_since_start",
    "timestamp_sample",
    "seconds_elapsed",
    "datetime",
    "date_time",
    "date",
    "zeit",
    "uhrzeit",
    "datum",
    "zeitstempel",
}

OF_RADS = "SampleTimeFine", "PacketCounter", "seconds_elapsed"
"""Columns of programs that write rad/s without saying so: MT Manager of Xsens, Sensor Logger of phones."""

_PREFIX = r"(?:(?:field|imu\d*|imu_raw|imu_data|data|sensor|raw|board|mpu\d*|icm\d*)_)*"
_LONG = "gyroscope|gyros?|gyr|rotation|rotation_rate|rot_rate|angular_velocity|angular_rate|ang_vel|angvel"
_LONG += "|omega|w_rs_s"
_ACCEL = "accelerometer|acceleration|accel|acc|linear_acceleration|lin_acc|a_rs_s"
_SORT = r"(?:_(?:raw|data|calibrated|uncalibrated|uncal|scaled))?"
_AXIS = re.compile(rf"{_PREFIX}(?:(?:{_LONG}){_SORT}_?|[gw]_?)([xyz])")
_ACCEL_AXIS = re.compile(rf"{_PREFIX}(?:(?:{_ACCEL})_?|a_?)([xyz])")
_NUMBERED = re.compile(rf"{_PREFIX}(?:{_LONG}|gyroadc)(?:_rad)?\[([012])\]")
"""As PX4 and Betaflight call axes."""

_SECONDS = re.compile(r"(.*?)_?(?:secs?|seconds|s)")
_FINE = re.compile(r"(.*?)_?(nanosec(?:ond)?s?|nsecs?|nanos|ns|usecs?|microsec(?:ond)?s?|micros|us)")

_UNIT_BEHIND = re.compile(r"(.+?)\s*(?:\[([^\[\]]*)\]|\(([^()]*)\))")


def known_unit(text: str) -> bool:
    """Whether a field is a unit, of anything that stands in a table of an IMU."""
    bare = bare_unit(text)
    return any(bare in units for units in (TIME_UNITS, RATE_UNITS, ACCEL_MS2, OTHER_UNITS))


def time_unit_of(name: str) -> TimeUnit | None:
    """The unit of times that a name ends in."""
    base, unit = _parts(name)
    if unit:
        return TIME_UNITS.get(bare_unit(unit))
    words = _plain(base).split("_")
    is_said = len(words) > 1 or len(words[0]) > 3 or words[0] in TIME_NAMES
    return TIME_UNITS.get(words[-1]) if is_said else None


def rate_unit_of(name: str) -> str | None:
    """The unit of angular rates that a name ends in."""
    base, unit = _parts(name)
    if unit in ("0", "1", "2"):
        return "rad/s" if base.lower().endswith("_rad") else None
    if unit:
        return RATE_UNITS.get(bare_unit(unit))
    plain = base.strip().lower()
    return next((known for end, known in RATE_UNITS.items() if plain.endswith(f"_{end}")), None)


def are_in_rads(names: Iterable[str]) -> bool:
    """Whether columns are those of a program that writes rates in rad/s without saying so."""
    return any("angular_velocity" in name or name in OF_RADS for name in names)


def is_time(name: str) -> bool:
    """Whether a name is one of times, without a doubt."""
    plain = _plain(_parts(name)[0]).removeprefix("field_").removeprefix("imu_")
    if plain in TIME_NAMES:
        return True
    base, _, end = plain.rpartition("_")
    return (base in TIME_NAMES and end in TIME_UNITS) or (plain in TIME_UNITS and len(plain) > 3)


def split_seconds(names: Sequence[str]) -> dict[int, tuple[int, float]]:
    """Places of whole seconds whose fraction has a column: its place, and seconds in one of its unit."""
    parts: dict[int, tuple[int, float]] = {}
    bases = {}
    for place, name in enumerate(names):
        found = _FINE.fullmatch(_plain(name)) if len(name) <= LONGEST_NAME else None
        if found is not None:
            bases[found[1]] = place, 1e-9 if found[2].startswith("n") else 1e-6
    for place, name in enumerate(names if bases else ()):
        found = _SECONDS.fullmatch(_plain(name)) if len(name) <= LONGEST_NAME else None
        if found is not None and found[1] in bases and bases[found[1]][0] != place:
            parts[place] = bases[found[1]]
    return parts


def axis_of(name: str) -> str | None:
    """The axis, x, y or z, of a gyroscope."""
    numbered = _NUMBERED.fullmatch(_plain(name)) if len(name) <= LONGEST_NAME else None
    return _axis_in(name, _AXIS, RATE_UNITS) if numbered is None else "xyz"[int(numbered[1])]


def named_axis(name: str, axis: int) -> str:
    """The name of an axis, from 0, of an array with three columns: `gyro_dps` has `gyro_x_dps`."""
    base, unit = _parts(name)
    if unit:
        return f"{base}_{'xyz'[axis]} [{unit}]"
    end = _unit_end(name.lower(), (*RATE_UNITS, *ACCEL_MS2))
    return f"{name[: len(name) - len(end)]}_{'xyz'[axis]}{end}"


def accel_axis_of(name: str) -> str | None:
    """The axis, x, y or z, of an accelerometer."""
    return _axis_in(name, _ACCEL_AXIS, ACCEL_MS2)


def _axis_in(name: str, axis: re.Pattern[str], units: Iterable[str]) -> str | None:
    if len(name) > LONGEST_NAME:
        return None
    plain = _plain(_parts(name)[0])
    found = axis.fullmatch(plain.removesuffix(_unit_end(plain, units)))
    return found[1] if found is not None else None


def accel_unit_of(name: str) -> float | None:
    """The unit of specific forces that a name ends in, in m/s²."""
    base, unit = _parts(name)
    return ACCEL_MS2.get(bare_unit(unit) if unit else _unit_end(_plain(base), ACCEL_MS2).removeprefix("_"))


def _unit_end(plain: str, units: Iterable[str]) -> str:
    """The unit that a name ends in, with what separates it."""
    return next((f"_{unit}" for unit in units if plain.endswith(f"_{unit}")), "")


def _parts(name: str) -> tuple[str, str]:
    """A name and the unit in brackets behind it."""
    if len(name) > LONGEST_NAME:
        return name, ""
    found = _UNIT_BEHIND.fullmatch(name.strip())
    return (found[1], found[2] or found[3] or "") if found is not None else (name.strip(), "")


def _plain(name: str) -> str:
    """In small letters, with _ for all that separates words."""
    return re.sub(r"[\s./:\-_]+", "_", name.strip().lower()).strip("_")


def bare_unit(unit: str) -> str:
    """A unit without brackets, blanks and signs of multiplication."""
    return re.sub(r"[\s\[\]()*·]", "", unit.lower())
