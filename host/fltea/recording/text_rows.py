"""Text as rows of numbers, from bytes that are cut anywhere: a file, a pipe, or what a board writes (pure).

A line that holds no sample is counted by its reason and left out; what looks like a sample and cannot be read
stands for a lost one, so it takes a number.
"""

import codecs
import re
from collections import Counter
from typing import NamedTuple

import numpy as np

from fltea.recording.columns import Chosen, wanted_of
from fltea.recording.files import Note
from fltea.recording.lines import LONGEST_LINE, shown
from fltea.recording.sample_times import Floats, Ints
from fltea.recording.suggest import hint_for, with_hint
from fltea.recording.table import Rows
from fltea.recording.text_layout import Layout, LayoutFinder, header_of
from fltea.recording.text_numbers import RowParser, decoded, end_of_line
from fltea.recording.text_times import A_CLOCK, with_seconds
from fltea.records.errors import UsageError
from fltea.settings.how import How

BOM, UTF_16 = b"\xef\xbb\xbf", (b"\xff\xfe", b"\xfe\xff")
SAMPLE_LINES, SAMPLE_BYTES = 60, 1 << 14
"""Of what comes first, which tells what the columns may be."""

ONE_DOCUMENT = re.compile(rb'\s*(?:\[\s*[\[{]|\{\s*\n|\{\s*"[^"]*"\s*:\s*(?:\[\s*["\[{]|\{\s*"0"))')
"""How an array of objects begins, an object over several lines, and one of columns, as pandas writes it."""

HEAD_BYTES = 256

NO_NAME = "0123456789+-."
"""With what a line of names does not begin."""

REASONS = {
    "text": "is no line of numbers",
    "fields": "has another number of fields than the others",
    "number": "has a field that is not a number",
    "columns": "is an object without the columns",
    "too_long": f"has no end within {LONGEST_LINE} bytes",
    "before_header": "came before the columns were known",
    "header": "names columns that do not fit those before",
    "not_finite": "has an empty field, NaN or infinity: a missing sample",
    "too_large": "is beyond what a gyroscope measures; are the units right?",
    "time": "has a time that cannot be",
}
"""Why a line holds no sample: the key of its count in `link.bad_frames`, and words for the user.

The last three are found where rows become samples (`fltea.recording.table`).
"""


OF_PHONE = How(columns=["x", "y", "z"], units="rad/s", time_column="seconds_elapsed")
"""How to read a gyroscope of the app Sensor Logger, whose files of all sensors have the same names."""


class Bad(NamedTuple):
    """A line without a sample. line: its number, from 1. why: in full, with what the line holds."""

    line: int
    reason: str
    why: str


def _is_of_phone(where: str, line: str) -> bool:
    """Whether a first line is of the app Sensor Logger, and the file's name says that it is a gyroscope's."""
    names = {name.strip() for name in line.split(",")}
    return {"seconds_elapsed", "x", "y", "z"} <= names and "gyro" in where.rpartition("/")[2].lower()


