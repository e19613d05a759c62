"""Which columns of a table are meant: by what the user says, or by names that leave no doubt (pure)."""

import re
import shlex
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fltea.recording.column_names import (
    ACCEL_MS2,
    RATE_UNITS,
    TIME_UNITS,
    accel_axis_of,
    accel_unit_of,
    are_in_rads,
    axis_of,
    bare_unit,
    is_time,
    rate_unit_of,
    split_seconds,
    time_unit_of,
)
from fltea.recording.files import TIME_COLUMN, UNITS_HELP, listed, parse_units
from fltea.records.errors import UsageError
from fltea.records.records import AXES
from fltea.settings.how import How, TimeUnit

DECIMAL_COMMA = re.compile(r"[+-]?\d+,\d+([eE][+-]?\d+)?", re.ASCII)
MISSING = ("", "nan", "-nan", "+nan", "na", "n/a", "null", "none")
"""What programs write where they have no number; in small letters."""


class Chosen(NamedTuple):
    """What to read: places from 0 of the axes and of the times (None without), and what they are counted in.

    factor, lsb: as of `parse_units`. time_unit: None if neither the name nor the user says it. accel: places
    of the accelerometer's axes x, y, z, or none; accel_ms2: m/s² in one of their unit. fine: place of what is
    added to whole seconds, fine_s: seconds in one of its unit.
    """

    names: list[str]
    gyro: tuple[int, ...]
    time: int | None
    units: str
    factor: float
    lsb: float | None
    time_unit: TimeUnit | None
    accel: tuple[int, ...] = ()
    accel_ms2: float = 1.0
    fine: int | None = None
    fine_s: float = 0.0

    @property
    def time_name(self) -> str:
        """The column of times."""
        return "" if self.time is None else self.names[self.time]

    @property
    def needed(self) -> tuple[int, ...]:
        """Without which a row is no sample: the axes, then the times."""
        return tuple(place for place in (*self.gyro, self.time, self.fine) if place is not None)

    @property
    def places(self) -> tuple[int, ...]:
        """All that is read."""
        return (*self.needed, *self.accel)

    def scale(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Numbers of the columns that are read, (n, places): in place to deg/s or counts, and m/s²."""
        with np.errstate(over="ignore", invalid="ignore"):
            axes = len(self.gyro)
            values[:, :axes] *= self.factor
            if self.fine is not None:
                values[:, axes] += values[:, axes + 1] * self.fine_s
            if self.accel:
                values[:, len(self.needed) :] *= self.accel_ms2
        return values

    @property
    def read(self) -> list[str]:
        """The names at these places."""
        return [self.names[place] for place in self.places]


class Wanted(NamedTuple):
    """The columns that the user names, or None for those that are known by their names; and that of times."""

    columns: list[str] | None
    time: str | None = None

    @property
    def names(self) -> list[str]:
        """All names that the user gives."""
        return [*(self.columns or ()), *([] if self.time is None else [self.time])]

    @property
    def by_position(self) -> bool:
        """Whether the names are numbers, which count columns from 1."""
        return self.columns is not None and all(map(_is_position, self.names))

    def are_in(self, header: Sequence[str]) -> bool:
        """Whether a line of names has all that is needed."""
        named = all(name in header for name in self.names)
        return named and (self.columns is not None or bool(_axes_of(header)))

    def are_at(self, fields: Sequence[str]) -> bool:
        """Whether a line without a header is a row: by the positions, or since it has no other columns."""
        if self.by_position:
            found = [fields[p - 1] for p in map(int, self.names) if p <= len(fields)]
            return (
                len(found) == len(self.names)
                and any(map(is_number, found))
                and all(is_number(field) or is_missing(field) for field in found)
            )
        alike = self.columns is not None and len(fields) == len(self.columns)
        return self.time is None and alike and all(map(is_number, fields))

    def lacking(self, header: Sequence[str] | None, line: str = "") -> str:
        """What is not in a header, or in a `line` that is none; it has not all that is needed."""
        lacking = [name for name in self.names if header is None or name not in header]
        has = f"no header{line}" if header is None else listed(header)
        if self.columns is None and not (lacking and header):
            yours = "say which are yours by their positions" if header is None else "name yours"
            known = "no columns with names of a gyroscope, such as gyro_x_dps"
            return f"{known}; {yours} with --columns (it has: {has})"
        return f"no column {', '.join(lacking)} (it has: {has})"


def wanted_of(how: How) -> Wanted:
    """What the user names.

    Raises:
        UsageError: more columns than a gyroscope has axes, or one of them twice.
    """
    if how.columns is not None and len(how.columns) > len(AXES):
        raise UsageError(
            f"--columns names {len(how.columns)} columns; a gyroscope has up to {len(AXES)} axes."
        )
    wanted = Wanted(how.columns, how.time_column)
    twice = {name for name in wanted.names if wanted.names.count(name) > 1}
    if twice:
        raise UsageError(f"--columns, --time-column: {', '.join(sorted(twice))} is named twice.")
    return wanted


def choose(
    where: str, names: Sequence[str] | None, units: Sequence[str] | None, width: int, how: How
) -> Chosen:
    """Find the columns that are meant.

    where: for messages, the file and, where there is one, the line of the names. names: of all columns; None:
    they have none, and there are `width`. units: of each, where a line of them follows the names.

    Raises:
        UsageError: a column is not there, or twice, its unit is not known or another than the given one, or
            neither a rate is given nor a column of times is there.
    """
    wanted = wanted_of(how)
    labels = list(names or ())
    if names is None or not wanted.are_in(names):
        labels = _by_position(where, names, width, wanted)
        names = names if wanted.by_position and names is not None and len(names) == width else labels
    axes = wanted.columns or _axes_of(labels)
    for name in (*axes, *([wanted.time] if wanted.time is not None else [])):
        if labels.count(name) > 1:
            raise UsageError(
                f"{where}: {labels.count(name)} columns are called {name}, and which is meant is not known. "
                "Give them different names."
            )
    gyro = tuple(labels.index(name) for name in axes)
    beside = [units[place] if units is not None and place < len(units) else "" for place in range(len(names))]
    unit = _unit_of(where, [names[p] for p in gyro], [beside[p] for p in gyro], how, are_in_rads(names))
    factor, lsb = parse_units(unit)
    time = _time_of(where, names, how) if wanted.time is None else labels.index(wanted.time)
    if how.rate_hz is None and time is None:
        raise UsageError(
            f"{where}: has no column '{TIME_COLUMN}' or another whose name says times, so give its rate: "
            f"--rate 100, or name the column: --time-column NAME --time-unit ms (it has: {listed(names)})."
        )
    time_unit = how.time_unit
    if time is not None:
        stated = TIME_UNITS.get(bare_unit(beside[time])) or time_unit_of(names[time])
        if stated is not None and time_unit not in (None, stated):
            raise UsageError(
                f"{where}: the column {listed([names[time]])} is in {stated} by its name or line of units, "
                f"and --time-unit {time_unit} says otherwise. Leave --time-unit out, or mend the header."
            )
        time_unit = time_unit or stated
    fine, fine_s = None, 0.0
    if time is not None and time in (parts := split_seconds(names)):
        fine, fine_s = parts[time]
        time_unit = "s"
    accel, accel_ms2 = _accel_of(names, beside)
    if {*gyro, time} & {*accel}:
        accel = ()
    return Chosen(list(names), gyro, time, unit, factor, lsb, time_unit, accel, accel_ms2, fine, fine_s)


def _axes_of(names: Sequence[str]) -> list[str]:
    """Names of the axes x, y, z: ours, else those that other programs use; none if two are of one axis."""
    ours = [f"{axis}_dps" for axis in AXES if f"{axis}_dps" in names]
    if ours:
        return ours
    found: dict[str, str] = {}
    for name in names:
        axis = axis_of(name)
        if axis is not None and found.setdefault(axis, name) != name:
            return []
    return [found[axis] for axis in "xyz" if axis in found]


def _accel_of(names: Sequence[str], beside: Sequence[str]) -> tuple[tuple[int, ...], float]:
    """Places of an accelerometer's axes x, y, z, and m/s² in their unit; none unless all is clear."""
    found: dict[str, list[int]] = {axis: [] for axis in "xyz"}
    for place, name in enumerate(names):
        axis = accel_axis_of(name)
        if axis is not None:
            found[axis].append(place)
    if any(len(places) != 1 for places in found.values()):
        return (), 1.0
    accel = tuple(places[0] for places in found.values())
    units = {accel_unit_of(names[place]) or ACCEL_MS2.get(bare_unit(beside[place])) for place in accel}
    unit = units.pop()
    return ((), 1.0) if units or unit is None else (accel, unit)


def _unit_of(where: str, names: list[str], beside: list[str], how: How, in_rads: bool) -> str:
    found = {
        rate_unit_of(name) or RATE_UNITS.get(bare_unit(unit))
        for name, unit in zip(names, beside, strict=True)
    }
    if how.units is not None:
        given = parse_units(how.units)
        denied = [unit for unit in found if unit is not None and parse_units(unit) != given]
        if denied:
            raise UsageError(
                f"{where}: the columns {listed(names)} are in {denied[0]} by their names or line of units, "
                f"and --units {how.units} says otherwise. Leave --units out, or mend the header."
            )
        return how.units
    if len(found) > 1:
        raise UsageError(
            f"{where}: the columns {listed(names)} are not all of one unit; say which: --units dps; "
            f"known are {UNITS_HELP}."
        )
    unit = found.pop()
    if unit is None:
        likely, other = ("rad/s", "dps") if in_rads else ("dps", "rad/s")
        raise UsageError(
            f"{where}: nothing says the unit of {listed(names)}, so give it: --units {likely}, or {other}, "
            "mdps, or lsb:N for counts of which N are 1 deg/s by the data sheet, such as lsb:131. ROS, "
            "phones and newer Adafruit libraries give rad/s."
        )
    return unit


def _time_of(where: str, names: Sequence[str], how: How) -> int | None:
    if parts := split_seconds(names):
        return next(iter(parts))
    found = [TIME_COLUMN] if TIME_COLUMN in names else [name for name in names if is_time(name)]
    if not found:
        return None
    if len(found) > 1:  # a date beside a time of day; and phones' own count of seconds beside their clock
        found = (
            [name for name in found if name.lower() == "seconds_elapsed"]
            or [name for name in found if name.lower().endswith("header.stamp")]  # rostopic echo -p
            or [name for name in found if name.lower() not in ("date", "datum")]
        )
    if (len(found) > 1 or names.count(found[0]) > 1) and how.rate_hz is None:
        raise UsageError(
            f"{where}: {listed(found)} are times by their names; say which is meant: "
            f"--time-column {shlex.quote(found[0])}."
        )
    return list(names).index(found[0])


def _by_position(where: str, names: Sequence[str] | None, width: int, wanted: Wanted) -> list[str]:
    """Columns called by their positions from 1, or by what the user calls them if there are no others."""
    if wanted.by_position:
        beyond = [name for name in wanted.names if int(name) > width]
        if beyond:
            raise UsageError(f"{where}: no column {', '.join(beyond)} (it has {width}, without names).")
        return [str(place + 1) for place in range(width)]
    if names is None and wanted.columns is not None and wanted.time is None and width == len(wanted.columns):
        return wanted.columns
    if names is None:
        raise UsageError(
            f"{where}: the {width} columns have no names; say which are the axes by their positions, from 1: "
            "--columns 1,2,3."
        )
    raise UsageError(f"{where}: {wanted.lacking(names)}.")


def _is_position(name: str) -> bool:
    return name.isascii() and name.isdecimal() and int(name) >= 1


def is_number(field: str) -> bool:
    """Whether a field holds a number, with a decimal point or comma."""
    field = field.strip().strip('"').strip()
    if DECIMAL_COMMA.fullmatch(field):
        return True
    try:
        float(field)
    except ValueError:
        return False
    return "_" not in field and field.isascii()


def is_missing(field: str) -> bool:
    """Whether a field is what programs write where they have no number."""
    return field.strip().strip('"').strip().lower() in MISSING
