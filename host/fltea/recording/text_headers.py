"""Remembers the headers of a text, which are its lines of column names, and the columns below each."""

from collections.abc import Sequence

from fltea.recording.columns import Chosen
from fltea.recording.other_columns import OtherColumns
from fltea.recording.row_layout import Layout
from fltea.recording.text_layout import LayoutFinder
from fltea.recording.text_numbers import decoded
from fltea.settings.how import How

SAMPLE_LINES, SAMPLE_BYTES = 2000, 1 << 18
"""To find out what the columns hold, at most SAMPLE_LINES of a text's first lines are kept, and at most
SAMPLE_BYTES bytes of each piece of the text.
"""

MOST_CHECKS, MOST_HEADERS = 200, 64
"""At most MOST_CHECKS lines in a block are examined to find out whether they are headers. A file may have at
most MOST_HEADERS different headers.
"""

NO_NAME = "0123456789+-."
"""Characters with which a line of names cannot begin."""


class Headers:
    """The headers of a text so far. `where`: file, for messages.

    `head`: lines that describe the rows, but do not stand in this text (in another sheet of a workbook).
    `sample`: the first lines of the text, which show what the columns hold. `finder`: finds the first row
    below the newest header.
    `chosen`: the columns that are read. None until a line determines the columns, and unchanged afterwards.
    `layouts`: for each header, the layout of the rows below it, or None if its columns do not fit those of
    the first header.
    `checks`: how many more lines of this block may be examined to find out whether they are headers.
    `others`: leaves out the rows below names of other columns.
    """

    def __init__(self, where: str, how: How, head: Sequence[str]) -> None:
        self._where, self._how = where, how
        self.sample: list[str] = []
        self.finder = LayoutFinder(where, how, lambda: self.sample, head=head)
        self.chosen: Chosen | None = None
        self.layouts: dict[str, Layout | None] = {}
        self.checks = 0
        self.others = OtherColumns(self._is_of_gyro)
        self._begin = 0

    def begin_block(self, data: bytes) -> None:
        """Begin the next part of the text. If it is near the beginning, keep its lines in `sample`."""
        self.checks = MOST_CHECKS
        if len(self.sample) < SAMPLE_LINES:
            lines = decoded(data[:SAMPLE_BYTES]).split("\n")
            is_cut = len(data) > SAMPLE_BYTES and len(lines) > 1
            self.sample += lines[: min(len(lines) - is_cut, SAMPLE_LINES)]

    def is_header(self, layout: Layout, text: str) -> bool:
        """Return whether a line among rows of this layout is a further line of column names.

        Only a limited number of lines is examined, since the examination is slow.
        """
        might_be = layout.parse is None and text.lstrip()[:1] not in NO_NAME
        if not might_be or not self.checks or len(self.layouts) >= MOST_HEADERS:
            return False
        self.checks -= 1
        return self.finder.header_of(text) is not None

    def _is_of_gyro(self, text: str) -> bool:
        """Return whether a line names the columns to read.

        If the rows have no such line above them, any line that stands above them counts.
        """
        if self.finder.header_of(text) is not None or text in self.layouts:
            return True
        return not self.layouts and text in (line.strip() for line in self.sample[: self._begin])

    def look_for_next(self) -> None:
        """Examine the following lines as those after another header."""
        self.finder = LayoutFinder(self._where, self._how, lambda: self.sample, self.finder)

    def is_as_before(self, chosen: Chosen) -> bool:
        """Return whether the columns below a new header fit those below the first header.

        They fit if gyroscope and accelerometer have as many axes as before, the counts in 1 deg/s are the
        same, and the times have the same unit.
        """

        def kind(of: Chosen) -> tuple[object, ...]:
            return len(of.gyro), of.unit.lsb, of.time is None, of.clock.unit, len(of.accel)

        return self.chosen is None or kind(chosen) == kind(self.chosen)

    def use(self, layout: Layout) -> None:
        """Read the rows below a header by this layout."""
        if self.chosen is None:
            self.chosen, self._begin = layout.chosen, layout.begin - 1
            self.others.begin(layout, self.sample[: self._begin])
        if layout.again:
            self.layouts[layout.again[0]] = layout

    def refuse(self, layout: Layout) -> None:
        """Leave out the rows of a layout, since its columns do not fit those below the first header."""
        self.layouts.update(dict.fromkeys(layout.again[:1]))
        self.look_for_next()
