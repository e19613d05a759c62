"""Defines tables of named columns, which are made from files of any format, and makes recordings from them.

A new file format needs one module in `readers` whose `read` returns a `Sheet`, and a row in `formats`.
"""

import math
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from itertools import zip_longest
from pathlib import Path
from typing import NamedTuple

import msgspec
import numpy as np
from msgspec.structs import replace

from fltea.recording.column_names import axis_of, times_in
from fltea.recording.columns import Chosen, choose
from fltea.recording.dialects import Facts, columns_of, dialect_of
from fltea.recording.files import Note, Stored, listed
from fltea.recording.groups import (
    around,
    group_of,
    gyroscopes_in,
    is_of_accelerometer,
    short_names,
    tells_gyroscope,
    with_clocks,
)
from fltea.recording.npz_arrays import NUMBER_BYTES
from fltea.recording.one_sensor import OneSensor, as_word
from fltea.recording.reading import Answer, Evidence, Missing, asked_with, given_options, not_stated
from fltea.recording.sample_times import Floats
from fltea.recording.table import Rows, gather, row_place
from fltea.recording.turns import Turns
from fltea.recording.wanted import place_of
from fltea.records.errors import UsageError
from fltea.settings.how import How
from fltea.settings.limits import Limits

SAMPLE_ROWS, MOST_SAMPLED = 60, 64
"""To choose the columns to read, this number of a table's first rows, and of its first columns, are examined.
"""

FEW = 10
"""An array with fewer rows than this is taken as a calibration, not as samples, if the file also holds longer
arrays.
"""

RATE_TOLERANCE = 0.01
"""Two statements of a sampling rate agree if their relative difference is at most this. The clocks of sensors
are wrong by about 5 ‰ at most.
"""


# Why more than 12 attributes: each is a fact about the table. The reader process sends all as one message.
class SheetHead(msgspec.Struct, frozen=True):
    """Everything that a table in a file holds, except its rows.

    `names`: names of the columns, each after the groups that contain the column: `imu.gyro_x`. `units`: unit
    of each column, "" if the file states none. `rows`: length of the longest column. `lengths`: length of
    each column; empty if all are equal. `arrays`: name of the array that contains each column; empty if each
    column is an array of its own. `stamps`: columns of dates, which are converted to seconds since the first
    date. `rates`: stated sampling rates [Hz]. The key is the name of the fact that states the rate: `imu.fs`
    applies to all columns in `imu`, and `imu.gyro@fs` to one array. `doubts`: reasons why the numbers of
    columns may be wrong.
    `changed`: for each column whose numbers may need a further scale or offset, a text that says so. `topic`:
    the sensor that is read if the file holds several sensors, else "". `sample`: first rows of the first
    columns, null where there is no number. `words`: columns of words that distinguish sensors are stored as
    numbers; here are, for each such column, the words that the numbers 0, 1, … stand for.
    """

    names: list[str]
    units: list[str]
    rows: int
    lengths: list[int] = []
    arrays: list[str] = []
    stamps: tuple[str, ...] = ()
    rates: dict[str, float] = {}
    doubts: dict[str, str] = {}
    changed: dict[str, str] = {}
    unit_evidence: tuple[Evidence, str] = ("stated", "the names or the units beside them")
    notes: tuple[Note, ...] = ()
    topic: str = ""
    sample: list[list[float | None]] = []
    words: dict[str, list[str]] = {}

    def called(self, place: int, values: Sequence[float]) -> list[str]:
        """Return numbers of a column as texts.

        If the number stands for a word, the text is this word. Otherwise the text is the number in digits.
        """
        words = self.words.get(self.names[place])
        return [words[int(v)] if words and 0 <= v < len(words) else as_word(v) for v in values]

    def length(self, place: int) -> int:
        """Return the number of rows of the column with the index `place`."""
        return self.lengths[place] if self.lengths else self.rows


class Sheet(SheetHead, frozen=True, kw_only=True):
    """A table with its rows.

    `blocks`: function that yields the rows of the given columns in blocks (n, columns).
    """

    blocks: Callable[[Sequence[int]], Iterator[Floats]]

    def only(self, called: Mapping[int, str]) -> "Sheet":
        """Return a table of some columns. `called`: new name of each column to keep, by its index."""
        blocks, keep = self.blocks, list(called)
        names = {self.names[place]: name for place, name in called.items()}
        return replace(
            self,
            names=list(called.values()),
            units=[self.units[place] for place in keep],
            rows=max(self.length(place) for place in keep),
            lengths=[self.length(place) for place in keep],
            arrays=[self.arrays[place] for place in keep] if self.arrays else [],
            stamps=tuple(names[name] for name in self.stamps if name in names),
            doubts={names[name]: why for name, why in self.doubts.items() if name in names},
            changed={names[name]: why for name, why in self.changed.items() if name in names},
            words={names[name]: words for name, words in self.words.items() if name in names},
            sample=[[row[p] if p < len(row) else None for p in keep] for row in self.sample],
            blocks=lambda places: blocks([keep[place] for place in places]),
        )


