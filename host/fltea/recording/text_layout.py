"""How text is laid out: what separates its fields, where its columns stand, where its rows begin (pure).

Lines are looked at one by one, so a file and an endless stream are understood in the same way.
"""

import csv
import re
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from fltea.recording.column_names import known_unit
from fltea.recording.columns import (
    DECIMAL_COMMA,
    Chosen,
    Wanted,
    choose,
    is_missing,
    is_number,
    wanted_of,
)
from fltea.recording.files import Note, listed
from fltea.recording.lines import shown
from fltea.recording.text_labels import decode_object, labelled, values_in
from fltea.records.errors import UsageError
from fltea.settings.how import How

COMMENTS = ("#", "%", "//")
SEPARATORS = ("\t", ";", ",", None)
"""The last is white space."""

MOST_BEFORE = 200
"""Lines before the first row that are remembered: one of them may be a header."""

WORDS = re.compile(r"[\s,;:={}\[\]]+")
MOST_COLUMNS = 10_000
"""Names in a line; a file of text may hold lines of a million."""

ONE_WITH_UNIT = re.compile(r"[^\[\]()]+[\[(][^\[\]()]*[\])]")


class Layout(NamedTuple):
    """Where the numbers of a row stand.

    separator: what is between two fields; None is white space. parse: of rows that name each number, objects
    of JSON or lines with labels, what gives them by their names; else None. usual: fields of the first row.
    least: a row has at least so many. most: fields beyond them hold no numbers. begin: the line of the first
    row, from 1. notes: what the user has to know.
    """

    chosen: Chosen
    separator: str | None
    parse: Callable[[str], Mapping[str, Any]] | None
    usual: int
    least: int
    most: int
    begin: int
    notes: tuple[Note, ...] = ()


class _Header(NamedTuple):
    """A line of names. is_loose: it may hold other words than names, or names with blanks."""

    line: int
    names: list[str]
    separator: str | None
    is_loose: bool


