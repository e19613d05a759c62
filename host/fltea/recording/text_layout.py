"""Finds the layout of a text: the separator between fields, the columns, and the first row.

Lines are examined one by one, so files and endless streams are read in the same way.
"""

import re
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from fltea.recording.axis_titles import without_titles
from fltea.recording.columns import Chosen, choose
from fltea.recording.dialects import dialect_of, may_be_of_a_dialect
from fltea.recording.evidence import axes_of
from fltea.recording.files import Note, listed
from fltea.recording.header_choices import Choices
from fltea.recording.named_lines import NamedLines
from fltea.recording.raw_lines import shown
from fltea.recording.row_kinds import RowKinds
from fltea.recording.row_layout import Layout, layout_of, why_no_row, why_too_many
from fltea.recording.text_fields import (
    COMMENTS,
    MOST_COLUMNS,
    all_numbers,
    is_blank,
    is_comment,
    separator_of,
    split,
    units_in,
    words_with_units,
)
from fltea.recording.text_labels import decode_object, values_in
from fltea.recording.text_refusal import names_above, refusal
from fltea.recording.text_so_far import MOST_BEFORE, TextSoFar
from fltea.recording.wanted import is_missing, is_number, wanted_of
from fltea.records.errors import UsageError
from fltea.settings.how import How

SEPARATORS = ("\t", ";", ",", None)
"""Possible separators of fields in a line; None is white space."""

WORDS = re.compile(r"[\s,;:={}\[\]]+")

ONE_WITH_UNIT = re.compile(r"[^\[\]()]+[\[(][^\[\]()]*[\])]")


class _Names(NamedTuple):
    """Names of columns that were found in a line.

    `is_loose`: whether some of `names` may be no names of columns: blanks separate them and so may split a
    name, or they stand in a comment.
    """

    names: list[str]
    separator: str | None
    is_loose: bool


@dataclass
class _Header:
    """Names of columns, with the line that holds the names (`text`) and the number of this line (`line`).

    `units`: units of the columns, if the line below holds them. `chosen`: the columns to read; None until the
    line below the header has been read, since it shows the number of fields.
    """

    line: int
    text: str
    names: list[str]
    separator: str | None
    is_loose: bool
    units: list[str] | None = None
    chosen: Chosen | None = None


