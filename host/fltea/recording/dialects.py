"""Recognises the dialect of a file: the form in which a certain logger writes. `dialects.toml` lists all."""

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
"""Matches the beginning of a name, up to and including its last separator: `imu0.` in `imu0.gyro`."""


# Why more than 12 attributes: each is one key of a row of dialects.toml.
class Dialect(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The form and the meaning of one logger's files.

    `name`: name of the logger, for people. `docs`: address of the documentation of the logger's format.
    `guide`: entry in the table of `files.md`. `corpus`: example files in `tests/recording/corpus`, each with
    the options by which it can be read.

    A file is in this dialect if all of these conditions hold, as far as they are given:

    `names`: regular expressions; each matches the whole name of a column.
    `head`: regular expressions; each is found in the lines before the first row (`^` and `$` match at line
    ends).
    `tag`: regular expression that matches the whole first field of a row, in files with rows of several
    kinds.
    `fields`: number of fields in a row, in files without column names.
    `file`: regular expression that is found in the file's name; upper and lower case are the same.

    The dialect states the facts below. A column is given by a regular expression for its whole name, or by
    its position from 1.

    `gyro`: columns of the axes x, y, z; several such triples, the best first.
    `gyro_unit`: unit of these columns in the notation of `--units`; "" if the file states it.
    `gyro_scale`: name of a factor for these columns. The head gives the factor as `NAME,NUMBER`.
    `ask_unit`: if nothing in the file shows the unit: possible units, each with the case in which it applies.
    `accel`, `accel_unit`, `accel_scale`: for the accelerometer, what the three keys of `gyro` state.
    `time`: columns of times, the best first. In `A+B`, A holds seconds and B the nanoseconds to add.
    `time_unit`: unit of the times: s, ms, us or ns. `time_ticks`: number of these units in a step of 1.
    `time_scale`: name of a factor for the times, which the head gives.
    `convention`: whether other loggers use the same names with other units. If so, the numbers are checked.
    `rate`: regular expression for the head; its first group is the sampling rate [Hz].
    `sensor`: column that distinguishes several sensors.
    `no_time`: columns that hold no times, whatever their names suggest.
    `unread`: why such a file holds no gyroscope data; only for dialects that are recognised and not read.
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
    """Return all dialects in the order of the table; a file gets the first dialect that fits."""
    text = files("fltea.recording").joinpath("dialects.toml").read_text(encoding="utf-8")
    return tuple(msgspec.convert(tomllib.loads(text), _Table).dialect)


MOST_NAMES = 1000
"""Largest number of columns of a file that is still compared with the dialects.

Each name is compared with each dialect, which would take too long for more columns.
"""

GRAVITY_TOLERANCE = 0.05
"""If a dialect is recognised only by its number of fields, the length of the accelerations must not differ
from gravity by more than this proportion.
"""


class Facts(NamedTuple):
    """What a file states in addition to the names of its columns.

    `head`: the lines before the column names. `file`: name of the file. `rates`: sampling rates that the file
    states [Hz], each by where it was found, such as `imu.fs`. `sample`: function that returns the first rows
    of all columns (n, width), NaN where there is no number. `units_from`: the kind of evidence for the
    columns' units, and a text that says where the units are stated.
    `beside`: labels of numbers that stand on lines of their own between the rows, such as `temp: 23.1`.
    `cells`: function that returns the texts in the first rows of a column, given the column's index.
    `changed`: columns to which a scale or an offset may still have to be applied, each with a text about it.
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
        """Return the number that the lines in `head` give for a name, as in `tscale,0.001`.

        The result is None if there is no such line.
        """
        found = re.search(rf"^\W*{re.escape(name)}\s*[,:=;\t ]\s*({NUMBER})", self.head, re.M)
        return None if found is None else float(found[1])


@cache
def _of_kind(by_names: bool) -> list[Dialect]:
    """Return the dialects that are recognised by column names, or if `by_names` is false, all others."""
    return [one for one in dialects() if bool(one.names) == by_names]


@cache
def _a_first_name() -> re.Pattern[str]:
    """Return a pattern that matches the first name of each dialect. It quickly rejects most lines."""
    return re.compile("|".join(f"(?:{one.names[0]})" for one in dialects() if one.names))


def dialect_of(names: Sequence[str], facts: Facts, *, tag: str = "", fields: int = 0) -> Dialect | None:
    """Return the dialect of a file; None if the file is in no dialect.

    `names`: names of the columns, or empty. `tag`, `fields`: first field and number of fields of the rows, in
    files without column names.
    """
    if names and not may_be_of_a_dialect((*names, *facts.beside)):
        return None
    return next((one for one in _of_kind(bool(names)) if _is_in(one, names, facts, tag, fields)), None)


def may_be_of_a_dialect(names: Sequence[str]) -> bool:
    """Return whether any of these names is one by which dialects are recognised."""
    return len(names) <= MOST_NAMES and any(map(_a_first_name().fullmatch, names))


def names_kinds(line: str) -> bool:
    """Return whether a line belongs to the head of a dialect in which each row begins with a tag.

    The tag names the kind of the row: `GYRO`, for instance.
    """
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
    """Return whether the accelerations in the dialect's columns have the size of gravity in its unit."""
    values = facts.sample()
    if not one.accel or values.ndim != 2 or values.shape[1] != one.fields or not len(values):
        return False
    length = np.linalg.norm(values[:, [int(place) - 1 for place in one.accel[0]]], axis=1)
    wanted = STANDARD_GRAVITY_MS2 / (accel_unit(one.accel_unit) or math.inf)
    return bool(abs(float(np.median(length)) / wanted - 1) < GRAVITY_TOLERANCE)


def columns_of(triples: Sequence[Sequence[str]], names: Sequence[str], near: str = "") -> tuple[int, ...]:
    """Return the columns that match the first usable triple of patterns; () if no triple is usable.

    A triple is usable if each of its three patterns matches exactly one column. If a pattern matches columns
    of several sensors, the nearest to `near` counts.

    `near`: beginning of the names of the wanted sensor's columns.
    """
    for triple in triples:
        places = [[k for k, name in enumerate(names) if re.fullmatch(one, name)] for one in triple]
        places = [nearest(found, names, near) for found in places]
        if all(len(found) == 1 for found in places):
            return tuple(found[0] for found in places)
    return ()


def nearest(places: Sequence[int], names: Sequence[str], near: str) -> list[int]:
    """Return the columns among `places` whose names have the longest beginning in common with `near`."""
    alike = {place: _shared(names[place], near) for place in places}
    return [place for place in places if alike[place] == max(alike.values())]


def _shared(name: str, near: str) -> int:
    found = _SHARED.match(common_beginning([name, near]))
    return 0 if found is None else found.end()