class LayoutFinder:
    """Takes line after line until one is a row. where: for messages. how: what the user says.

    is_other: the newest line was neither empty, a comment, nor part of the header.

    Raises:
        UsageError: `how` names too many columns, or one twice.
    """

    def __init__(self, where: str, how: How) -> None:
        self.is_other = False
        self._wanted = wanted_of(how)
        self._where, self._how = where, how
        self._first: list[tuple[int, str]] = []
        self._before: deque[tuple[int, str]] = deque(maxlen=MOST_BEFORE)
        self._header: _Header | None = None
        self._units: list[str] | None = None
        self._chosen: Chosen | None = None
        self._why_no_row = ""

    def take(self, number: int, line: str) -> Layout | None:
        """Look at the next line; the layout if it is a row.

        Raises:
            UsageError: a line names the columns, but which are meant, or in which units, is not clear.
        """
        self.is_other = False
        if is_blank(line):
            return None
        comment = is_comment(line)
        if not comment and line.lstrip().startswith("{"):
            found = self._of_object(number, line)
        else:
            numbers = not comment and all_numbers(line)
            header = None if numbers else header_of(line, self._wanted)
            if header is not None:
                self._header, self._units, self._chosen = _Header(number, *header), None, None
                return None
            if self._header is not None and self._chosen is None:
                units = None if numbers or self._units is not None else _units(line)
                if units is not None:
                    self._units = units
                    return None
                self._choose_named()
            found = None if comment else self._of_row(number, line) or self._of_labels(number, line)
        if found is None:
            self._before.append((number, line))
            if len(self._first) < MOST_BEFORE:
                self._first.append((number, line))
            self.is_other = not comment
        return found

    def refusal(self) -> UsageError:
        """Why no line so far is a row."""
        if self._header is not None or self._why_no_row:
            return UsageError(self._why_no_row or f"{self._where}: has a header but no rows.")
        lines = [line for _, line in self._first]
        unnamed = lines and self._wanted.columns is None
        if unnamed and not any(is_number(field) for line in lines for field in WORDS.split(line)):
            return UsageError(f"{self._where}: is no recording: none of its first lines holds a number.")
        place, has = _what_there_is(lines)
        where = f"{self._where}:{self._first[place][0] if lines else 1}"
        wanted = self._wanted
        if wanted.by_position and has is None and lines:
            width = len(split(lines[place], separator_of(lines[place])))
            beyond = [name for name in wanted.names if int(name) > width]
            what = f"no column {', '.join(beyond)}" if beyond else f"no numbers in {', '.join(wanted.names)}"
            return UsageError(f"{where}: {what} (it has {width} columns, without names).")
        line = f"; the line is {shown(lines[place].strip())}" if lines else ""
        return UsageError(f"{where}: {wanted.lacking(has, line)}.")

    def _choose_named(self) -> None:
        header, self._header = self._header, None  # of one that is refused nothing stays
        assert header is not None
        names, units = header.names, self._units
        beside = units if units is not None and len(units) == len(names) else None
        self._chosen = choose(f"{self._where}:{header.line}", names, beside, len(names), self._how)
        self._header = header

    def _of_row(self, number: int, line: str) -> Layout | None:
        header, chosen = self._header, self._chosen
        if header is None or chosen is None:
            separator = separator_of(line)
            fields = split(line, separator)
            if not self._wanted.are_at(fields):
                return None
            at, names, units = self._names_above(len(fields))
            chosen = choose(f"{self._where}:{at or number}", names, units, len(fields), self._how)
            return _layout(chosen, separator, fields, len(fields), number)
        names = header.names
        why = ""
        for separator in dict.fromkeys((separator_of(line, len(names)), header.separator)):
            fields = split(line, separator)
            if header.is_loose and (len(fields) < len(names) or any(fields[len(names) :])):
                found = (
                    f"has {len(fields)} fields, and the header names {len(names)} columns ({listed(names)}). "
                    "Write one name a column, or give positions: --columns 2,3,4."
                )
            else:
                found = why_too_many(fields, len(names))
            timed, note = _without_dates(chosen, fields, self._how)
            found = found or why_no_row(timed, fields, separator)
            if not found:
                where = f"{self._where}:{number}"
                notes = (Note("row_times", f"{where}: {note}"),) if note else ()
                return _layout(timed, separator, fields, len(names), number, notes)
            why = why or found
        self._why_no_row = self._why_no_row or f"{self._where}:{number}: {why}"
        return None

    def _of_object(self, number: int, line: str) -> Layout | None:
        try:
            found = decode_object(line)
        except (ValueError, RecursionError):  # msgspec's errors are ValueErrors
            return None
        names = list(found)
        if len(names) > MOST_COLUMNS or self._wanted.by_position or not self._wanted.are_in(names):
            return None
        chosen = choose(f"{self._where}:{number}", names, None, len(names), self._how)
        if not all(found[name] is None or type(found[name]) in (int, float) for name in chosen.read):
            self._why_no_row = f"{self._where}:{number}: {listed(chosen.read)}: not all are numbers."
            return None
        return Layout(chosen, None, decode_object, 0, 0, 0, number)

    def _of_labels(self, number: int, line: str) -> Layout | None:
        found = labelled(line) if self._header is None else None
        if found is None or self._wanted.by_position or not self._wanted.are_in(list(found.values)):
            return None
        names, units = list(found.values), list(found.units.values())
        chosen = choose(f"{self._where}:{number}", names, units, len(names), self._how)
        return Layout(chosen, None, values_in, 0, 0, 0, number)

    def _names_above(self, width: int) -> tuple[int | None, list[str] | None, list[str] | None]:
        """The header above rows whose columns go by their positions: its line, names, and units below it."""
        units = None
        for number, line in reversed(self._before):
            found = bare_fields(line)
            if len(found) != width or any(map(is_number, found)):
                continue
            if units is None and _units(line) is not None:
                units = found
            else:
                return number, found, units
        return None, None, None


def _layout(
    chosen: Chosen,
    separator: str | None,
    fields: Sequence[str],
    columns: int,
    number: int,
    notes: tuple[Note, ...] = (),
) -> Layout:
    filled = len(fields)
    while filled and not fields[filled - 1].strip():
        filled -= 1
    least = max(min(filled, columns), max(chosen.needed) + 1)
    return Layout(chosen, separator, None, len(fields), least, columns, number, notes)


def why_too_many(fields: Sequence[str], columns: int) -> str:
    """Why fields are more than there are columns, if these are numbers: commas may be decimal ones."""
    if not any(map(is_number, fields[columns:])):
        return ""
    return (
        f"has {len(fields)} fields, and there are {columns} columns. If the numbers have decimal commas, "
        "separate the columns by ';' or write decimal points."
    )


def why_no_row(chosen: Chosen, fields: Sequence[str], separator: str | None) -> str:
    """Why fields do not hold the numbers that are needed; "" if they do, or are missing ones."""
    for place, name in zip(chosen.needed, chosen.read, strict=False):
        if place >= len(fields):
            return f"has {len(fields)} fields; column {shown(name)} is number {place + 1}."
        field = fields[place].strip()
        in_quotes = separator == "," and "," in field
        if is_missing(field) or (is_number(field) and not in_quotes):
            continue
        hint = ""
        if in_quotes and is_number(field):
            hint = " Decimal commas are read where ';', a tab or blanks separate the columns."
        elif place == chosen.time:
            hint = " Times as text are not read, so give the rate: --rate 100."
        return f"column {shown(name)}: {shown(field)} is not a number.{hint}"
    return ""


