"""Dialects: what loggers write, from a table that is data (`dialects.toml`), and which one a file is in."""

import math
import re
import tomllib
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from importlib.resources import files
from types import MappingProxyType
from typing import NamedTuple

import msgspec
import numpy as np

from fltea.recording.column_names import common_beginning
from fltea.recording.reading import Evidence
from fltea.recording.sample_times import Floats
from fltea.recording.units import accel_unit
from fltea.recording.wanted import NUMBER
from fltea.records.units import STANDARD_GRAVITY_MS2

_SHARED = re.compile(r"(?:.*[\s._/:-])?")
"""Of a beginning, what ends with a whole word."""


class Dialect(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What the files of one logger look like and mean.

    Everything under "recognised" that is given has to hold.

    name: of the logger, for people. docs: where its form is documented. guide: what the table of `files.md`
    says of it. corpus: files of `tests/recording/corpus` that are in it; the first options of each that read
    it.

    Recognised by. names: regular expressions, each of which matches the whole name of a column. head: regular
    expressions, each of which is found in the lines before the first row (`^` and `$` are those of a line).
    tag: a regular expression that matches the whole first field of its rows; files in which rows of several
    kinds stand. fields: how many fields a row has, of files without names. file: a regular expression that is
    found in the name of the file, whatever its case.

    Said by it. Columns are regular expressions of whole names, or positions from 1 where there are no names.
    gyro: the axes x, y, z; several such triples, the best first. gyro_unit: their unit, as `--units` takes
    it; "" where the names or a row of units say it. gyro_scale: the name of a number in the head
    (`NAME,NUMBER`), by which the numbers are multiplied. ask_unit: where the file cannot tell the unit: what
    it may be, and when. accel, accel_unit, accel_scale: the same of the accelerometer. time: the columns of
    times, the best first; `A+B` are seconds and the nanoseconds that are added to them. time_unit: s, ms, us
    or ns; time_ticks: so many of that unit are 1; time_scale: the name of a number in the head. convention:
    others write these names too, in other units: what it says is a convention. rate: a regular expression for
    the head, whose first group is the rate in Hz. sensor: the column that tells several sensors apart.
    no_time: columns that are no times, whatever they are called. unread: why there is no gyroscope in it.
    note: what the user has to know.
    """

    name: str
    docs: str
    guide: str
    corpus: dict[str, str]
    names: tuple[str, ...] = ()
    head: tuple[str, ...] = ()
    tag: str = ""
    fields: int = 0
    file: str = ""
    gyro: tuple[tuple[str, str, str], ...] = ()
    gyro_unit: str = ""
    gyro_scale: str = ""
    ask_unit: dict[str, str] = {}
    accel: tuple[tuple[str, str, str], ...] = ()
    accel_unit: str = ""
    accel_scale: str = ""
    time: tuple[str, ...] = ()
    time_unit: str = ""
    time_ticks: float = 1.0
    time_scale: str = ""
    rate: str = ""
    sensor: str = ""
    convention: bool = False
    no_time: tuple[str, ...] = ()
    unread: str = ""
    note: str = ""


class _Table(msgspec.Struct, forbid_unknown_fields=True):
    dialect: list[Dialect]


@cache
def dialects() -> tuple[Dialect, ...]:
    """Return all dialects, in the order of the table: the first that a file is in is its dialect."""
    text = files("fltea.recording").joinpath("dialects.toml").read_text(encoding="utf-8")
    return tuple(msgspec.convert(tomllib.loads(text), _Table).dialect)


MOST_NAMES = 1000
"""Columns of a table that a logger writes.

A file may hold more names, and each is compared with each dialect.
"""

GRAVITY_TOLERANCE = 0.05
"""Of the accelerometer's length in a dialect that is known by the number of its fields only."""


class Facts(NamedTuple):
    """What a file says beside the names of its columns.

    head: the lines before them. file: its name. rates: sample rates in Hz by what states them, such as
    `imu.fs`. sample: gives the first rows of all columns, (n, width), NaN where there is no number.
    units_from: what says the units that stand beside the names. beside: names that stand on other lines, as
    boards write them. cells: gives what stands in a column, by its place, of the same first rows as it is
    typed. changed: columns whose numbers may still have to be changed, and by what.
    """

    head: str = ""
    file: str = ""
    rates: Mapping[str, float] = MappingProxyType({})
    sample: Callable[[], Floats] = lambda: np.empty((0, 0))
    units_from: tuple[Evidence, str] = ("stated", "the names or the row of units")
    beside: Sequence[str] = ()
    cells: Callable[[int], Sequence[str]] = lambda _: ()
    changed: Mapping[str, str] = MappingProxyType({})

    def number(self, name: str) -> float | None:
        """Return the number that the head gives for a name, as `tscale,0.001`."""
        found = re.search(rf"^\W*{re.escape(name)}\s*[,:=;\t ]\s*({NUMBER})", self.head, re.M)
        return None if found is None else float(found[1])


@cache
def _of_kind(by_names: bool) -> list[Dialect]:
    """The dialects that are known by names of columns, or those that are not."""
    return [one for one in dialects() if bool(one.names) == by_names]


@cache
def _a_first_name() -> re.Pattern[str]:
    """What the first pattern of any dialect matches: most lines of most files hold no such name."""
    return re.compile("|".join(f"(?:{one.names[0]})" for one in dialects() if one.names))


def dialect_of(names: Sequence[str], facts: Facts, *, tag: str = "", fields: int = 0) -> Dialect | None:
    """Return the dialect that a file is in, if it is in one.

    names: of the columns, or none. tag, fields: of rows without names, their first field and how many there
    are.
    """
    if names and not may_be_of_a_dialect((*names, *facts.beside)):
        return None
    return next((one for one in _of_kind(bool(names)) if _is_in(one, names, facts, tag, fields)), None)


def may_be_of_a_dialect(names: Sequence[str]) -> bool:
    """Whether one of some names stands in a dialect."""
    return len(names) <= MOST_NAMES and any(map(_a_first_name().fullmatch, names))


def names_kinds(line: str) -> bool:
    """Whether a line is of the head of a dialect whose rows are of several kinds, before any row has come."""
    return any(re.search(pattern, line) for one in dialects() if one.tag for pattern in one.head)


def _is_in(one: Dialect, names: Sequence[str], facts: Facts, tag: str, fields: int) -> bool:
    if one.tag and not re.fullmatch(one.tag, tag):
        return False
    if not one.names and not one.tag and (one.fields == 0 or one.fields != fields):
        return False
    if one.tag and one.fields not in (0, fields):
        return False
    if not all(any(re.fullmatch(pattern, name) for name in (*names, *facts.beside)) for pattern in one.names):
        return False
    if not all(re.search(pattern, facts.head, re.M) for pattern in one.head):
        return False
    if one.file and not re.search(one.file, facts.file, re.I):
        return False
    return bool(one.names or one.tag or one.head or one.file) or _has_gravity(one, facts)


def _has_gravity(one: Dialect, facts: Facts) -> bool:
    """Whether the accelerometer's columns, by their positions, have the length of gravity in its unit."""
    values = facts.sample()
    if not one.accel or values.ndim != 2 or values.shape[1] != one.fields or not len(values):
        return False
    length = np.linalg.norm(values[:, [int(place) - 1 for place in one.accel[0]]], axis=1)
    wanted = STANDARD_GRAVITY_MS2 / (accel_unit(one.accel_unit) or math.inf)
    return bool(abs(float(np.median(length)) / wanted - 1) < GRAVITY_TOLERANCE)


def columns_of(triples: Sequence[Sequence[str]], names: Sequence[str], near: str = "") -> tuple[int, ...]:
    """Return the places of the first triple of patterns that has one column an axis; none if there is none.

    near: what the names of the sensor begin with, which tells its columns from those of another one.
    """
    for triple in triples:
        places = [[k for k, name in enumerate(names) if re.fullmatch(one, name)] for one in triple]
        places = [nearest(found, names, near) for found in places]
        if all(len(found) == 1 for found in places):
            return tuple(found[0] for found in places)
    return ()


def nearest(places: Sequence[int], names: Sequence[str], near: str) -> list[int]:
    """Return of several columns those that share the most of their names' beginning with a sensor's."""
    alike = {place: _shared(names[place], near) for place in places}
    return [place for place in places if alike[place] == max(alike.values())]


def _shared(name: str, near: str) -> int:
    found = _SHARED.match(common_beginning([name, near]))
    return 0 if found is None else found.end()
