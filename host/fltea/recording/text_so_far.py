"""Collects the facts that the lines of a text show before its first row, such as units and rate."""

from collections.abc import Callable, Sequence
from functools import cache

from fltea.recording.dialects import Facts
from fltea.recording.other_columns import without_others
from fltea.recording.text_fields import Thousands, cells_of, sample_of

MOST_BEFORE = 200
"""At most this number of lines before the first row are kept. One of them may name the columns."""


class TextSoFar:
    """The lines of a text that have been read so far.

    `where`: file, for messages. `sample`: function that returns the first lines of the text. `before`: the
    `TextSoFar` of the rows above these lines, if there are such rows.
    `head`: lines that are no rows, at most `MOST_BEFORE`. `newest`: the line that is examined.
    """

    def __init__(
        self, where: str, sample: Callable[[], Sequence[str]], before: "TextSoFar | None" = None
    ) -> None:
        self.where, self.sample = where, sample
        self.head: list[str] = [] if before is None else before.head
        self.newest = ""
        self._thousands: Thousands = Thousands() if before is None else before._thousands

    def add_to_head(self, line: str) -> None:
        """Keep a line that is no row."""
        if len(self.head) < MOST_BEFORE:
            self.head.append(line)

    def check_thousands(self, lines: Sequence[str]) -> None:
        """Refuse numbers with signs between their thousands, as in `1.000.010`, among the first lines.

        Raises:
            UsageError: a column has several different numbers of this form.
        """
        self._thousands.check(self.where, lines)

    def facts(self, names: Sequence[str] | None, width: int = 0, tag: str = "") -> Facts:
        """Return what is known of the file, to choose columns and their units by.

        `tag`: first field of the rows to read, if there are several kinds of rows.
        """
        count = width or len(names or ())
        rows = cache(lambda: without_others(self.sample(), names, count))
        return Facts(
            "\n".join(self.sample()[:MOST_BEFORE] if tag else [*self.head, self.newest]),
            self.where.rpartition("/")[2].rpartition(":")[0] or self.where.rpartition("/")[2],
            sample=cache(lambda: sample_of(rows(), names, count, tag)),
            cells=lambda place: cells_of(rows(), names, count, tag, place),
        )
