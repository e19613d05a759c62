"""Looks whether the machine's date can be, and reports it once if it cannot."""

from fltea.records.clock import wrong_date
from fltea.records.ports import Report


class DateWatch:
    """Reports a date that is not believed, each time that it comes to that. report: takes kind and text."""

    def __init__(self, report: Report) -> None:
        self._report = report
        self._is_wrong = False

    def look(self) -> None:
        """Look at the date."""
        text = wrong_date()
        if text and not self._is_wrong:
            self._report("clock_wrong", text)
        self._is_wrong = bool(text)
