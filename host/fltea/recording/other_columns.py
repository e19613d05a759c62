"""Leaves out the rows of a text that stand below a line with the names of other columns, or with other facts.

Some programs write one file in blocks: first the rows of the gyroscope, then a line that names the columns
of, say, the accelerometer, and its rows. Without the names, the rows of both look alike. A later block may
also state another unit or another sampling rate, for instance if two files were joined.
"""

import re
from collections.abc import Callable, Iterator, Sequence
from typing import Literal, NamedTuple

from fltea.recording.column_names import accel_axis_of, axis_of, is_time, unit_in
from fltea.recording.other_facts import (
    are_first_names,
    contradict,
    may_say_otherwise,
    names_say_otherwise,
    ranges_in,
    said,
)
from fltea.recording.raw_lines import shown
from fltea.recording.row_layout import Layout
from fltea.recording.text_fields import COMMENTS, is_comment, separator_of, split, units_in, words_with_units
from fltea.recording.text_numbers import decoded
from fltea.recording.units import is_unit
from fltea.recording.wanted import is_missing, is_number

_OF_WORDS = re.compile(
    rb"\n[ \t]*(?:(?:[-=*+~;!<>\[(]+[ \t]*)?"
    rb'["#%/A-Za-z_\x80-\xff](?:[^\n,;\t ]|[,;\t ](?![-+.]?\d))*(?=\n|\Z)'
    rb"|(?:[#%]|//|[A-Za-z][^\n,;\t\d:=]{1,60}[:=])[^\n]*)"
)
"""Matches a line that begins with a word, perhaps after signs as in `[accel]`, and has no field that begins
with a number; a comment; or a line that begins with words and a colon.
"""

_OF_NUMBERS = b'0123456789+-.,;eE" \t\r\n'
"""Characters of rows of numbers. If a block of lines has no others, it has no words; this is quickly seen."""

_NO_WORD = ("", *"0123456789+-.,;\t")

_NAME = re.compile(r"[^\W\d]\w*(?:[ ./-]\w+)*(?:\s*[\[({<].*[\])}>])?")


def _title(of: str) -> re.Pattern[str]:
    """Compile a pattern for a line that says of which sensor the rows below it are."""
    before, behind = r"raw|calibrated|sensor|data|block|the", r"data|readings?|samples?|sensor|values"
    return re.compile(
        rf"\W*(?:(?:{before})\W+)*(?:{of})(?:\W+(?:{behind}))?"
        r"(?:\s*[\[(][^\[\]]*[\])]|\W{1,3}in\W{1,3}(?P<unit>\S{1,20}?))?\W*",
        re.I,
    )


_OF_GYRO = _title(
    r"gyro(?:scope|skop)?s?|angular\W?(?:velocity|rate)|rotation\W?rate"
    r"|drehraten?|winkelgeschwindigkeit(?:en)?|gir[oó]scopo"
)
_OF_OTHER = _title(
    r"(?:linear\W?)?acc(?:el(?:eration|erometer)?)?s?|mag(?:netometer|netic\W?field)?s?|gravity|orientation"
    r"|beschleunigung(?:en|ssensor)?|magnetfeld|acc[eé]l[eé]r(?:ation|om[eè]tre)|aceler(?:[oó]metro|aci[oó]n)"
)

MOST_CHECKS, MOST_KNOWN = 200, 1000
"""At most MOST_CHECKS different lines in a block are examined, and at most MOST_KNOWN are remembered."""

_Kind = Literal[
    "names",
    "gyroscope",
    "gyroscope, facts",
    "other names",
    "other title",
    "facts",
    "other facts",
    "unclear",
    "",
]
"""Kind of a line: names of columns as above the first row; names or a title of the gyroscope or of others; a
title with the unit that is read; the unit or the rate as known before, or another one; a comment that has
another unit and words that no rule understands.
"""

MOST_UNCLEAR = 3
"""At most this many comments of kind "unclear" are noted."""


class LeftOut(NamedTuple):
    """`rows` lines that are left out, from number `line` on, from 1. `why`: reason, for the user."""

    line: int
    rows: int
    why: str