class TextHead(msgspec.Struct, frozen=True):
    """Facts about a file that is not a text, such as a workbook, and is converted to text before it is read.

    `topic`: name of the part of the file, such as a sheet, that the user chose. `parts`: names of the parts
    from which the user has to choose. `head`: lines of other parts of the file, which describe the part that
    is read.
    """

    topic: str = ""
    parts: list[str] = []
    head: list[str] = []


class Text(TextHead, frozen=True, kw_only=True):
    """The text of one part of a file. `pieces`: function that yields the text in pieces of whole lines."""

    pieces: Iterator[bytes]


def with_sample(sheet: Sheet) -> Sheet:
    """Return the table with its first rows in the field `sample`."""
    columns: list[list[float | None]] = []
    for place in range(min(len(sheet.names), MOST_SAMPLED)):
        try:
            values = next(iter(sheet.blocks([place])))[:SAMPLE_ROWS, 0]
            columns.append([float(value) if np.isfinite(value) else None for value in values])
        except (UsageError, ValueError, StopIteration):
            columns.append([])
    return replace(sheet, sample=[list(row) for row in zip_longest(*columns)])


def open_sheet(path: Path, sheet: Sheet, how: How, limits: Limits) -> Stored:
    """Read the columns of a gyroscope.

    Raises:
        UsageError: the columns are ambiguous or differ in length, two rates contradict each other, or
            `table.gather` refuses the rows.
    """
    where, asked = str(path), how.topic
    sheet, chosen, how = _choose(where, sheet, _by_names(sheet.names, how))
    _check_columns(where, sheet, chosen, how)
    size_bytes = sheet.rows * len(chosen.places) * NUMBER_BYTES
    if size_bytes > limits.whole_bytes:
        raise limits.whole_too_large(f"{path}: declares {sheet.rows} rows", size_bytes)
    rows = _rows(where, sheet, chosen, how)
    rows = _in_turn(rows, chosen) if chosen.turn[1] > 1 else rows
    stored = gather(path, chosen, rows, limits, partial(row_place, path))
    if chosen.time is not None and how.rate_hz is None:
        _check_rate(where, sheet, f"the times of {listed([chosen.time_name])} say", stored.rate_hz, how)
    answers = (Answer("sensor", sheet.topic, "given", "--sensor"),) if asked and sheet.topic else ()
    reading = (*answers, *stored.reading)
    return stored._replace(notes=(*stored.notes, *sheet.notes), topic=sheet.topic, reading=reading)


def _by_names(names: Sequence[str], how: How) -> How:
    """Return the user's options.

    Where the user gave the position of a column, or its name without the unit, its name is put in place.
    """

    def named(one: str) -> str:
        if (place := place_of(one, names)) is not None:
            return names[place]
        known = one not in names and one.isdecimal() and 1 <= int(one) <= len(names)
        return names[int(one) - 1] if known and names.count(names[int(one) - 1]) == 1 else one

    columns = None if how.columns is None else [named(one) for one in how.columns]
    return replace(how, columns=columns, time_column=how.time_column and named(how.time_column))


def _choose(where: str, sheet: Sheet, how: How) -> tuple[Sheet, Chosen, How]:
    """Return a table of one gyroscope's columns, the columns chosen among them, and the user's options.

    Two options may be changed. The sensor's name is removed, since only this sensor's columns are left. If
    neither an option nor a column's name tells the column of times, and there is one column of dates, this
    column becomes the option.
    """
    sheet = of_one_gyroscope(where, sheet, how)
    how = replace(how, topic=None) if sheet.topic else how
    names = sheet.names
    has_times = how.time_column is not None or bool(times_in(names))
    if not has_times and len(sheet.stamps) == 1:
        how = replace(how, time_column=sheet.stamps[0])
    times = [] if how.rate_hz or sheet.rates else times_in(names)
    if times and all(name in sheet.doubts for name in times):
        raise UsageError(f"{where}: {times[0]}: {sheet.doubts[times[0]]} Say the rate: --rate ?")
    _check_rate(where, sheet, "--rate says", how.rate_hz, how)
    units = [("s" if name in sheet.stamps else unit) for name, unit in zip(names, sheet.units, strict=True)]
    return sheet, choose(where, names, units, len(names), how, _facts(where, sheet)), how


