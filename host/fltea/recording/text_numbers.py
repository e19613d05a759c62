"""Reads rows of text as numbers, line by line or many lines at a time.

Plain rows are read in C++ (`host/native/plain_rows.hpp`), ten times as fast as by numpy. Other lines, such as
headers, truncated lines or words, are read line by line.
"""

import csv
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from fltea._native import plain_rows
from fltea.recording.raw_lines import LONGEST_LINE, shown
from fltea.recording.row_layout import Layout, why_no_row, why_too_many
from fltea.recording.sample_times import Floats, Ints
from fltea.recording.text_fields import is_blank, is_comment
from fltea.recording.text_labels import values_in
from fltea.recording.wanted import DECIMAL_COMMA, is_missing, is_number

SAMPLE_BEGINS = '0123456789+-.,;"{'
"""A line that begins with one of these characters, or with `nan`, was meant as a sample, even if it has too
few fields.
"""

LEAST_AT_ONCE, MOST_AT_ONCE = 1 << 9, 1 << 18
"""Plain rows (lines that hold numbers only) are read in pieces of at least, and of at most, this number of
bytes.
"""

MOST_LEFT_OUT = 1000
"""At most this number of different lines without a sample are remembered, so that they are skipped quickly
when they occur again.
"""

REASONS = {
    "text": "is no line of numbers",
    "fields": "has a different number of fields than the other lines",
    "number": "has a field that is not a number",
    "columns": "is an object without the columns to read",
    "too_long": f"has no end within {LONGEST_LINE} bytes",
    "before_header": "came before the columns were known",
    "header": "names columns that do not fit those before, or stands below such a line",
    "not_finite": "has an empty field, NaN or infinity: a missing sample",
    "too_large": "is beyond what a gyroscope measures; are the units right?",
    "time": "has an impossible time",
}
"""Reasons why a line holds no sample. The keys are the same as those of the counts in `link.bad_frames`. The
values say to the user what is wrong with the line.

The last three apply to rows: the module `table` finds them when it turns rows into samples.
"""

WhyNot = tuple[str, str]
"""Why a line holds no sample: the key in `REASONS` under which the line is counted, and a text that shows the
line.
"""


class Plain(NamedTuple):
    """Result of reading lines up to the first line that is no plain row.

    A plain row is a line that holds numbers only. `next`: offset in the data of the line at which reading
    stopped; beyond the end of the data if all lines were read. `passed`: number of lines before that line.
    `rows`: (n,) indices of the rows among the passed lines; the others are blank or comments. `values`: (n,
    columns), numbers in the rows. `goes_on`: whether reading stopped only since it is done in pieces, so that
    plain rows may follow at `next`.
    """

    next: int
    passed: int
    rows: Ints
    values: Floats
    goes_on: bool = False


