"""Reads text as rows of numbers, from bytes in pieces of any length: from a file, a pipe, or a board.

A line without a sample is left out, and is counted under the reason why it holds no sample. If such a line
was meant as a sample, one sequence number is left out, so that the numbers show the loss.
"""

import math
import re
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from fltea.recording.candidates import columns_table
from fltea.recording.columns import Chosen
from fltea.recording.files import Note
from fltea.recording.line_buffer import LineBuffer
from fltea.recording.line_counts import BadLines, RowNumbers
from fltea.recording.plain_text import PlainText
from fltea.recording.raw_lines import BOM, LONGEST_LINE, shown
from fltea.recording.row_layout import Layout
from fltea.recording.sample_times import Floats, Ints
from fltea.recording.sensor_lines import SensorLines
from fltea.recording.table import Rows, joined
from fltea.recording.text_fields import sample_of
from fltea.recording.text_headers import Headers
from fltea.recording.text_numbers import RowParser, WhyNot, decoded, end_of_line
from fltea.records.errors import UsageError
from fltea.settings.how import How

ONE_DOCUMENT = re.compile(rb'\s*(?:\[\s*[\[{]|\{\s*\n|\{\s*"[^"]*"\s*:\s*(?:\[\s*["\[{]|\{\s*"0"))')
"""Matches the beginning of a JSON document that cannot be read line by line. Such a document is an array, an
object over several lines, or columns as pandas writes them.
"""


FEWEST_BEFORE, FEWEST_COUNTS = 5, 20
"""Whether the last number is cut is judged by at least FEWEST_BEFORE numbers before it, or by at least
FEWEST_COUNTS if they are whole numbers.
"""

LAST = re.compile(rb"(?<![\w.])[-+]?(\d*)(\.?)(\d*)(?:([eE])[-+]?(\d*))?$", re.ASCII)
"""Matches the number at the end of a line."""