def _facts(where: str, sheet: Sheet) -> Facts:
    topic = sheet.topic if ":" in sheet.topic else f"{sheet.topic}:0"
    # tools that convert logs name a topic's file by the topic's name and number, as in sensor_gyro_0
    file = f"{Path(where).name} {topic.replace(':', '_')}"
    rates = {name.replace(".", "/"): rate_hz for name, rate_hz in sheet.rates.items()}

    def first() -> Floats:
        return np.array(sheet.sample, np.float64)

    def cells(place: int) -> list[str]:
        values = [row[place] if place < len(row) else None for row in sheet.sample]
        return sheet.called(place, [math.nan if value is None else value for value in values])

    return Facts("", file, rates, first, sheet.unit_evidence, changed=sheet.changed, cells=cells)


def _in_turn(rows: Iterator[Rows], chosen: Chosen) -> Iterator[Rows]:
    """Yield the rows of the chosen sensor. `rows`: rows of several sensors, which alternate."""
    turns = Turns(*chosen.turn, chosen.time_at)
    for some in rows:
        yield from turns.take(some)
    yield from turns.finish()


def _rows(where: str, sheet: Sheet, chosen: Chosen, how: How) -> Iterator[Rows]:
    """Yield the rows of one sensor, numbered from 0. Rows of other sensors are not counted."""
    row = ordinal = 0
    places, sensor = chosen.places, None
    if chosen.sensor is not None:
        place, value = chosen.sensor
        places, sensor = (*places, place), OneSensor(where, sheet.names[place], value, given_options(how))
    for values in sheet.blocks(places):
        numbers = np.arange(row, row + len(values))
        row += len(values)
        if sensor is not None:
            kept = sensor.keep(sheet.called(place, values[:, -1].tolist()))
            values, numbers = np.ascontiguousarray(values[kept, :-1]), numbers[kept]
        yield Rows(numbers, chosen.scale(values), np.arange(ordinal, ordinal := ordinal + len(values)))
    if sensor is not None and (error := sensor.why_none()) is not None:
        raise error


def _check_rate(where: str, sheet: Sheet, who: str, rate_hz: float | None, how: How) -> None:
    """Raise UsageError if `rate_hz` differs from a sampling rate that the file states.

    `who`: what gives `rate_hz`, for messages.
    """
    for name, stated_hz in sheet.rates.items() if not how.overrule else ():
        if rate_hz is not None and abs(rate_hz / stated_hz - 1) > RATE_TOLERANCE:
            raise UsageError(
                f"{where}: {listed([name])} says {stated_hz:g} Hz, and {who} {rate_hz:.6g} Hz. Leave "
                "--rate out, or if the file is wrong, say which is right: --rate ? --overrule"
            )


def _check_columns(where: str, sheet: Sheet, chosen: Chosen, how: How) -> None:
    """Raise UsageError if the columns differ in length, or if their numbers may be wrong."""
    lengths = [sheet.length(place) for place in chosen.places]
    if len({*lengths}) > 1:
        each = ", ".join(f"{name} {rows}" for name, rows in zip(chosen.read, lengths, strict=True))
        raise UsageError(
            f"{where}: the columns that are read differ in length ({each}), so it is not known which of "
            "their numbers belong together. Mend the file, or name columns of equal length with --columns."
        )
    sensor = [] if chosen.sensor is None else [sheet.names[chosen.sensor[0]]]
    for name in chosen.read:
        if name in sheet.words:
            raise UsageError(
                f"{where}: {name}: holds words ({listed(sheet.words[name])}) instead of numbers."
            )
    for name in () if how.overrule else [*({*sensor} - sheet.words.keys()), *chosen.read]:
        if name in sheet.doubts:
            raise UsageError(f"{where}: {name}: {sheet.doubts[name]}")


class _Gyroscope(NamedTuple):
    """The gyroscope's axes that are read.

    `places`: columns of the axes. `group`: path of the group that contains the sensor: `imu` for
    `imu.gyro.x`. `others`: groups of other gyroscopes. `topic`: name of the group if the user names it, else
    "". `is_by_group`: whether the axes were found by the names of groups. `is_of_dialect`: whether the file
    is in a known dialect. The columns then keep their whole names.
    """

    places: Sequence[int] = ()
    group: str = ""
    others: Sequence[str] = ()
    topic: str = ""
    is_by_group: bool = False
    is_of_dialect: bool = False


