"""Counts the lines of a text that hold no sample, and gives each row of samples its sample number."""

from collections import Counter
from typing import NamedTuple

import numpy as np

from fltea.recording.sample_times import Ints


class Bad(NamedTuple):
    """A line without a sample.

    `line`: line number, from 1. `reason`: key of the reason. `why`: the reason in words, with a part of the
    line.
    """

    line: int
    reason: str
    why: str


class BadLines:
    """Counts of the lines of a text that hold no sample.

    `counts`: number of such lines for each reason in `text_numbers.REASONS`, without the last three. These
    are for rows of numbers, which `table` counts. `first`, `newest`: the first and the newest such line.
    """

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()
        self.first: Bad | None = None
        self.newest: Bad | None = None

    @property
    def left_out(self) -> int:
        """Number of lines without a sample, counted from the line that determined the columns."""
        return self.counts.total() - self.counts["before_header"]

    def add(self, line: int, reason: str, why: str, count: int = 1) -> None:
        """Count a line without a sample, or `count` of them."""
        self.counts[reason] += count
        self.newest = Bad(line, reason, why)
        if self.first is None or (self.first.reason == "before_header" and reason != "before_header"):
            self.first = self.newest

    def copy(self) -> "BadLines":
        """Return a copy, which further lines do not change."""
        found = BadLines()
        found.counts, found.first, found.newest = self.counts.copy(), self.first, self.newest
        return found


class RowNumbers:
    """Numbers the samples, and finds restarts of the sender.

    After a restart, the sender sends its header (the names of the columns) again.
    """

    def __init__(self) -> None:
        self._ordinal = self._since_header = self._page = 0
        self._begins = False

    def begin(self) -> None:
        """Note that the sender restarted before the next row."""
        self._begins = True

    def lose(self) -> None:
        """Skip the next number, since a sample was lost."""
        self._ordinal += 1

    def repeat_header(self, rows: int) -> None:
        """Note that the sender has repeated its header, and find out whether it restarted.

        Some senders repeat the header regularly, after a fixed number of rows. Then the number of rows since
        the last header is as before, or equal to `rows`. If it is neither, the sender restarted.
        `rows`: number of rows from here until the header comes once more, -1 if unknown.
        """
        self._begins |= self._since_header not in (self._page, rows)
        self._page, self._since_header = self._since_header, 0

    def take(self, count: int) -> tuple[Ints, bool]:
        """Return the numbers of the next `count` rows, and whether the sender restarted before the first."""
        begins, self._begins = self._begins, False
        ordinal = self._ordinal + np.arange(count)
        self._ordinal += count
        self._since_header += count
        return ordinal, begins