class TextReader:
    """Converts bytes of a text to rows. `where`: file, for messages. `how`: the user's options on columns.

    `head`: lines from elsewhere that describe the rows.
    `bad`: counts of the lines without a sample.
    `cut`: warning about a last line that is incomplete and left out, or None.
    `lines`: number of lines that were read so far. `notes`: warnings about the columns.

    Raises:
        UsageError: the options in `how` are impossible.
    """

    def __init__(self, where: str, how: How, head: Sequence[str] = ()) -> None:
        self.bad = BadLines()
        self.cut: Note | None = None
        self.lines = 0
        self.most_before = math.inf
        self.notes: list[Note] = []
        self._where = where
        self._buffer, self._numbers = LineBuffer(), RowNumbers()
        self._plain = PlainText(how.columns)
        self._headers = Headers(where, how, head)
        self._parser: RowParser | None = None
        self._sensors = SensorLines(where, how)

    @property
    def chosen(self) -> Chosen | None:
        """Columns that are read. None until a line determines the columns, and unchanged afterwards."""
        return self._headers.chosen

    @property
    def layout(self) -> Layout | None:
        """Layout by which rows are read.

        It is None while it is unknown: before the first row, and from a new header to the first row below it.
        """
        return None if self._parser is None else self._parser.layout

    @property
    def left_out(self) -> int:
        """Number of lines without a sample after the line that determined the columns."""
        return self.bad.left_out

    @property
    def pending_bytes(self) -> int:
        """Number of received bytes of the newest line, which has not ended yet."""
        return self._buffer.pending_bytes

    @property
    def partial(self) -> int:
        """Number of parts of lines that were dropped where a connection to the sender began or ended."""
        return self._buffer.partial

    def resume(self, *, within_line: bool) -> None:
        """Continue after the connection to the sender was lost and made again.

        `within_line`: whether the next bytes may begin within a line, whose rest is then dropped.
        """
        self._buffer.resume(within_line=within_line)

    def with_columns(self, error: UsageError) -> UsageError:
        """Return `error` with a table added to its text, which shows what the first rows hold."""
        chosen = self.chosen
        if chosen is None:
            return error
        values = sample_of(self._headers.sample, chosen.names, len(chosen.names), "")
        return type(error)("\n".join(filter(None, [str(error), columns_table(chosen.names, values)])))

    def refusal(self, *, is_file: bool = False) -> UsageError:
        """Return the error that explains why there has been no row yet."""
        is_document = ONE_DOCUMENT.match(self._buffer.begin) is not None
        if is_document and is_file:
            return UsageError(
                f"{self._where}: begins like one JSON document. Such a file is read if its name ends in "
                ".json; any other text is read line by line."
            )
        if is_document:
            return UsageError(
                f"{self._where}: is one JSON document; in a stream, each object must be one line. Write it "
                "to a file, and read that: cat > recording.json, then -s replay:recording.json"
            )
        if (error := self._sensors.why_none()) is not None:
            return error
        first = self.bad.first
        if first is None or (self.chosen is None and first.reason != "too_long"):
            return self._headers.finder.refusal()
        return UsageError(f"{self._where}:{first.line}: {first.why}")

    def feed(self, data: bytes) -> list[Rows]:
        """Take the next bytes of the text; return the rows in all lines that end in these bytes.

        Raises:
            UsageError: the first line that names the columns leaves the choice among them ambiguous.
        """
        return self._sensors.in_turn(self._feed(self._buffer.feed(data)))

    def _feed(self, whole: bytes | None) -> list[Rows]:
        """Read whole lines, if there are any. Drop and count a line that gets too long before it ends."""
        found = [] if whole is None else self._take(whole)
        if self._buffer.drops_too_long():
            self.lines += 1
            why = f"the line has no end within {LONGEST_LINE} bytes. Is it another kind of file, or damaged?"
            self.bad.add(self.lines, "too_long", why)
        return found

    def finish(self) -> list[Rows]:
        """Return the remaining rows at the end of the text. The last line may lack a line end."""
        return self._sensors.in_turn(self._finish()) + self._sensors.finish()

    def _finish(self) -> list[Rows]:
        found = self._feed(self._buffer.release())
        rest = self._buffer.finish()
        if self._buffer.is_cut:
            self.cut = Note("cut_recording", f"{self._where}: the last message is cut off, and left out.")
        before = self.bad.copy()
        is_cut = self.chosen is not None and not self._buffer.has_end
        is_cut = is_cut and is_cut_number(rest, self._buffer.tail.split(b"\n")[1:])
        if rest and not is_cut:
            found += self._take(rest)
        for held in self._plain.finish():
            found += self._rows_in(held)
        self.lines += is_cut
        if is_cut or (not found and self.chosen is not None and self.bad.counts != before.counts):
            self.bad = before
            text = f"{self._where}:{self.lines}: the last line is cut off, and left out."
            self.cut = Note("cut_recording", text)
        return found

    def _take(self, data: bytes) -> list[Rows]:
        """Read whole lines. The last line in `data` has no line end."""
        plain = self._plain.take(data, is_known=self._headers.chosen is not None)
        return [] if plain is None else self._rows_in(plain)

    def _rows_in(self, data: bytes) -> list[Rows]:
        pieces: list[Rows] = []
        at: int | None = 0
        self._headers.begin_block(data)
        is_examined = self._parser is not None
        if self._parser is not None:
            self._sensors.look_again(len(self._headers.sample), self._headers.finder.text.facts)
            data = self._sensors.only(self._parser.layout, self._of_gyro(self._parser.layout, data))
        while at is not None and at <= len(data):
            if self._parser is None:
                at = self._find(data, at)
                if at is None:
                    break
                if self.layout is not None and not is_examined:
                    data, at, is_examined = self._of_gyro(self.layout, data[at:]), 0, True
                if self._sensors.is_known and self.layout is not None:
                    data, at = self._sensors.only(self.layout, data[at:]), 0
            assert self._parser is not None
            at = self._read(self._parser, data, at, pieces)
        return _by_run(pieces)

    def _of_gyro(self, layout: Layout, data: bytes) -> bytes:
        """Leave out the rows that stand below names of other columns, and count them."""
        data, left_out = self._headers.others.only(layout, data, self.lines + 1)
        for one in left_out:
            self.bad.add(one.line, "header", one.why, one.rows)
        for line, comment in self._headers.others.unclear():
            text = f"{shown(comment)}: the rows below this comment are read as before."
            note = Note("reading", f"{self._where}:{line}: {text}")
            self.notes += [note] if note not in self.notes else []
        return data

    def _find(self, data: bytes, begin: int) -> int | None:
        """Find the first row after a header. Return the offset of the row, or None if no row has come yet."""
        headers = self._headers
        while begin <= len(data):
            if self.chosen is None and self.lines >= self.most_before:
                raise self.refusal()
            end = end_of_line(data, begin)
            line = data[begin:end]
            if self.lines == 0:
                line = line.removeprefix(BOM)
            text = decoded(line)
            if text.strip() in headers.layouts:
                self.lines += 1
                if (known := headers.layouts[text.strip()]) is not None:
                    self._begin(known)
                    return end + 1
                self.bad.add(self.lines, "header", f"other columns than before: {shown(text)}")
                begin = end + 1
                continue
            try:
                layout = headers.finder.take(self.lines + 1, text)
            except UsageError as error:
                if self.chosen is None:
                    raise
                self.bad.add(self.lines + 1, "header", str(error))
                layout = None
            if layout is not None and headers.is_as_before(layout.chosen):
                self._begin(layout)
                return begin
            self.lines += 1
            if layout is not None:
                self.bad.add(self.lines, "header", f"other columns than before: {shown(text)}")
                headers.refuse(layout)
            elif headers.finder.is_other:
                reason, what = "before_header", "came before the columns"
                # the header before this line is incomplete or does not fit its rows
                if self.chosen is not None:
                    reason, what = "fields", "does not fit the header before it"
                self.bad.add(self.lines, reason, f"{what}: {shown(text)}")
            begin = end + 1
        return None

    def _begin(self, layout: Layout) -> RowParser:
        self._numbers.begin()
        self._headers.use(layout)
        self.notes += [note for note in layout.notes if note not in self.notes]
        return self._go_on(layout)

    def _go_on(self, layout: Layout) -> RowParser:
        """Read the next rows by `layout`. Return the parser that does this."""
        self._sensors.begin(layout.chosen, len(self._headers.sample))
        self._parser = RowParser(layout)
        return self._parser

    def _read(self, parser: RowParser, data: bytes, begin: int, pieces: list[Rows]) -> int | None:
        """Read rows from byte `begin` on, up to a line with new names of columns.

        Return the offset of this line, or None if there is no such line in `data`.
        """
        headers = self._headers
        is_plain = is_first = (
            True  # becomes False after two lines that are no rows; lines are then read one by one until a row
        )
        while begin <= len(data):
            if is_plain:
                found = parser.plain(data, begin)
                self._add(parser.layout, found.rows, found.values, pieces)
                self.lines += found.passed
                begin, is_first = found.next, is_first or len(found.rows) > 0
                if found.goes_on:
                    continue
                if begin > len(data):
                    return None
            end = end_of_line(data, begin)
            if (known := parser.left_out(data[begin:end])) is not None:
                is_plain, is_first = is_first, False
                self._leave_out(known)
                begin = end + 1
                continue
            text = decoded(data[begin:end])
            values = parser.one(text)
            is_row = isinstance(values, list)
            is_plain, is_first = is_row or is_first, is_row
            if isinstance(values, list):
                self._add(parser.layout, np.zeros(1, np.int64), np.array([values]), pieces)
            elif (line := text.strip()) in headers.layouts or line in parser.layout.again:
                parser = self._names_again(parser, line, data, begin, end)
            elif values is not None:
                if headers.is_header(parser.layout, text):
                    self._parser = None
                    headers.look_for_next()
                    return begin
                if headers.checks:
                    parser.leave_out(data[begin:end], values)
                self._leave_out(values)
                begin = end + 1
                continue
            self.lines += 1
            begin = end + 1
        return None

    def _leave_out(self, why: WhyNot) -> None:
        """Count a line without a sample. If it was meant as a sample, let one sequence number be missing."""
        if why[0] not in ("text", "columns"):
            self._numbers.lose()
        self.lines += 1
        self.bad.add(self.lines, *why)

    def _names_again(self, parser: RowParser, line: str, data: bytes, begin: int, end: int) -> RowParser:
        """Handle a line of column names, or of units, that has occurred before.

        Return the parser for the rows below it. It is a new parser if the line names other columns.
        """
        known = self._headers.layouts.get(line)
        if known is not None:
            self._headers.others.ended(self.lines + 1)
            again = data.find(data[begin:end], end)
            self._numbers.repeat_header(data.count(b"\n", end + 1, again) if again > 0 else -1)
            if line != parser.layout.again[0]:
                parser = self._go_on(known)
        elif line in self._headers.layouts:
            self.bad.add(self.lines + 1, "header", f"other columns than before: {shown(line)}")
        return parser

    def _add(self, layout: Layout, rows: Ints, values: Floats, pieces: list[Rows]) -> None:
        if not len(rows):
            return
        numbers, values = self.lines + 1 + rows, layout.chosen.scale(values)
        ends = self._headers.others.ended(int(numbers[-1]))
        cuts = np.searchsorted(numbers, ends).tolist() if ends else []
        for k, (begin, end) in enumerate(pairwise([0, *cuts, len(rows)])):
            if k:
                self._numbers.repeat_header(-1)
            if end > begin:
                ordinal, begins = self._numbers.take(end - begin)
                pieces.append(Rows(numbers[begin:end], values[begin:end], ordinal, begins))


