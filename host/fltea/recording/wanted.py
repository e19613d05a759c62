"""Holds the columns that the user names by options, and tests whether a field of a text is a number."""

import re
from collections.abc import Sequence
from typing import NamedTuple

from fltea.recording.column_names import without_unit
from fltea.recording.files import listed
from fltea.records.errors import UsageError
from fltea.records.records import AXES
from fltea.settings.how import How

UNSIGNED = r"(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
NUMBER = rf"[-+]?{UNSIGNED}"
"""Regular expression for a number with a decimal point."""

DECIMAL_COMMA = re.compile(r"[+-]?\d+,\d+([eE][+-]?\d+)?", re.ASCII)
MISSING = ("", "nan", "-nan", "+nan", "na", "n/a", "null", "none")
"""Words that programs write for a missing number, in small letters."""


class Wanted(NamedTuple):
    """The columns that the user names by options.

    `columns`: names of the axes' columns. It is None if the user names no such columns. Then the axes are
    found by the names of the columns, or by the logger's dialect. `time`: name of the column of times, or
    None.
    """

    columns: list[str] | None
    time: str | None = None

    @property
    def names(self) -> list[str]:
        """All names of columns that the user gives."""
        return [*(self.columns or ()), *([] if self.time is None else [self.time])]

    @property
    def by_position(self) -> bool:
        """Whether the user gives positions of columns, counted from 1, instead of names."""
        return self.columns is not None and all(map(_is_position, self.names))

    def is_in(self, header: Sequence[str]) -> bool:
        """Return whether the user names axes, and a header contains all names that the user gives."""
        return self.columns is not None and self.labels(header) is not None

    def labels(self, header: Sequence[str]) -> list[str] | None:
        """Return the names in a header, with the user's name in place of each that the user means.

        The user may leave out a name's unit, and may give the position of one column beside names of others.
        Return None if the header lacks a column that the user names.
        """
        found = list(header)
        for name in self.names:
            place = self._place(name, header)
            if place is None or found[place] not in (header[place], name):
                return None
            if name not in header:
                found[place] = name
        return found

    def _place(self, name: str, header: Sequence[str]) -> int | None:
        place = place_of(name, header)
        is_position = place is None and not self.by_position and _is_position(name)
        return int(name) - 1 if is_position and int(name) <= len(header) else place

    def is_at(self, fields: Sequence[str]) -> bool:
        """Return whether a line in a text without a header is a row.

        If the user gives positions of columns, numbers (or words for missing numbers) have to stand there. If
        the user gives names of axes and no column of times, the line must be one number for each name.
        """
        if self.by_position:
            found = [fields[p - 1] for p in map(int, self.names) if p <= len(fields)]
            return (
                len(found) == len(self.names)
                and any(map(is_number, found))
                and all(is_number(field) or is_missing(field) for field in found)
            )
        alike = self.columns is not None and len(fields) == len(self.columns)
        return self.time is None and alike and all(map(is_number, fields))

    def lacking(self, header: Sequence[str] | None) -> str:
        """Return a text: which of the user's columns are missing, or which of several each may be.

        `header`: None if the text has none.
        """
        lacking = [name for name in self.names if header is None or self._place(name, header) is None]
        several = {name: _alike(name, header or ()) for name in lacking}
        texts = [
            f"which column {name} means is not known: {listed(found)}; give its whole name"
            for name, found in several.items()
            if found
        ]
        if lacking := [name for name in lacking if not several[name]]:
            has = "no header" if header is None else listed(header)
            texts.insert(0, f"no column {', '.join(lacking)} (it has: {has})")
        return "; and ".join(texts)


def place_of(name: str, header: Sequence[str]) -> int | None:
    """Return the column of this name, or the only one that has it before its unit; None if there is none."""
    if name in header:
        return header.index(name)
    alike = _alike(name, header)
    return header.index(alike[0]) if len(alike) == 1 else None


def _alike(name: str, header: Sequence[str]) -> list[str]:
    """Return the names in a header that are `name` with a unit behind it."""
    return [one for one in header if without_unit(one) == name]


def wanted_of(how: How) -> Wanted:
    """Return the columns that the user names.

    Raises:
        UsageError: the user names no column, more columns than a gyroscope has axes, or one column twice.
    """
    if how.columns is not None and len(how.columns) > len(AXES):
        raise UsageError(
            f"--columns names {len(how.columns)} columns; a gyroscope has up to {len(AXES)} axes."
        )
    if how.columns is not None and not any(name.strip() for name in how.columns):
        raise UsageError("--columns names no column. Give names or positions: --columns 2,3,4.")
    wanted = Wanted(how.columns, how.time_column)
    twice = {name for name in wanted.names if wanted.names.count(name) > 1}
    if twice:
        raise UsageError(f"--columns, --time-column: {', '.join(sorted(twice))} is named twice.")
    return wanted


def _is_position(name: str) -> bool:
    return name.isascii() and name.isdecimal() and int(name) >= 1


def is_number(field: str) -> bool:
    """Return whether a field holds a number, with a decimal point or comma."""
    field = field.strip().strip('"').strip()
    try:
        float(field)
    except ValueError:
        return DECIMAL_COMMA.fullmatch(field) is not None
    return "_" not in field and field.isascii()


def is_missing(field: str) -> bool:
    """Return whether a field holds a word for a missing number."""
    return field.strip().strip('"').strip().lower() in MISSING
