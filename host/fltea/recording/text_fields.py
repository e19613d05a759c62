"""Splits lines of text into fields. Finds the separator, lines of the same kind, and the numbers in lines."""

import contextlib
import csv
import math
import re
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from fltea.recording.one_sensor import as_word
from fltea.recording.sample_times import Floats
from fltea.recording.text_labels import decode_object, values_in
from fltea.recording.units import is_unit
from fltea.recording.wanted import DECIMAL_COMMA, is_missing, is_number
from fltea.records.errors import UsageError

COMMENTS = ("#", "%", "//")

MOST_COLUMNS = 10_000
"""Largest number of column names in a line. A limit is needed since some files have lines with a million
fields.
"""

_WORDS = re.compile(r"[^\s\[(]+(?:\s*(?:\[[^\[\]]*\]|\([^()]*\)))?\S*")

MOST_KINDS = 20
"""Largest number of kinds of rows. The first word of a row may tell its kind, as in `GYRO,1,2,3`. If a text
has more different first words than this, they are something else.
"""


def is_blank(line: str) -> bool:
    """Return whether a line is empty. A line that consists of separators is not empty."""
    return not line.strip(" \r\n") or (line.isspace() and "\t" not in line)


def is_comment(line: str) -> bool:
    """Return whether a line is a comment."""
    return line.lstrip().startswith(COMMENTS)


def all_numbers(line: str) -> bool:
    """Return whether a line holds numbers and nothing else."""
    known = [field for field in split(line, separator_of(line)) if not is_missing(field)]
    return bool(known) and all(map(is_number, known))


def separator_of(line: str, columns: int = 0) -> str | None:
    """Return the separator between the fields of a row. None means that white space separates the fields.

    `columns`: number of columns, if known.
    """
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
    """Return the fields of a line, without quotes around them."""
    if separator is None:
        fields = line.split()
    elif '"' in line and len(line) < csv.field_size_limit():
        text = line.rstrip("\r\n").replace("\r", " ")
        fields = next(csv.reader([text], delimiter=separator, skipinitialspace=True), [])
    else:
        fields = line.rstrip("\r\n").split(separator)
    return [field.strip().strip('"').strip() for field in fields]


def words_with_units(line: str) -> list[str]:
    """Return the words of a line, which blanks separate. A unit in brackets belongs to the word before it."""
    return _WORDS.findall(line) if "[" in line or "(" in line else split(line, None)


def bare_fields(line: str) -> list[str]:
    """Return the fields of a line, without the sign that may mark the line as a comment."""
    text = line.strip().lstrip("#%/").strip()
    return split(text, separator_of(text))


def units_in(line: str) -> list[str] | None:
    """Return the units in a line below the names of columns.

    Return None if fewer than half of the line's fields are known units.
    """
    fields = bare_fields(line)
    filled = [
        field for field in fields if field not in ("", "1")
    ]  # "1" stands for the unit of a quantity without a dimension
    known = sum(map(is_unit, filled))
    if any(map(is_number, filled)) or not known or 2 * known < len(filled):
        return None
    return fields


_THOUSANDS = re.compile(
    r"[-+]?\d{1,3}(?:(?:\.\d{3}){2,}(?:,\d+)?|(?:\.\d{3})+,\d+|(?:,\d{3}){2,}(?:\.\d+)?|(?:,\d{3})+\.\d+)"
)
_MAY_HAVE_THOUSANDS = re.compile(r"\d[.,]\d{3}[.,]\d")


class Thousands:
    """Finds numbers whose thousands are set apart by signs, as in `1.000.010`, in a growing list of lines."""

    def __init__(self) -> None:
        self._seen = 0
        self._first: dict[int, str] = {}

    def check(self, where: str, lines: Sequence[str]) -> None:
        """Check the lines that were added to `lines` since the last call.

        Raises:
            UsageError: a column has two different numbers such as `1.000.010`. Then 53.456 in this column may
                mean 53456.
        """
        for line in lines[self._seen :]:
            if not _MAY_HAVE_THOUSANDS.search(line) or is_comment(line):
                continue
            for place, field in enumerate(split(line, separator_of(line))):
                if not _THOUSANDS.fullmatch(field) or self._first.setdefault(place, field) == field:
                    continue
                sign = next(mark for mark in field if mark in ".,")
                raise UsageError(
                    f"{where}: {field} has signs between its thousands, so a number with one such sign has "
                    f"two possible meanings. Write numbers without them: {field.replace(sign, '')}."
                )
        self._seen = len(lines)


