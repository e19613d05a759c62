"""What was chosen of each header of a text: one that comes again is not looked at anew (pure).

To choose columns, their units and their sensor takes milliseconds. A sender that prints its header before
each row, or one that nobody can read, would cost them with every row.
"""

from collections.abc import Callable, Hashable

from fltea.recording.columns import Chosen
from fltea.records.errors import UsageError

MOST = 64
"""Headers of a text that has had rows; the columns of others are not looked for."""


class Choices:
    """The columns of each header of a text, or why they cannot be told."""

    def __init__(self) -> None:
        self._found: dict[Hashable, Chosen | UsageError] = {}

    def of(self, header: Hashable, choose: Callable[[], Chosen], *, had_rows: bool = True) -> Chosen:
        """Return the columns of a header as they were chosen when it came first.

        had_rows: the text has had rows, so that it can be read without this header.

        Raises:
            UsageError: they cannot be told, or it is one of too many headers that differ.
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
            raise found.with_traceback(None)  # or it would grow with each time
        return found
