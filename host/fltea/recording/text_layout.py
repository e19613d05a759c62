"""How a text recording is laid out: what separates its fields, where its columns stand, where rows begin."""

import csv
import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from fltea.recording.column_names import known_unit
from fltea.recording.columns import Wanted
from fltea.recording.files import listed
from fltea.recording.lines import shown
from fltea.records.errors import UsageError

COMMENTS = ("#", "%", "//")
HEAD_LINES = 200
"""So many lines may stand before the rows."""

MOST_COLUMNS = 10_000
"""Names in a line; a file of text may hold lines of a million."""

DECIMAL_COMMA = re.compile(r"[+-]?\d+,\d+([eE][+-]?\d+)?")
MISSING = ("", "nan", "-nan", "+nan", "na", "n/a", "null", "none")
"""What programs write where they have no number; in small letters."""


class Layout(NamedTuple):
    """separator: None is white space. names, units: of the columns, None without a header or such a line.

    first: fields of the first row. header: index of the line with the names. begin: index of the first row.
    """

    separator: str | None
    decimal_comma: bool
    names: list[str] | None
    units: list[str] | None
    first: list[str]
    header: int
    begin: int


def find_layout(path: Path, lines: Sequence[str], wanted: Wanted) -> Layout:
    """Look at the first lines.

    Raises:
        UsageError: no line names the columns that are wanted, or the fields of the rows are not clear.
    """
    header, names, begin = None, None, 0
    for i, line in enumerate(lines):
        if is_blank(line):
            continue
        if not is_comment(line) and all_numbers(line):
            break
        found = _header(line, wanted)
        if found is not None:
            header, names, begin = i, found, i + 1
            break
        if not is_comment(line) and wanted.are_at(split(line, separator_of(line)[0])):
            break  # a later row may hold what looks like the names: 2 is a position, and a number
    units = None
    if names is None:
        begin = _without_header(path, lines, wanted)
        header, names, units = _names_before(lines, begin)
    rows = [i for i in range(begin, len(lines)) if not is_blank(lines[i])]
    if names is not None and rows and begin <= rows[0] and units is None:
        units = _units(lines[rows[0]])
        rows = rows[units is not None :]
    rows = [i for i in rows if not is_comment(lines[i])]
    first = lines[rows[0]] if rows else "" if header is None else lines[header]
    separator, decimal_comma = separator_of(first)
    fields = split(first, separator) if rows else [""] * len(names or ())
    if names is not None and len(names) == 1 and DECIMAL_COMMA.fullmatch(first.strip()):
        separator, decimal_comma, fields = None, True, [first.strip()]
    if names is not None and header is not None and rows and not wanted.by_position:
        strict = separator is None or is_comment(lines[header])
        _check_width(f"{path}:{rows[0] + 1}", fields, names, separator, strict=strict)
    return Layout(
        separator,
        decimal_comma,
        names,
        units if units is None or names is None or len(units) == len(names) else None,
        fields,
        0 if header is None else header,
        rows[0] if rows else len(lines),
    )


def is_blank(line: str) -> bool:
    """Whether nothing stands in a line; separators are something."""
    return not line.strip(" \r\n") or (line.isspace() and "\t" not in line)


def is_comment(line: str) -> bool:
    """Whether a line is for people."""
    return line.lstrip().startswith(COMMENTS)


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


def all_numbers(line: str) -> bool:
    """Whether there are numbers in a line, and nothing else."""
    fields = split(line, separator_of(line)[0])
    known = [field for field in fields if field.strip().lower() not in MISSING]
    return bool(known) and all(map(is_number, known))


def separator_of(line: str) -> tuple[str | None, bool]:
    """What separates the fields of a row, and whether its numbers have decimal commas."""
    for separator in ("\t", ";"):
        if separator in line:
            fields = [field.strip().strip('"') for field in line.split(separator)]
            commas = any(map(DECIMAL_COMMA.fullmatch, fields))
            return separator, commas and not any("." in field for field in fields)
    words = line.split()
    if len(words) > 1 and all("," in w and DECIMAL_COMMA.fullmatch(w) for w in words):
        return None, True
    return ("," if "," in line else None), False


def split(line: str, separator: str | None) -> list[str]:
    """The fields of a line, without quotes around them."""
    if separator is None:
        fields = line.split()
    elif '"' in line and len(line) < csv.field_size_limit():
        fields = next(csv.reader([line.rstrip("\r\n")], delimiter=separator, skipinitialspace=True), [])
    else:
        fields = line.rstrip("\r\n").split(separator)
    return [field.strip().strip('"').strip() for field in fields]


