"""Dialects: the forms in which loggers write files, from the table `dialects.toml`, and their recognition."""

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
"""Matches the longest beginning that ends with a whole word."""


class Dialect(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The form and the meaning of one logger's files.

    `name`: the logger, for people. `docs`: address of the form's documentation. `guide`: entry in the table
    of
    `files.md`. `corpus`: example files in `tests/recording/corpus`, each with the first options that read it.

    A file is in this dialect if all of these that are given hold:

    `names`: regular expressions; each matches the whole name of a column.
    `head`: regular expressions; each is found in the lines before the first row (`^` and `$` match at line
    ends).
    `tag`: regular expression that matches the whole first field of a row, in files with rows of several
    kinds.
    `fields`: number of fields in a row, in files without names.
    `file`: regular expression that is found in the file's name, in any case.

    The dialect states these facts. Columns are regular expressions of whole names, or positions from 1:

    `gyro`: the axes x, y, z; several such triples, the best first.
    `gyro_unit`: their unit in the notation of `--units`; "" if the names or a row of units state it.
    `gyro_scale`: name of a factor for the numbers, which the head gives as `NAME,NUMBER`.
    `ask_unit`: units that are possible, each with its circumstances, if the file cannot tell the unit.
    `accel`, `accel_unit`, `accel_scale`: the same facts for the accelerometer.
    `time`: columns of times, the best first; `A+B` are seconds and the nanoseconds to add.
    `time_unit`: s, ms, us or ns; `time_ticks`: multiple of this unit; `time_scale`: name of a factor in the
    head.
    `convention`: other loggers use the same names with other units, so these facts are only a convention.
    `rate`: regular expression for the head; its first group is the sampling rate [Hz].
    `sensor`: column that tells several sensors apart.
    `no_time`: columns that are no times, whatever their names are.
    `unread`: reason why the file holds no gyroscope data.
    `note`: warning for the user.
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
    """Return all dialects in the order of the table; the first that fits a file is used."""
    text = files("fltea.recording").joinpath("dialects.toml").read_text(encoding="utf-8")
    return tuple(msgspec.convert(tomllib.loads(text), _Table).dialect)


MOST_NAMES = 1000
"""Most columns in a logger's table.

Files with more columns are not compared with the dialects, since each name is compared with each dialect.
"""

GRAVITY_TOLERANCE = 0.05
"""Tolerance of the length of gravity, for dialects that only the number of fields identifies."""


class Facts(NamedTuple):
    """What a file states in addition to the names of its columns.

    `head`: the lines before the names. `file`: the file's name.
    `rates`: sampling rates [Hz], by what states each, such as `imu.fs`.
    `sample`: returns the first rows of all columns (n, width), with NaN where there is no number.
    `units_from`: evidence and source of the units of the columns.
    `beside`: names on other lines, as boards write them.
    `cells`: returns the texts of a column, by its index, in the same first rows.
    `changed`: columns whose numbers may need a further scale or offset, and which.
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
        """Return the number that the head gives for a name, as in `tscale,0.001`; None if there is none."""
        found = re.search(rf"^\W*{re.escape(name)}\s*[,:=;\t ]\s*({NUMBER})", self.head, re.M)
        return None if found is None else float(found[1])


@cache
def _of_kind(by_names: bool) -> list[Dialect]:
    """Return the dialects that names of columns identify, or the other dialects."""
    return [one for one in dialects() if bool(one.names) == by_names]


@cache
def _a_first_name() -> re.Pattern[str]:
    """Return a pattern of every dialect's first name; a quick test, since most lines match none."""
    return re.compile("|".join(f"(?:{one.names[0]})" for one in dialects() if one.names))


def dialect_of(names: Sequence[str], facts: Facts, *, tag: str = "", fields: int = 0) -> Dialect | None:
    """Return the dialect of a file, or None.

    `names`: names of the columns, or empty. `tag`, `fields`: first field and number of fields of rows without
    names.
    """
    if names and not may_be_of_a_dialect((*names, *facts.beside)):
        return None
    return next((one for one in _of_kind(bool(names)) if _is_in(one, names, facts, tag, fields)), None)


def may_be_of_a_dialect(names: Sequence[str]) -> bool:
    """Return whether any of these names is one of a dialect."""
    return len(names) <= MOST_NAMES and any(map(_a_first_name().fullmatch, names))


def names_kinds(line: str) -> bool:
    """Return whether a line belongs to the head of a dialect with rows of several kinds."""
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
    """Return whether the accelerometer's columns, by position, have the length of gravity in their unit."""
    values = facts.sample()
    if not one.accel or values.ndim != 2 or values.shape[1] != one.fields or not len(values):
        return False
    length = np.linalg.norm(values[:, [int(place) - 1 for place in one.accel[0]]], axis=1)
    wanted = STANDARD_GRAVITY_MS2 / (accel_unit(one.accel_unit) or math.inf)
    return bool(abs(float(np.median(length)) / wanted - 1) < GRAVITY_TOLERANCE)


def columns_of(triples: Sequence[Sequence[str]], names: Sequence[str], near: str = "") -> tuple[int, ...]:
    """Return the columns of the first triple of patterns with one column for each axis, or empty.

    `near`: beginning of the sensor's column names, which decides between the columns of several sensors.
    """
    for triple in triples:
        places = [[k for k, name in enumerate(names) if re.fullmatch(one, name)] for one in triple]
        places = [nearest(found, names, near) for found in places]
        if all(len(found) == 1 for found in places):
            return tuple(found[0] for found in places)
    return ()


def nearest(places: Sequence[int], names: Sequence[str], near: str) -> list[int]:
    """Return the columns whose names share the longest beginning with `near`."""
    alike = {place: _shared(names[place], near) for place in places}
    return [place for place in places if alike[place] == max(alike.values())]


def _shared(name: str, near: str) -> int:
    found = _SHARED.match(common_beginning([name, near]))
    return 0 if found is None else found.end()
