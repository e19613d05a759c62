"""The live page: a web server that leads with what every device's noise is, and shows it."""

import logging
from collections.abc import Mapping

from bokeh.document import Document

from fltea.records import clock
from fltea.records.block import Block
from fltea.records.ports import Item, Recorder, Report, Sink
from fltea.records.records import Record
from fltea.records.repeat import OnceAMinute
from fltea.settings.estimator import EstimateOn
from fltea.settings.outputs import DashboardConfig
from fltea.sinks.listening import url_of
from fltea.sinks.page.actions import Actions
from fltea.sinks.page.history import DeviceHistory
from fltea.sinks.page.page import Page
from fltea.sinks.page.server import PageServer

LIBRARIES = ("bokeh", "tornado")


class DashboardSink(Sink):
    """Remembers what the page shows; browsers fetch it at their own pace, so none can hold anything up.

    devices: who estimates the gyroscope of each device, by its name. recorder: what the page's button works
    on, if pages may record.

    Raises:
        FlteaError: the port is taken, or the address is not ours.
    """

    name = "dashboard"

    def __init__(
        self,
        settings: DashboardConfig,
        devices: Mapping[str, EstimateOn],
        report: Report,
        recorder: Recorder | None = None,
    ) -> None:
        self._histories = {name: DeviceHistory(name, estimate_on) for name, estimate_on in devices.items()}
        LibraryErrors(report)
        self._host, port = settings.listen()
        self._recorder = recorder
        actions = Actions(self._histories, recorder if settings.may_record else None)
        self._token, self._may_record = actions.token, settings.may_record
        self._server = PageServer(
            self._host, port, settings.names, self._make, settings.visitors, report, actions.rules()
        )

    @property
    def url(self) -> str:
        """The address of the page."""
        return url_of(self._host, self._server.port)

    def write(self, item: Item) -> None:
        """Remember a record."""
        if not isinstance(item, Record | Block):
            return
        history = self._histories.get(item.device or "")
        if history is not None:
            for record in item.records() if isinstance(item, Block) else (item,):
                history.write(record)

    def on_overflow(self, count: int) -> None:
        """Show on the pages that records are missing."""
        for history in self._histories.values():
            history.missed(count)

    def close(self) -> None:
        """End the server."""
        self._server.close()

    def _make(self, document: Document) -> None:
        Page(document, self._histories, self._recorder, self._token, self._may_record)


class LibraryErrors(logging.Handler):
    """Reports errors of bokeh and tornado, at most one a minute, in place of their own handlers.

    Those would write to stderr; all but errors is dropped.
    """

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