def _without_dates(chosen: Chosen, fields: Sequence[str], how: How) -> tuple[Chosen, str]:
    """Leave aside a column of times that holds words and was not asked for; and a text for the user."""
    if (
        chosen.time is None
        or chosen.time >= len(fields)
        or how.rate_hz is None
        or how.time_column is not None
    ):
        return chosen, ""
    first = fields[chosen.time]
    if is_number(first) or is_missing(first):
        return chosen, ""
    text = f"column {shown(chosen.time_name)}: {shown(first)} is no number, so it cannot tell which samples "
    return chosen._replace(time=None), text + "are missing."


def is_blank(line: str) -> bool:
    """Whether nothing stands in a line; separators are something."""
    return not line.strip(" \r\n") or (line.isspace() and "\t" not in line)


def is_comment(line: str) -> bool:
    """Whether a line is for people."""
    return line.lstrip().startswith(COMMENTS)


def all_numbers(line: str) -> bool:
    """Whether there are numbers in a line, and nothing else."""
    known = [field for field in split(line, separator_of(line)) if not is_missing(field)]
    return bool(known) and all(map(is_number, known))


def separator_of(line: str, columns: int = 0) -> str | None:
    """What separates the fields of a row of so many columns, if that is known; None is white space."""
    for separator in ("\t", ";"):
        if separator in line:
            return separator
    words = line.split()
    if columns == 1 and len(words) == 1 and DECIMAL_COMMA.fullmatch(words[0]):
        return None
    if len(words) > 1 and "," in line and all(map(is_number, words)):
        return None
    return "," if "," in line else None


def split(line: str, separator: str | None) -> list[str]:
    """The fields of a line, without quotes around them."""
    if separator is None:
        fields = line.split()
    elif '"' in line and len(line) < csv.field_size_limit():
        text = line.rstrip("\r\n").replace("\r", " ")
        fields = next(csv.reader([text], delimiter=separator, skipinitialspace=True), [])
    else:
        fields = line.rstrip("\r\n").split(separator)
    return [field.strip().strip('"').strip() for field in fields]


def header_of(line: str, wanted: Wanted) -> tuple[list[str], str | None, bool] | None:
    """The names in a line, what separates them, and whether it may hold more than names; or None."""
    text = line.strip(" \r\n")  # a tab separates, so one in front belongs to a first column without a name
    for mark in COMMENTS:
        text = text.removeprefix(mark) if len(mark) > 1 else text.lstrip(mark)
    if any(mark in text for mark in "\t;,"):
        separators = [separator for separator in SEPARATORS if separator is None or separator in text]
    else:  # a line end separates nothing: this is one name with blanks, rather if a unit ends it
        separators = ["\n", None] if ONE_WITH_UNIT.fullmatch(text) else [None, "\n"]
    for separator in separators:
        names = split(text, separator)
        if (
            separator is None
            and not wanted.by_position
            and any(is_number(name.strip(",;")) for name in names)
        ):
            continue  # labels with numbers, as in "gx: 1.5 gy: 0.2"
        if len(names) <= MOST_COLUMNS and wanted.are_in(names) and not _is_row_of_positions(names, wanted):
            return names, separator, separator is None or is_comment(line)
    return None


def _is_row_of_positions(fields: Sequence[str], wanted: Wanted) -> bool:
    """Whether a line that has the positions as its fields is a row that happens to hold such numbers."""
    return wanted.by_position and any(is_number(field) and not field.isdecimal() for field in fields)


def bare_fields(line: str) -> list[str]:
    """The fields of a line that may be a comment."""
    text = line.strip().lstrip("#%/").strip()
    return split(text, separator_of(text))


def _units(line: str) -> list[str] | None:
    """The units in the second line of a header, which holds nothing else."""
    fields = bare_fields(line)
    named = [known_unit(field) for field in fields if field not in ("", "-", "[]", "[-]", "1")]
    return fields if named and all(named) and not any(map(is_number, fields)) else None


def _what_there_is(lines: Sequence[str]) -> tuple[int, list[str] | None]:
    """The line that looks most like a header, and its names."""
    comment = None
    for i, line in enumerate(lines):
        if is_comment(line):
            comment = i
            continue
        if not all_numbers(line):
            return i, split(line, separator_of(line))
        if comment is not None:
            names = bare_fields(lines[comment])
            if len(names) == len(split(line, separator_of(line))) and len(names) > 1:
                return comment, names
        return i, None
    return 0, None
