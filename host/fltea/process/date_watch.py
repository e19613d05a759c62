"""Check whether the machine's date is possible, and report it once if it is not."""

from fltea.records.clock import wrong_date
from fltea.records.ports import Report


class DateWatch:
    """Reports once when the machine's date becomes impossible.

    `report`: function that takes kind and text of the report.
    """

    def __init__(self, report: Report) -> None:
        self._report = report
        self._is_wrong = False

    def check(self) -> None:
        """Check the machine's date now, and report if it has become impossible."""
        text = wrong_date()
        if text and not self._is_wrong:
            self._report("clock_wrong", text)
        self._is_wrong = bool(text)
