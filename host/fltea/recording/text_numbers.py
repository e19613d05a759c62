"""One row of text, or many at once, as numbers.

Many lines at once are read by numpy's own reader: a million rows of four numbers take 0.28 s of processor
time, where a loop takes 1.2 s (pyarrow's reader takes 0.26 s in one thread: too little for two ways). What it
does not take, such as empty fields and comments, is cleaned first. Only what is still not taken, and what
comes in a few lines, goes line by line.
"""

import csv
import io
import math
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from fltea.recording.columns import DECIMAL_COMMA, is_missing, is_number
from fltea.recording.lines import shown
from fltea.recording.sample_times import Floats
from fltea.recording.text_labels import values_in
from fltea.recording.text_layout import (
    Layout,
    is_blank,
    is_comment,
    why_no_row,
    why_too_many,
)

COMMENT_MARKS = b"#", b"%", b"//"
COMMON_EMPTY = b"", b"NA", b"null"
MISSING_WORDS = r"na|n/a|null|none"

SAMPLE_BEGINS = '0123456789+-.,;"{'
"""With what a line begins that was meant as a sample (or with `nan`), if its fields are too few."""

WhyNot = tuple[str, str]
"""Why a line holds no sample: the key of its count, and a text with what the line holds."""


class RowParser:
    """Reads lines of one layout.

    Once a number has a decimal comma or a decimal point, all later ones have to have the same.
    """

    def __init__(self, layout: Layout) -> None:
        self.layout = layout
        self._decimal = ""
        if layout.separator is None:
            self._empty = re.compile(rf"(?<!\S)(?:{MISSING_WORDS})(?!\S)", re.I)
        else:
            s = re.escape(layout.separator)
            self._empty = re.compile(
                rf'(?:^|(?<={s})) *(?:{MISSING_WORDS}|""|) *(?=[\r ]*$|{s})', re.I | re.M
            )

    def many(self, data: bytes, count: int) -> tuple[Sequence[int], Floats] | None:
        """So many lines at once: which of them are rows, and their numbers.

        None if one of them needs a closer look.
        """
        if self.layout.parse is not None:
            return None
        values = self._at_once(data, count, clean=False)
        if values is not None:
            return range(count), values
        lines = data.split(b"\n")
        keep = [k for k, line in enumerate(lines) if not self._is_empty(decoded(line))]
        if not keep:
            return None
        rest = b"\n".join([lines[k] for k in keep])
        values = self._at_once(self._filled(rest), len(keep))
        if values is None:
            values = self._at_once(self._empty.sub("nan", decoded(rest)).encode(), len(keep))
        return None if values is None else (keep, values)

    def one(self, text: str) -> list[float] | WhyNot | None:
        """The numbers in one line; why it holds no sample; or None, if it is empty or a comment."""
        layout = self.layout
        if layout.parse is not None:
            return None if self._is_empty(text) else _of_named(layout, layout.parse, text)
        separator = layout.separator
        if '"' not in text and "_" not in text and text.isascii() and (separator == "," or "," not in text):
            fields = text.split(separator)
            if len(fields) == layout.usual <= layout.most and self._decimal != "," and text[:1] not in "#%/":
                try:
                    values = [float(fields[place]) for place in layout.chosen.places]
                except ValueError:
                    pass
                else:
                    if not self._decimal and "." in text and separator != ",":
                        self._note_decimal([fields[place] for place in layout.chosen.places])
                    return values
        return None if self._is_empty(text) else self._closely(text)

    def _closely(self, text: str) -> list[float] | WhyNot:
        layout = self.layout
        begin = text.lstrip()
        was_meant = begin[:1] in SAMPLE_BEGINS or begin[:3].lower() == "nan"
        try:
            if layout.separator is None:
                fields = text.split()
            elif '"' in text:
                fields = next(csv.reader([text], delimiter=layout.separator, strict=True), [])
            else:
                fields = text.split(layout.separator)
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
        fields += [""] * (max(layout.chosen.places) + 1 - len(fields))  # the accelerometer's may be missing
        chosen = [fields[place].strip().strip('"').strip() for place in layout.chosen.places]
        if layout.separator != ",":
            self._note_decimal(chosen[: len(layout.chosen.needed)])
            if any(("." if self._decimal == "," else ",") in field for field in chosen):
                return "number", f"{shown(begin)} has both decimal commas and points, or others than before."
        return [_number(field, layout.separator) for field in chosen]

    def _note_decimal(self, fields: Sequence[str]) -> None:
        """Once a number has a decimal comma or a point, all others have to have it, too."""
        if not self._decimal:
            self._decimal = next((mark for mark in ".," if any(mark in field for field in fields)), "")

    def _at_once(self, data: bytes, rows: int, *, clean: bool = True) -> Floats | None:
        """All lines by numpy's reader; None if one of them needs a closer look."""
        layout = self.layout
        separator, decimal = layout.separator, self._decimal
        surplus = layout.usual - layout.most
        if separator is not None and surplus > 0:  # separators at the ends of lines
            end = separator.encode() * surplus
            data = data.replace(end + b"\n", b"\n").replace(end + b"\r\n", b"\r\n")
            data = data.removesuffix(b"\r").removesuffix(end)
        if not clean and any(mark in data for mark in COMMENT_MARKS):
            return None
        if not _are_alike(data, separator, min(layout.usual, layout.most), rows):
            return None
        if separator != ",":
            commas, points = b"," in data, b"." in data
            if (commas and (points or decimal == ".")) or (points and decimal == ","):
                return None
            decimal = "," if commas else "." if points else decimal
            data = data.replace(b",", b".") if commas else data
        try:
            values: Floats = np.loadtxt(
                io.StringIO(data.decode()),
                delimiter=separator,
                usecols=layout.chosen.places,
                comments=None,
                quotechar='"',
                ndmin=2,
            )
        except ValueError:  # UnicodeDecodeError is one
            return None
        if len(values) != rows:
            return None
        self._decimal = decimal
        return values

    def _is_empty(self, text: str) -> bool:
        """Whether a line is blank or a comment."""
        blank = not text.strip(" \r") if self.layout.separator == "\t" else is_blank(text)
        return blank or is_comment(text)

    def _filled(self, data: bytes) -> bytes:
        """With nan in most of the empty fields; a regular expression, which finds all, takes its time."""
        if self.layout.separator is None:
            return data
        s = self.layout.separator.encode()
        for word in COMMON_EMPTY:
            for end in (s, b"\n", b"\r\n"):
                data = data.replace(s + word + end, s + b"nan" + end)
            data = data.replace(s + word + s, s + b"nan" + s)  # every second of a row of them was left
        return data