def of_one_gyroscope(where: str, sheet: Sheet, how: How) -> Sheet:
    """Return a table of the columns that belong to the axes, with the sampling rate stated for the axes.

    The table has all columns that are as long as the axes and belong to no other gyroscope. Columns in the
    groups around the axes get short names: `imu.t` becomes `t`. An axis that is shorter or longer than the
    other axes is kept, so that a later error message can name it.

    Raises:
        UsageError: several groups have a gyroscope, or several rates are stated for the same samples.
    """
    names = sheet.names
    found = _gyroscope(where, sheet, how)
    if not found.places:
        return sheet
    (rows, _), *_ = Counter(map(sheet.length, found.places)).most_common()
    of = around(names[found.places[0]])
    apart = tuple(f"{group}." for group in (*found.others, *with_clocks(names, of)))
    fixed = {place: name for place, name in enumerate(names) if name == how.time_column}
    for place in found.places:
        short = names[place].removeprefix(f"{found.group}.") if found.is_by_group else names[place]
        fixed[place] = short if axis_of(short, sheet.units[place]) else names[place]
    likes = [p for p, name in enumerate(names) if sheet.length(p) == rows and not name.startswith(apart)]
    keep = sorted({*fixed, *likes})
    inner = f"{of[0]}." if of else ""
    unread = [name for k, name in enumerate(names) if name.startswith((inner, *apart)) and k not in keep]
    unread = [name for name in unread if is_of_accelerometer(name)]
    text = f"{where}: {listed(unread)}: not read, since the gyroscope has other times, or {rows} rows."
    notes = (*sheet.notes, Note("reading", text)) if unread else sheet.notes
    called = {k: names[k] for k in keep} if found.is_of_dialect else short_names(names, of, fixed, keep)
    rates = _rates_of(where, sheet, found, how)
    return replace(sheet, rates=rates, notes=notes, topic=sheet.topic or found.topic).only(called)


def _gyroscope(where: str, sheet: Sheet, how: How) -> _Gyroscope:
    """Find the axes that the user or a logger's dialect names, or those of the only gyroscope."""
    names = sheet.names
    dialect = dialect_of(names, _facts(where, sheet))
    if how.columns is not None:
        places: Sequence[int] = [place for place, name in enumerate(names) if name in how.columns]
        return _Gyroscope(places, is_of_dialect=dialect is not None)
    if dialect is not None and (places := columns_of(dialect.gyro, names)):
        return _Gyroscope(places, is_of_dialect=True)
    groups = gyroscopes_in(names, sheet.units)
    longest = {group: max(map(sheet.length, places)) for group, places in groups.items()}
    groups = {
        group: groups[group] for group, rows in longest.items() if rows >= min(FEW, max(longest.values()))
    }
    asked = None if how.topic is None or sheet.topic else how.topic.strip("/").replace("/", ".")
    if asked in groups:
        group = asked
    elif len(groups) > 1:
        each = ", ".join(f"{group or '/'} ({longest[group]} rows)" for group in groups)
        which = Missing(f"which gyroscope is meant of {each}", "--sensor ?")
        one = replace(how, topic=next(iter(groups)) or "/")
        raise asked_with(where, which, given_options(how), lambda: _choose(where, sheet, one))
    else:
        group = next(iter(groups), "")
    others = [one for one in groups if one and one != group and not f"{group}.".startswith(f"{one}.")]
    topic = (group or "/") if asked in groups else ""
    return _Gyroscope(groups.get(group, ()), group, others, topic, is_by_group=True)


def _rates_of(where: str, sheet: Sheet, found: _Gyroscope, how: How) -> Mapping[str, float]:
    """Return the rate that the file states for the axes' arrays, or else for their innermost group."""
    arrays = {(sheet.arrays or sheet.names)[place] for place in found.places}
    rates = {name: rate_hz for name, rate_hz in sheet.rates.items() if name.rpartition("@")[0] in arrays}
    for level in (*around(sheet.names[found.places[0]]), ""):
        of = {level} | {
            one for one in map(group_of, sheet.rates) if group_of(one) == level and tells_gyroscope(one)
        }
        near = {name: rate_hz for name, rate_hz in sheet.rates.items() if group_of(name) in of}
        rates = rates or {name: rate_hz for name, rate_hz in near.items() if "@" not in name}
    if len({*rates.values()}) > 1 and how.rate_hz is None:
        each = ", ".join(f"{name} {rate_hz:g}" for name, rate_hz in rates.items())
        what = f"which of the rates [Hz] that are stated for the same samples is right: {each}"
        raise not_stated(where, [Missing(what, "--rate ? --overrule")], given_options(how))
    return dict(list(rates.items())[:1])