class RowParser:
    """Reads lines as rows of numbers by one layout.

    After the first number with a decimal comma or a decimal point, all numbers have to use the same decimal
    sign.
    """

    def __init__(self, layout: Layout) -> None:
        self.layout = layout
        self._decimal = ""
        self._window = LEAST_AT_ONCE
        self._left_out: dict[bytes, WhyNot] = {}

    def plain(self, data: bytes, begin: int = 0) -> Plain:
        """Read lines from byte `begin` on, up to the first line that does not hold numbers only.

        `data`: whole lines, without a line feed after the last one.
        """
        layout = self.layout
        if layout.parse is not None:
            return self._plain_named(data, begin)
        form = layout.separator or "\0", layout.least, layout.most, layout.chosen.places
        stop = end_of_line(data, begin + self._window) if begin + self._window < len(data) else len(data)
        # plain_rows reserves memory for all lines of `part`, but stops at the first line that is no plain
        # row. So where plain rows are few, a long `part` would waste time, and `self._window` makes it short.
        part = data[begin:stop]
        after, passed, decimal, rows, values = plain_rows(part, 0, *form, self._decimal or "\0")
        self._decimal = decimal.strip("\0")
        goes_on = after > len(part)
        self._window = min(MOST_AT_ONCE, 2 * max(self._window if goes_on else after, LEAST_AT_ONCE))
        return Plain(begin + after, passed, rows, values, goes_on and stop < len(data))

    def left_out(self, line: bytes) -> WhyNot | None:
        """Return why an earlier line with the same text was left out; None if there was no such line."""
        return self._left_out.get(line)

    def leave_out(self, line: bytes, why: WhyNot) -> None:
        """Remember why a line holds no sample.

        Not to be called for a line that names columns, since such a line is examined each time.
        """
        if len(self._left_out) < MOST_LEFT_OUT:
            self._left_out[line] = why

    def _plain_named(self, data: bytes, begin: int) -> Plain:
        rows: list[int] = []
        values: list[list[float]] = []
        passed = 0
        while begin <= len(data):
            end = end_of_line(data, begin)
            found = self.one(decoded(data[begin:end]))
            if isinstance(found, list):
                rows.append(passed)
                values.append(found)
            elif found is not None:
                break
            passed, begin = passed + 1, end + 1
        return Plain(begin, passed, np.array(rows, np.int64), np.array(values))

    def one(self, text: str) -> list[float] | WhyNot | None:
        """Return the numbers in a line, or why it holds no sample.

        Return None for an empty line or a comment.
        """
        layout = self.layout
        if layout.parse is not None:
            return None if self._is_empty(text) else _of_named(layout, layout.parse, text)
        return None if self._is_empty(text) else self._closely(text)

    def _closely(self, text: str) -> list[float] | WhyNot:
        layout = self.layout
        begin = text.lstrip()
        was_meant = begin[:1] in SAMPLE_BEGINS or begin[:3].lower() == "nan"
        try:
            if layout.separator is None:
                fields = text.split()
            elif '"' in text:
                fields = next(csv.reader([text.rstrip(" \r")], delimiter=layout.separator, strict=True), [])
            else:
                fields = text.split(layout.separator)
            words = text.split() if layout.separator == "\t" and len(fields) < layout.least else []
            if len(words) >= layout.least and all(map(is_number, words)):
                fields = words  # here blanks stand in place of some tabs
        except csv.Error as error:
            return "number", f"cannot be read as CSV ({error})."
        filled = len(fields)
        while filled > layout.least and not fields[filled - 1].strip():
            filled -= 1
        was_meant |= layout.separator is not None and filled >= layout.least > 1
        why = why_no_row(layout.chosen, fields[:filled], layout.separator)
        if why and not was_meant:
            return "text", f"{shown(begin)} is no line of numbers."
        if filled < layout.least:
            return "fields", why or f"has {filled} fields, and the first row has {layout.least}."
        if surplus := why_too_many(fields, layout.most):
            return "fields", surplus
        if why:
            return "number", why
        fields += [""] * (
            max(layout.chosen.places) + 1 - len(fields)
        )  # a row may end before the accelerometer's fields, which then count as empty
        chosen = [fields[place].strip().strip('"').strip() for place in layout.chosen.places]
        if layout.separator != ",":
            self._note_decimal(chosen[: len(layout.chosen.needed)])
            if any(("." if self._decimal == "," else ",") in field for field in chosen):
                return (
                    "number",
                    f"{shown(begin)} has both decimal commas and points, or changes the decimal sign.",
                )
        return [_number(field, layout.separator) for field in chosen]

    def _note_decimal(self, fields: Sequence[str]) -> None:
        """Remember the decimal sign of the first number that has one."""
        if not self._decimal:
            self._decimal = next((mark for mark in ".," if any(mark in field for field in fields)), "")

    def _is_empty(self, text: str) -> bool:
        """Return whether a line is blank or a comment."""
        blank = not text.strip(" \r") if self.layout.separator == "\t" else is_blank(text)
        return blank or is_comment(text)


def _number(field: str, separator: str | None) -> float:
    """Return the number in a field, or NaN."""
    text = field.replace(",", ".") if separator != "," and DECIMAL_COMMA.fullmatch(field) else field
    if is_missing(text) or not is_number(text):
        return math.nan
    return float(text)


def _of_named(
    layout: Layout, parse: Callable[[str], Mapping[str, Any]], text: str
) -> list[float] | WhyNot | None:
    try:
        found = parse(text)
    except (ValueError, RecursionError):
        if not text.lstrip().startswith("{"):
            return "text", f"{shown(text)} is no object."
        return "number", f"{shown(text)} is no object with numbers."
    chosen = layout.chosen
    names = chosen.read[: len(chosen.needed)]
    if lacking := [name for name in names if name not in found]:
        # a line with none of the labels to read is skipped without a warning: boards write other quantities,
        # such as a temperature, on lines of their own
        if parse is values_in:
            return (
                None if len(lacking) == len(names) else ("fields", f"has no number for {shown(lacking[0])}.")
            )
        return "columns", f"is an object without {shown(lacking[0])}."
    values = [found.get(name) for name in chosen.read]
    if not {type(value) for value in values[: len(names)]} <= {int, float, type(None)}:
        return "number", f"{shown(text)} has values that are not numbers."
    try:
        return [float(value) if isinstance(value, int | float) else math.nan for value in values]
    except OverflowError:
        return "number", f"{shown(text)} has a number that is too large."


def end_of_line(data: bytes, begin: int) -> int:
    """Return the end of the line that begins at byte `begin`; the last line may lack a line end."""
    end = data.find(b"\n", begin)
    return len(data) if end < 0 else end


def decoded(line: bytes) -> str:
    """Return a line as text, read as UTF-8 or, if it is not, in the Windows encoding.

    The encoding matters since units have signs beyond ASCII.
    """
    try:
        return line.decode()
    except UnicodeDecodeError:
        return line.decode("cp1252", "replace")