class OtherColumns:
    """Finds lines that name other columns than the gyroscope's, or another unit or rate.

    The rows below them are left out, up to a line that names the gyroscope's columns again.

    `is_header`: function that returns whether a line names the columns to read, or stood above the first row.
    """

    def __init__(self, is_header: Callable[[str], bool]) -> None:
        self._is_header = is_header
        self._known: dict[str, _Kind] = {}
        self._layout: Layout | None = None
        self._below, self._is_titled, self._has_facts, self._checks = "", False, False, 0
        self._ends: list[int] = []
        self._ranges_dps: list[float] = []
        self._title_at = 0
        self._unclear: list[tuple[int, str]] = []

    def begin(self, layout: Layout, above: Sequence[str]) -> None:
        """Use the lines above the first row: they may hold a title of other rows.

        The title counts if nothing but the user's option says which columns are the gyroscope's.
        """
        self._ranges_dps = [range_dps for line in above for range_dps in ranges_in(line)]
        is_given = any(one.question == "columns" and one.evidence == "given" for one in layout.chosen.answers)
        titles = [line for line in above if _is(_OF_GYRO, line) or _is(_OF_OTHER, line)]
        if is_given and titles and not any(_is(_OF_GYRO, line) for line in titles):
            self._below, self._is_titled = shown(titles[-1].strip()), True

    def ended(self, line: int) -> list[int]:
        """Return the lines, up to this one, at which rows that were left out end; each line only once."""
        found = [end for end in self._ends if end <= line]
        del self._ends[: len(found)]
        return found

    def unclear(self) -> list[tuple[int, str]]:
        """Return the comments of which no rule tells what they say of the rows below, with their lines."""
        return self._unclear

    def only(self, layout: Layout, data: bytes, first: int) -> tuple[bytes, list[LeftOut]]:
        """Return whole lines, in which those that are left out are empty, so that line numbers stay the same.

        `first`: number of the first of these lines, from 1.
        """
        may_be = layout.parse is None and bool(data.translate(None, _OF_NUMBERS))
        words = list(_lines_of_words(data)) if may_be else []
        if not (words or self._below):
            return data, []
        if layout is not self._layout:
            self._layout = layout
            self._known.clear()
        lines, left_out = data.split(b"\n"), list[LeftOut]()
        self._checks, begin = MOST_CHECKS, 0
        for k in [*words, len(lines)]:
            before = self._below
            if k < len(lines):
                self._pass(layout, decoded(lines[k]).strip(), first + k)
            if before and (not self._below or k == len(lines)):
                rows = sum(1 for line in lines[begin:k] if line.strip())
                why = f"the rows below {before} are not of the columns, the unit or the rate that are read."
                left_out += [LeftOut(first + begin, rows, why)] if rows else []
                lines[begin:k] = [b""] * (k - begin)
                if not self._below:
                    self._ends.append(first + k)
            elif not before:
                begin = k
        return b"\n".join(lines), left_out

    def _pass(self, layout: Layout, text: str, line: int) -> None:
        """Decide whether the rows below a line are left out.

        A title of another sensor directly below one of the gyroscope begins no rows: both tell the units.
        """
        kind = self._kind(layout, text)
        if kind.startswith("gyroscope") and _is(_OF_GYRO, text):
            self._title_at = line
        if kind == "other title" and line == self._title_at + 1 and line > 1:
            return
        if kind == "unclear":
            is_new = not self._below and text not in (one for _, one in self._unclear)
            self._unclear += [(line, text)] if is_new and len(self._unclear) < MOST_UNCLEAR else []
        elif kind.startswith("other"):
            self._below = self._below or shown(text)
            self._is_titled |= kind == "other title"
            self._has_facts |= kind == "other facts"
        elif kind == "facts":
            self._has_facts = False
        elif kind == "gyroscope, facts":
            self._below, self._is_titled, self._has_facts = "", False, False
        elif (kind == "gyroscope" or (kind == "names" and not self._is_titled)) and not self._has_facts:
            self._below, self._is_titled = "", False

    def _kind(self, layout: Layout, text: str) -> _Kind:
        found = self._known.get(text)
        if found is None:
            self._checks -= 1
            found = self._examined(layout, text) if self._checks >= 0 else ""
            if len(self._known) < MOST_KNOWN and self._checks >= 0:
                self._known[text] = found
        return found

    def _examined(self, layout: Layout, text: str) -> _Kind:
        chosen, is_sure = layout.chosen, not layout.chosen.rate.overrule
        facts = said(text, chosen, self._ranges_dps) if is_sure else []
        if _is(_OF_GYRO, text):
            return "gyroscope" if not facts else "gyroscope, facts" if all(facts) else "other facts"
        if _is(_OF_OTHER, text):
            return "other title"
        names = _names_in(text, layout.separator)
        is_of_gyro = any(map(axis_of, names))
        is_again = text in layout.again[:1] or names == chosen.names
        units = None if is_again or is_of_gyro else units_in(text)
        if is_sure and units is not None and len(units) == len(chosen.names):
            above = layout.again[1].split(",") if layout.again else ()
            return "other names" if contradict(units, chosen, above) else ""
        if not is_again and is_comment(text) and names_say_otherwise(text, chosen):
            return "other names"
        if is_again or self._is_header(text):
            return "gyroscope" if is_of_gyro else "names"
        if are_first_names(names, chosen, layout.usual):
            return "gyroscope"
        is_loose = layout.separator is None or is_comment(text)
        if _are_others(names, chosen.names, layout.usual, is_loose=is_loose):
            return "other names"
        if not facts:
            return "unclear" if is_sure and may_say_otherwise(text, chosen) else ""
        return "facts" if all(facts) else "other facts"