def is_cut_number(last: bytes, before: list[bytes]) -> bool:
    """Return whether the number at the end of a file's last line seems to lack digits.

    `last`: the line, which has no line end. `before`: the lines before it. A number is cut if it has fewer
    decimals than all numbers at their ends, which have the same number of decimals, or a shorter exponent
    than all of them, or fewer digits, if all are whole. Without this, 0. would be read for 0.397.
    """
    number, others = LAST.search(last), [LAST.search(line.rstrip()) for line in before]
    known = [one for one in others if one is not None and one[0]]
    if number is None or not number[0] or len(known) < max(len(others), FEWEST_BEFORE):
        return False
    decimals = {len(one[3]) for one in known}
    if all(one[4] for one in known):
        if number[4]:
            return len(number[5]) < min(len(one[5]) for one in known)
        return len(decimals) == 1 and len(number[3]) <= min(decimals)
    if number[4] or any(one[4] for one in known):
        return False
    if not any(one[2] for one in known):
        is_whole = not number[2] and len(known) >= FEWEST_COUNTS
        return is_whole and len(number[1]) < min(len(one[1]) for one in known)
    return len(decimals) == 1 and len(number[3]) < min(decimals)


def _by_run(pieces: list[Rows]) -> list[Rows]:
    """Join successive `Rows`, so that there is one `Rows` from each restart of the sender to the next."""
    found: list[list[Rows]] = []
    for piece in pieces:
        if piece.begins or not found:
            found.append([])
        found[-1].append(piece)
    return [joined(group) for group in found]