class LayoutFinder:
    """Examines lines one after the other until a line is a row.

    `where`: file, for messages. `how`: the user's options. `sample`: function that returns the first lines of
    the text, as far as they are known.
    `before`: the finder that found the rows above these lines, if there are such rows.
    `head`: lines that describe the rows, but do not stand in this text (in another sheet of a workbook).
    `text`: what is known of the text so far.
    `is_other`: whether the newest line is neither empty, nor a comment, nor a part of a header.

    Raises:
        UsageError: `how` names too many columns, or one column twice.
    """

    def __init__(
        self,
        where: str,
        how: How,
        sample: Callable[[], Sequence[str]] = tuple,
        before: "LayoutFinder | None" = None,
        head: Sequence[str] = (),
    ) -> None:
        self.is_other = False
        self._how, self._wanted = how, wanted_of(how)
        text = TextSoFar(where, sample, None if before is None else before.text)
        self.text: TextSoFar = text
        text.head += head
        self._before: deque[tuple[int, str]] = deque(maxlen=MOST_BEFORE)
        self._header: _Header | None = None
        self._why_no_row = ""
        self._named = NamedLines(where, how, sample, text.facts, self._are_names)
        self._kinds: RowKinds = RowKinds(text, how.topic, None if before is None else before._kinds)
        self._choices: Choices = Choices() if before is None else before._choices
        self._had_rows = before is not None

    def take(self, number: int, line: str) -> Layout | None:
        """Examine the next line; return the layout if it is a row, else None.

        Raises:
            UsageError: a line names the columns, but the choice among them or their unit is ambiguous.
        """
        self.is_other, self.text.newest = False, line
        if is_blank(line):
            return None
        comment = is_comment(line)
        if not comment and line.lstrip().startswith("{"):
            found = _by_names(self._named.of_object(number, line), decode_object, number)
        else:
            numbers = not comment and all_numbers(line)
            header = None if numbers or self._kinds.are_of_dialect() else self.header_of(line)
            if header is not None:
                self._header = _Header(number, line.strip(), *header)
                return None
            if self._header is not None and self._header.chosen is None:
                units = None if numbers or self._header.units is not None else units_in(line)
                if units is not None and (not comment or len(units) == len(self._header.names)):
                    self._header.units = units
                    return None
                if not comment:
                    self._choose_named(line)
            found = None if comment else self._of_row(number, line)
            if found is None and not comment and self._header is None:
                found = _by_names(self._named.of_labels(number, line), values_in, number)
        if found is None:
            self._before.append((number, line))
            self.text.add_to_head(line)
            self.is_other = not comment
        return found

    def header_of(self, line: str) -> _Names | None:
        """Return the names of columns in a line; None if the line is no header."""
        return next(self._headers(line), None)

    def _headers(self, line: str) -> Iterator[_Names]:
        """Yield the names of columns in a line, once for each separator that may be between names."""
        # tabs are not stripped: a tab at the beginning means that the first column has no name
        text = line.strip(" \r\n")
        for mark in COMMENTS:
            text = text.removeprefix(mark) if len(mark) > 1 else text.lstrip(mark)
        if any(mark in text for mark in "\t;,"):
            separators = [separator for separator in SEPARATORS if separator is None or separator in text]
        # Blanks may separate names, or stand within a name. With the separator "\n", which occurs in no line,
        # the whole line is one name. This is tried first if the line ends in a unit: `rate z [deg/s]`.
        else:
            separators = ["\n", None] if ONE_WITH_UNIT.fullmatch(text) else [None, "\n"]
        for separator in separators:
            names = words_with_units(text) if separator is None else split(text, separator)
            if (
                separator is None
                and not self._wanted.by_position
                and any(is_number(name.strip(",;")) for name in names)
            ):
                continue  # these are labels with numbers, as in "gx: 1.5 gy: 0.2"
            if len(names) > MOST_COLUMNS:
                continue
            each = without_titles(names)
            for one in (each, names) if each != names else (names,):
                if self._are_names(one):
                    yield _Names(one, separator, separator is None or is_comment(line))

    def _are_names(self, names: Sequence[str], units: Sequence[str] = ()) -> bool:
        """Return whether the fields of a line are names of columns, including all columns to read."""
        wanted = self._wanted
        if wanted.columns is None:
            if wanted.labels(names) is None:
                return False
            return bool(axes_of(names, units)) or (
                may_be_of_a_dialect(names) and dialect_of(names, self.text.facts(names)) is not None
            )
        is_row = wanted.by_position and any(is_number(field) and not field.isdecimal() for field in names)
        return wanted.is_in(names) and not is_row

    def refusal(self) -> UsageError:
        """Return the error that explains why no line so far is a row."""
        why = self._why_no_row or self._named.why_not
        if self._header is not None or why:
            return UsageError(why or f"{self.text.where}: has a header but no rows.")
        lines = list(self.text.sample()) or self.text.head
        self.text.check_thousands(lines)
        return refusal(self.text.where, self._how, lines, self._kinds.of_text(), self.text.facts)

    def _choose_named(self, line: str) -> None:
        """Choose the columns by the header and by the line after it, which shows the number of fields."""
        self.text.check_thousands(self.text.sample())
        header, self._header = self._header, None  # reset at once, in case an error is raised below
        assert header is not None
        fields = split(line, separator_of(line))
        if 2 * sum(map(is_number, fields)) > len(fields):
            fitting = next((one for one in self._headers(header.text) if _fit(one, line)), None)
            if fitting is not None:
                header = _Header(header.line, header.text, *fitting, header.units)
            elif header.separator is None and any(mark in header.text for mark in "\t;,"):
                lines = header.text, *(["\t".join(header.units)] if header.units else ())
                self._before += enumerate(lines, header.line)
                self.text.head += lines
                return
        names, units = header.names, header.units
        beside = units if units is not None and len(units) == len(names) else None
        where, facts = f"{self.text.where}:{header.line}", self.text.facts(names)
        header.chosen = self._choices.of(
            (header.text, header.separator, units and tuple(units)),
            lambda: choose(where, names, beside, len(names), self._how, facts),
            had_rows=self._had_rows,
        )
        self._header = header

    def _of_row(self, number: int, line: str) -> Layout | None:
        header = self._header
        chosen = None if header is None else header.chosen
        if header is None or chosen is None:
            return self._of_row_without_names(number, line)
        names = header.names
        why = ""
        for separator in dict.fromkeys((separator_of(line, len(names)), header.separator)):
            fields = split(line, separator)
            if header.is_loose and (len(fields) < len(names) or any(fields[len(names) :])):
                found = (
                    f"has {len(fields)} fields, and the header names {len(names)} columns ({listed(names)}). "
                    "Write one name for each column, or give positions: --columns 2,3,4."
                )
            else:
                found = why_too_many(fields, len(names))
            timed, note = _without_dates(chosen, fields, self._how)
            found = found or why_no_row(timed, fields, separator)
            if not found:
                where = f"{self.text.where}:{number}"
                notes = (Note("row_times", f"{where}: {note}"),) if note else ()
                again = header.text, ",".join(header.units or ())
                return layout_of(timed, separator, fields, len(names), number, notes, again)
            why = why or found
        self._why_no_row = self._why_no_row or f"{self.text.where}:{number}: {why}"
        return None

    def _of_row_without_names(self, number: int, line: str) -> Layout | None:
        separator = separator_of(line)
        fields = split(line, separator)
        tag = self._kinds.tag_of(fields)
        if tag is None:
            return None
        if self._wanted.columns is None:
            if 2 * sum(map(is_number, fields)) <= len(fields):
                return None
            facts = self.text.facts(None, len(fields), tag)
            if dialect_of((), facts, tag=tag, fields=len(fields)):
                chosen = choose(f"{self.text.where}:{number}", None, None, len(fields), self._how, facts, tag)
                return layout_of(chosen, separator, fields, len(fields), number)
            return None
        if not self._wanted.is_at(fields):
            return None
        self.text.check_thousands(self.text.sample())
        at, names, units = names_above(self._before, len(fields))
        facts = self.text.facts(names, len(fields), tag)
        chosen = choose(f"{self.text.where}:{at or number}", names, units, len(fields), self._how, facts, tag)
        return layout_of(chosen, separator, fields, len(fields), number)


def _by_names(chosen: Chosen | None, parse: Callable[[str], Mapping[str, Any]], number: int) -> Layout | None:
    return None if chosen is None else Layout(chosen, None, parse, 0, 0, 0, number)


def _fit(header: _Names, row: str) -> bool:
    """Return whether a row has as many fields as a header has names. Empty fields at the end do not count."""
    count = len(header.names)
    rows = (split(row, separator) for separator in {separator_of(row, count), header.separator})
    return any(len(fields) >= count and not any(fields[count:]) for fields in rows)


def _without_dates(chosen: Chosen, fields: Sequence[str], how: How) -> tuple[Chosen, str]:
    """Return the chosen columns without the column of times, if this column cannot be used; and a warning.

    This is so if it holds words, the user did not name it, and the user gives the sampling rate. Otherwise,
    return the chosen columns, and no warning ("").
    """
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
    return chosen.without_times(), text + "are missing."