def _are_alike(data: bytes, separator: str | None, fields: int, rows: int) -> bool:
    """Whether data are so many lines, each of so many fields."""
    signs = np.frombuffer(data, np.uint8)
    ends = np.flatnonzero(signs == ord("\n"))
    if len(ends) != rows - 1:
        return False
    if separator is None:
        blank = signs <= ord(" ")
        marks, each = np.flatnonzero(~blank & np.concatenate([[True], blank[:-1]])), fields
    else:
        marks, each = np.flatnonzero(signs == ord(separator)), fields - 1
    if len(marks) != rows * each or not each:
        return len(marks) == rows * each
    of_line = marks.reshape(rows, each)
    return bool((of_line[1:, 0] > ends).all() and (of_line[:-1, -1] < ends).all())


def _number(field: str, separator: str | None) -> float:
    """What a field holds, NaN where that is no number."""
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
        if parse is values_in:  # a board writes other quantities on lines of their own
            return (
                None if len(lacking) == len(names) else ("fields", f"has no number for {shown(lacking[0])}.")
            )
        return "columns", f"is an object without {shown(lacking[0])}."
    values = [found.get(name) for name in chosen.read]
    if not {type(value) for value in values[: len(names)]} <= {int, float, type(None)}:
        return "number", f"{shown(text)} has other values than numbers."
    try:
        return [float(value) if isinstance(value, int | float) else math.nan for value in values]
    except OverflowError:
        return "number", f"{shown(text)} has a number that is too large."


def decoded(line: bytes) -> str:
    """A line as text: UTF-8, or what Windows writes, for units have signs that are not ASCII."""
    try:
        return line.decode()
    except UnicodeDecodeError:
        return line.decode("cp1252", "replace")
