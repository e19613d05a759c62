"""Stores the columns chosen for each header of a text, so that a repeated header costs no time.

A header is a line with the names of the columns. Choosing columns, units and sensor takes milliseconds.
Without this store, these milliseconds would be spent on every row if a sender prints its header before each
row.
"""

from collections.abc import Callable, Hashable

from fltea.recording.columns import Chosen
from fltea.records.errors import UsageError

MOST = 64
"""Columns are chosen for at most this number of different headers (lines with column names) of a text."""


class Choices:
    """The chosen columns for each header of a text, or the error if a header cannot be read."""

    def __init__(self) -> None:
        self._found: dict[Hashable, Chosen | UsageError] = {}

    def of(self, header: Hashable, choose: Callable[[], Chosen], *, had_rows: bool = True) -> Chosen:
        """Return the columns for a header. They are chosen only when the header appears for the first time.

        `had_rows`: whether rows were read before. Until then, any number of headers is accepted. `choose`:
        function that chooses the columns.

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
            # with_traceback(None): else the traceback would grow each time that the stored error is raised
            raise found.with_traceback(None)
        return found