def _header(line: str, wanted: Wanted) -> list[str] | None:
    text = line.strip()
    for mark in COMMENTS:
        text = text.removeprefix(mark) if len(mark) > 1 else text.lstrip(mark)
    for separator in ("\t", ";", ",", None):
        if separator is None or separator in text:
            names = split(text, separator)
            if len(names) <= MOST_COLUMNS and wanted.are_in(names):
                return names
    return None


def _units(line: str) -> list[str] | None:
    """A second line of the header: units, and nothing else."""
    text = line.strip().lstrip("#%").strip("\r\n")
    fields = split(text, separator_of(text)[0])
    named = [known_unit(field) for field in fields if field not in ("", "-", "[]", "[-]", "1")]
    return fields if named and all(named) and not any(map(is_number, fields)) else None


def _without_header(path: Path, lines: Sequence[str], wanted: Wanted) -> int:
    """Where the rows begin if no line names what is wanted."""
    rows = [i for i, line in enumerate(lines) if not is_comment(line) and not is_blank(line)]
    rows = rows if wanted.by_position else rows[:1]
    row = next((i for i in rows if wanted.are_at(split(lines[i], separator_of(lines[i])[0]))), None)
    if row is not None:
        return row
    place, has = _what_there_is(lines)
    where = f"{path}:{place + 1}"
    no_header = f"no header; the line is {shown(lines[place].strip())}" if lines else "no header"
    lacking = [name for name in wanted.names if has is None or name not in has]
    if wanted.columns is None and not (lacking and has):
        positions = " or, since there is no header, their positions: --columns 1,2,3" if has is None else ""
        raise UsageError(
            f"{where}: no columns gyro_x_dps, …; name yours with --columns{positions} (it has: "
            f"{no_header if has is None else listed(has)})."
        )
    told = f"{no_header}; give positions: --columns 1,2,3" if has is None else listed(has)
    raise UsageError(f"{where}: no column {', '.join(lacking)} (it has: {told}).")


def _names_before(lines: Sequence[str], begin: int) -> tuple[int | None, list[str] | None, list[str] | None]:
    """The header above rows whose columns go by their positions: it may say units. Its line, names, units."""
    row = split(lines[begin], separator_of(lines[begin])[0])
    units = None
    for i in range(begin - 1, -1, -1):
        text = lines[i].strip().lstrip("#%/").strip()
        found = split(text, separator_of(text)[0])
        if len(found) != len(row) or any(map(is_number, found)):
            continue
        if units is None and _units(lines[i]) is not None:
            units = found
        else:
            return i, found, units
    return None, None, None


def _what_there_is(lines: Sequence[str]) -> tuple[int, list[str] | None]:
    """The line that looks most like a header, and its names."""
    comment = None
    for i, line in enumerate(lines):
        if is_blank(line):
            continue
        if is_comment(line):
            comment = i
            continue
        if not all_numbers(line):
            return i, split(line, separator_of(line)[0])
        if comment is not None:
            text = lines[comment].strip().lstrip("#%/").strip()
            names = split(text, separator_of(text)[0])
            if len(names) == len(split(line, separator_of(line)[0])) and len(names) > 1:
                return comment, names
        return i, None
    return 0, None


def check_surplus(where: str, fields: Sequence[str], columns: int) -> None:
    """Refuse a row with more numbers than columns: commas may be decimal ones, and all columns wrong."""
    if any(map(is_number, fields[columns:])):
        raise UsageError(
            f"{where}: has {len(fields)} fields, and there are {columns} columns. If the numbers have "
            "decimal commas, separate the columns by ';' or write decimal points."
        )


def _check_width(
    where: str, fields: list[str], names: list[str], separator: str | None, *, strict: bool
) -> None:
    """Refuse a first row whose fields cannot be told to be those of the names.

    strict: the names may hold blanks, or other words than names, so their number has to be the same.
    """
    if separator == ",":
        check_surplus(where, fields, len(names))
    told = f"{where}: has {len(fields)} fields, and the header names {len(names)} columns"
    surplus = fields[len(names) :]
    if strict and (len(fields) < len(names) or any(surplus)):
        raise UsageError(
            f"{told} ({listed(names)}). Write one name a column, or give positions: --columns 2,3,4."
        )
