"""Keeps the columns that were chosen for each header of a text, so that a repeated header costs no time.

Choosing the columns, their units and their sensor takes milliseconds. Without this, a sender that prints its
header before each row would cost that time with every row.
"""

from collections.abc import Callable, Hashable

from fltea.recording.columns import Chosen
from fltea.records.errors import UsageError

MOST = 64
"""Most different headers of a text that has rows; the columns of further headers are not chosen."""


class Choices:
    """The columns for each header of a text, or the error for a header that cannot be read."""

    def __init__(self) -> None:
        self._found: dict[Hashable, Chosen | UsageError] = {}

    def of(self, header: Hashable, choose: Callable[[], Chosen], *, had_rows: bool = True) -> Chosen:
        """Return the columns for a header, as they were chosen at its first appearance.

        `had_rows`: the text has had rows, so it can be read without this header.

        Raises:
            UsageError: the columns cannot be chosen, or there are too many different headers.
        """
        if header not in self._found:
            if had_rows and len(self._found) >= MOST:
                raise UsageError(
                    f"more than {MOST} headers that differ; only the columns of the first are read."
                )
            try:
                self._found[header] = choose()
            except UsageError as error:
                self._found[header] = error
        found = self._found[header]
        if isinstance(found, UsageError):
            raise found.with_traceback(None)  # else the traceback grows with each raise
        return found