class Kinds:
    """Collects the words with which rows begin, from a growing list of lines.

    Such a word tells the kind of a row, and is stored with the number of fields of the first such row.
    """

    def __init__(self) -> None:
        self._seen = 0
        self._found: dict[str, int] = {}

    def of(self, lines: Sequence[str]) -> dict[str, int]:
        """Examine the new lines. Return each word with which a row begins, with the row's number of fields.

        If there are too many different words, return an empty result.
        """
        for line in lines[self._seen :] if len(self._found) <= MOST_KINDS else ():
            fields = [] if is_comment(line) else split(line, separator_of(line))
            has_word = len(fields) > 2 and not is_number(fields[0]) and bool(fields[0])
            if has_word and 2 * sum(map(is_number, fields[1:])) > len(fields):
                self._found.setdefault(fields[0], len(fields))
        self._seen = len(lines)
        return self._found if len(self._found) <= MOST_KINDS else {}


def rows_alike(lines: Sequence[str]) -> tuple[str, list[str]]:
    """Return the most common kind of lines with numbers, and all lines of this kind.

    Lines are of the same kind if they are objects with the same names, rows with the same number of fields,
    or lines with the same labels.
    """
    found: dict[tuple[str, Any], list[str]] = {}
    for line in lines:
        if is_blank(line) or is_comment(line):
            continue
        if line.lstrip().startswith("{"):
            with contextlib.suppress(ValueError, RecursionError):
                found.setdefault(("object", tuple(decode_object(line))[:MOST_COLUMNS]), []).append(line)
            continue
        fields = split(line, separator_of(line))
        numbers = sum(map(is_number, fields))
        has_label = bool(fields) and not is_number(fields[0]) and any(mark in fields[0] for mark in ":=")
        values = values_in(line) if has_label or 2 * numbers <= len(fields) - 1 else {}
        if len(values) > numbers or (values and 2 * numbers <= len(fields) - 1):
            found.setdefault(("label", tuple(values)), []).append(line)
        elif 2 * numbers > len(fields) - 1:
            found.setdefault(("row", min(len(fields), MOST_COLUMNS + 1)), []).append(line)
    kind, of = max(found, key=lambda one: len(found[one]), default=("", 0))
    is_too_wide = kind == "row" and of > MOST_COLUMNS
    return kind, [] if is_too_wide else found.get((kind, of), [])


def sample_of(lines: Sequence[str], names: Sequence[str] | None, width: int, tag: str) -> Floats:
    """Return the numbers in lines of the same kind (n, width), with NaN for fields that are no numbers.

    `tag`: first field of all lines, which tells their kind, or "".

    The result is cached: it is needed whenever a line of column names is read, and such a line may stand
    among the rows thousands of times.
    """
    return _numbers(tuple(lines), tuple(names or ()), width, tag)


def cells_of(
    lines: Sequence[str], names: Sequence[str] | None, width: int, tag: str, place: int
) -> list[str]:
    """Return the fields of one column as texts. Lines, names, width and tag: as for `sample_of`."""
    found = (row[place] for row in _rows(tuple(lines), tuple(names or ()), width, tag))
    return [as_word(one) if isinstance(one, float) else "" if one is None else str(one) for one in found]


def _has(found: Mapping[str, Any], line: str, names: set[str]) -> bool:
    return line.lstrip().startswith("{") or found.keys() >= names


@lru_cache(maxsize=2)
def _named(lines: Sequence[str]) -> list[Mapping[str, Any]]:
    """Return the numbers in lines by their names. The lines are JSON objects, or label each number."""
    named: list[Mapping[str, Any]] = []
    for line in lines:
        try:
            named.append(decode_object(line) if line.lstrip().startswith("{") else values_in(line))
        except (ValueError, RecursionError):
            named.append({})
    return named


@lru_cache(maxsize=8)
def _rows(lines: Sequence[str], names: Sequence[str], width: int, tag: str) -> list[list[Any]]:
    named = _named(lines)
    is_by_name = names and any(_has(found, line, {*names}) for found, line in zip(named, lines, strict=True))
    names = names if is_by_name else ()
    rows: list[list[Any]] = []
    for line, found in zip(lines, named, strict=True):
        if is_comment(line):
            continue
        if _has(found, line, {*names} or {""}):
            rows.append([found.get(name) for name in names])
            continue
        fields = split(line, separator_of(line, width))
        while len(fields) > width and not fields[-1]:
            fields.pop()
        if len(fields) == width and (not tag or fields[0] == tag) and any(map(is_number, fields)):
            rows.append(list(fields))
    return [row for row in rows if len(row) == width]


@lru_cache(maxsize=8)
def _numbers(lines: Sequence[str], names: Sequence[str], width: int, tag: str) -> Floats:
    rows = [[_value(field) for field in row] for row in _rows(lines, names, width, tag)]
    found = np.array(rows, np.float64).reshape(len(rows), width)
    found.setflags(write=False)
    return found


def _value(field: Any) -> float:
    if isinstance(field, str):
        return float(field.replace(",", ".")) if is_number(field) else math.nan
    try:
        return float(field) if isinstance(field, int | float) else math.nan
    except OverflowError:
        return math.nan