def _is(title: re.Pattern[str], text: str) -> bool:
    """Return whether a line is a title, with a unit after "in" or without."""
    found = title.fullmatch(text)
    return found is not None and (found["unit"] is None or is_unit(found["unit"]))


def without_others(lines: Sequence[str], names: Sequence[str] | None, width: int) -> Sequence[str]:
    """Return the lines that do not stand below names of other columns.

    `names`: names of the `width` columns to read, None if they have none.
    """
    kept, is_other, is_titled, was_row = list[str](), False, False, False
    for line in lines:
        text = line.strip()
        if _is(_OF_GYRO, text) or _is(_OF_OTHER, text):
            is_other = is_titled = not _is(_OF_GYRO, text)
        elif text[:1] in _NO_WORD:
            was_row |= bool(text)
        elif was_row and not text.startswith("{"):
            separator = separator_of(line)
            found, is_loose = _names_in(text, separator), separator is None or is_comment(line)
            if found == [*(names or ())]:
                is_other = is_titled
            else:
                is_other |= _are_others(found, names or (), width, is_loose=is_loose)
        if not is_other:
            kept.append(line)
    return kept


def _lines_of_words(data: bytes) -> Iterator[int]:
    """Yield the index of each line of words."""
    line = at = 0
    for found in _OF_WORDS.finditer(b"\n" + data):
        line += data.count(b"\n", at, found.start())
        at = found.start()
        yield line


def _names_in(text: str, separator: str | None) -> list[str]:
    for mark in COMMENTS:
        text = text.removeprefix(mark)
    names = words_with_units(text) if separator is None else split(text, separator)
    while names and not names[-1]:
        names.pop()
    return names


def _are_others(found: list[str], names: Sequence[str], width: int, *, is_loose: bool) -> bool:
    """Return whether the fields of a line are names of columns.

    A single word, such as `error`, is none. As many words as there are columns are, and fewer or more if they
    begin as a line of names does, or if they are those of an accelerometer.

    `names`: names of the columns to read; `width`: their number. `is_loose`: whether a sentence may have such
    fields, since blanks separate them.
    """
    are_words = len(found) > 1 and not any(is_number(name) or is_missing(name) for name in found)
    if not are_words or len({name.lower() for name in found}) < len(found) or units_in("\t".join(found)):
        return False
    if sum(accel_axis_of(name) is not None for name in found) > 1:
        return True
    known = {name for name in names if not name.isdecimal()}
    marks = [name in known or is_time(name) or is_unit(unit_in(name)) for name in found]
    if len(found) != width:
        return len(found) > 2 and marks[0] and not is_loose
    return any(marks) or (not is_loose and all(map(_NAME.fullmatch, found)))
