"""Dialects: what loggers write, from a table that is data (`dialects.toml`), and which one a file is in."""

import re
import tomllib
from collections.abc import Sequence
from functools import cache
from importlib.resources import files

import msgspec


class Dialect(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What the files of one logger look like and mean. Everything under "recognised" that is given has to hold.

    name: of the logger, for people. docs: where its form is documented. guide: what the table of `files.md`
    says of it. corpus: files of `tests/recording/corpus` that are in it; the first options of each that read it.

    Recognised by. names: regular expressions, each of which matches the whole name of a column. head: regular
    expressions, each of which is found in the lines before the first row (`^` and `$` are those of a line).
    tag: a regular expression that matches the whole first field of its rows; files in which rows of several
    kinds stand. fields: how many fields a row has, of files without names. file: a regular expression that is
    found in the name of the file, whatever its case.

    Said by it. Columns are regular expressions of whole names, or positions from 1 where there are no names.
    gyro: the axes x, y, z; several such triples, the best first. gyro_unit: their unit, as `--units` takes it;
    "" where the names or a row of units say it. gyro_scale: the name of a number in the head (`NAME,NUMBER`),
    by which the numbers are multiplied. ask_unit: where the file cannot tell the unit: what it may be, and
    when. accel, accel_unit, accel_scale: the same of the accelerometer. time: the columns of times, the best
    first. time_unit: s, ms, us or ns; time_ticks: so many of that unit are 1; time_scale: the name of a number
    in the head. rate: a regular expression for the head, whose first group is the rate in Hz. sensor: the
    column that tells several sensors apart. no_time: columns that are no times, whatever they are called.
    unread: why there is no gyroscope in it. note: what the user has to know.
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
