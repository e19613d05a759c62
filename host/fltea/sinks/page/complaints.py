"""What bokeh and tornado complain of: errors become ours, at most one a minute; all else is dropped."""

import logging

from fltea.records import clock
from fltea.records.ports import Report
from fltea.records.repeat import OnceAMinute

LIBRARIES = ("bokeh", "tornado")


class Complaints(logging.Handler):
    """Takes the place of the libraries' own handlers, which would write to stderr."""

    def __init__(self, report: Report) -> None:
        super().__init__(logging.ERROR)
        self._report = report
        self._once_a_minute = OnceAMinute()
        for name in LIBRARIES:
            logger = logging.getLogger(name)
            logger.propagate = False
            logger.setLevel(logging.ERROR)
            logger.handlers = [self]

    def emit(self, record: logging.LogRecord) -> None:
        """Report an error, unless one was reported a moment ago."""
        what = record.getMessage().strip().splitlines() or [""]
        if what[-1].endswith(":"):  # that one only announces the next
            return
        if not self._once_a_minute.is_due("page_fault", clock.host_ns()):
            return
        error = record.exc_info[1] if record.exc_info else None
        cause = "" if error is None else f" ({type(error).__name__}: {error})"
        self._report("page_fault", f"the live page has a fault; all else goes on. {what[-1]}{cause}")