class TextReader:
    """Turns bytes into rows. where: for messages. how: what the user says of the columns.

    counts: lines without a sample by their reason, but for the last three of `REASONS`. first, newest: the
    first and the newest of them. cut: what the user has to know of the last line, if it has no end and is no
    row, and so is left out. lines: how many there were so far. notes: the same of the columns. chosen: the
    columns that are read, which stay what they are; None as long as no line has said it.

    Raises:
        UsageError: `how` is wrong.
    """

    def __init__(self, where: str, how: How) -> None:
        self._wanted = wanted_of(how)
        self.layout: Layout | None = None
        self.counts: Counter[str] = Counter()
        self.first: Bad | None = None
        self.newest: Bad | None = None
        self.cut: Note | None = None
        self.lines = 0
        self.notes: list[Note] = []
        self._where, self._how = where, how
        self._finder = LayoutFinder(where, how)
        self.chosen: Chosen | None = None
        self._parser: RowParser | None = None
        self._ordinal = 0
        self._begins = self._skipping = False
        self._rest = self._head = b""
        self._utf_16: codecs.IncrementalDecoder | None = None
        self._sample: list[str] = []

    @property
    def left_out(self) -> int:
        """How many lines hold no sample, without those before the columns were known."""
        return self.counts.total() - self.counts["before_header"]

    def resume(self, *, within_line: bool) -> None:
        """The sender was lost and is back; within_line: what comes first may be the end of a line."""
        self._rest, self._skipping = b"", within_line

    def with_hint(self, error: UsageError) -> UsageError:
        """An error with the options that probably read what came first."""
        return with_hint(error, hint_for(self._sample, self._how))

    def refusal(self) -> UsageError:
        """Why there was no row so far."""
        return self.with_hint(self._refusal())

    def _refusal(self) -> UsageError:
        if ONE_DOCUMENT.match(self._head):
            return UsageError(
                f"{self._where}: is one document of JSON; of a stream only an object a line is read. "
                "Write it to a file, and read that: cat > recording.json, then -s replay:recording.json"
            )
        if self.first is None or (self.chosen is None and self.first.reason != "too_long"):
            return self._finder.refusal()
        return UsageError(f"{self._where}:{self.first.line}: {self.first.why}")

    def feed(self, data: bytes) -> list[Rows]:
        """Take bytes; the rows in the lines that end in them.

        Raises:
            UsageError: the first line that names the columns does not say clearly which are meant.
        """
        if not self._head:
            self._head = data[:HEAD_BYTES]
            if data.startswith(UTF_16):  # as PowerShell and Excel's "Unicode text" write it
                self._utf_16 = codecs.getincrementaldecoder("utf-16")("replace")
        if self._utf_16 is not None:
            data = self._utf_16.decode(data).encode()
        if self._skipping:
            _, end, data = data.partition(b"\n")
            if not end:
                return []
            self._skipping = False
        whole, end, rest = data.rpartition(b"\n")
        if end:
            whole, self._rest = self._rest + whole, rest
        else:
            self._rest += data
        found = self._take(whole) if end else []
        if len(self._rest) > LONGEST_LINE:
            self.lines += 1
            why = f"the line has no end within {LONGEST_LINE} bytes. Is it another kind of file, or damaged?"
            self._count(Bad(self.lines, "too_long", why))
            self._rest, self._skipping = b"", True
        return found

    def finish(self) -> list[Rows]:
        """The sender has ended: its last line may lack its end."""
        rest, self._rest = self._rest, b""
        if not rest:
            return []
        before, first, newest = self.counts.copy(), self.first, self.newest
        found = self._take(rest)
        if not found and self.chosen is not None and self.counts != before:
            self.counts, self.first, self.newest = before, first, newest
            text = f"{self._where}:{self.lines}: the last line is cut off, and left out."
            self.cut = Note("cut_recording", text)
        return found

    def _take(self, data: bytes) -> list[Rows]:
        """Whole lines, without the end of the last one."""
        if b":" in data and A_CLOCK.search(data):
            data = with_seconds(decoded(data)).encode()
        if len(self._sample) < SAMPLE_LINES:
            self._sample += decoded(data[:SAMPLE_BYTES]).split("\n")
        found = []
        at = 0
        while at <= len(data):
            if self.layout is None:
                at = self._find(data, at)
            if at <= len(data):
                assert self._parser is not None
                rows, at = self._read(self._parser, data, at)
                if rows is not None:
                    found.append(rows)
        return found

    def _find(self, data: bytes, begin: int) -> int:
        """Look for the first row; where it begins, beyond the end if there is none."""
        while begin <= len(data):
            end = end_of_line(data, begin)
            line = data[begin:end]
            if self.lines == 0:
                line = line.removeprefix(BOM)
            text = decoded(line)
            if self.lines == 0 and not self._how.of_text and _is_of_phone(self._where, text):
                self._how = OF_PHONE
                self._wanted, self._finder = wanted_of(OF_PHONE), LayoutFinder(self._where, OF_PHONE)
            try:
                layout = self._finder.take(self.lines + 1, text)
            except UsageError as error:
                if self.chosen is None:
                    raise self.with_hint(error) from None
                self._count(Bad(self.lines + 1, "header", str(error)))
                layout = None
            if layout is not None and self._is_as_before(layout.chosen):
                self._begin(layout)
                return begin
            self.lines += 1
            if layout is not None:
                self._count(Bad(self.lines, "header", f"other columns than before: {shown(text)}"))
                self._finder = LayoutFinder(self._where, self._how)
            elif self._finder.is_other:
                self._count(Bad(self.lines, "before_header", f"came before the columns: {shown(text)}"))
            begin = end + 1
        return begin

    def _is_as_before(self, chosen: Chosen) -> bool:
        """Whether the columns of a new header can go on where those of the one before ended."""

        def kind(of: Chosen) -> tuple[object, ...]:
            return len(of.gyro), of.lsb, of.time is None, of.time_unit, len(of.accel)

        return self.chosen is None or kind(chosen) == kind(self.chosen)

    def _begin(self, layout: Layout) -> None:
        self._begins = True
        self.chosen = self.chosen or layout.chosen
        self.layout, self._parser = layout, RowParser(layout)
        self.notes += layout.notes

    def _read(self, parser: RowParser, data: bytes, at: int) -> tuple[Rows | None, int]:
        """The rows in lines from a byte on, up to a new header; and where that begins, if there is one."""
        numbers: list[Ints] = []
        values: list[Floats] = []
        ordinals: list[Ints] = []

        def keep(rows: Ints, of_rows: Floats) -> None:
            numbers.append(self.lines + 1 + rows)
            values.append(of_rows)
            ordinals.append(self._ordinal + np.arange(len(rows)))
            self._ordinal += len(rows)

        while at <= len(data):
            plain = parser.plain(data, at)
            if len(plain.rows):
                keep(plain.rows, plain.values)
            self.lines += plain.passed
            at = plain.next
            if at > len(data):
                break
            end = end_of_line(data, at)
            text = decoded(data[at:end])
            found = parser.one(text)
            if isinstance(found, list):
                keep(np.zeros(1, np.int64), np.array([found]))
            elif found is not None:
                if self._is_header(parser, text):
                    self.layout, self._finder = None, LayoutFinder(self._where, self._how)
                    break  # the sender has begun again
                self._ordinal += found[0] not in ("text", "columns")
                self._count(Bad(self.lines + 1, *found))
            self.lines += 1
            at = end + 1
        if not values:
            return None, at
        begins, self._begins = self._begins, False
        scaled = parser.layout.chosen.scale(np.concatenate(values))
        return Rows(np.concatenate(numbers), scaled, np.concatenate(ordinals), begins), at

    def _is_header(self, parser: RowParser, text: str) -> bool:
        might_be = parser.layout.parse is None and text.lstrip()[:1] not in NO_NAME
        return might_be and header_of(text, self._wanted) is not None

    def _count(self, bad: Bad) -> None:
        self.counts[bad.reason] += 1
        self.newest = bad
        if self.first is None or (self.first.reason == "before_header" and bad.reason != "before_header"):
            self.first = bad
