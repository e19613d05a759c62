"""Serve the live page, which describes the noise of every device in words and diagrams."""

import asyncio
import threading
from collections.abc import Iterator, Mapping

from tornado.ioloop import IOLoop

from fltea.diagnostics.addresses import may_listen
from fltea.diagnostics.asked import AskedOutput
from fltea.diagnostics.finding import Finding, refused
from fltea.records.block import Block
from fltea.records.ports import Item, Recorder, Report, Sink
from fltea.records.records import Record
from fltea.settings.estimator import EstimateOn
from fltea.settings.login_file import read_login
from fltea.settings.outputs import DashboardConfig
from fltea.sinks.listening import own_names, url_of
from fltea.sinks.opening import Opening
from fltea.sinks.page.history import DeviceHistory
from fltea.sinks.page.requests import ROUTES, PageSite
from fltea.sinks.page.state import State
from fltea.sinks.web.door import Door, LibraryErrors, bind

JOIN_S = 0.4


class DashboardSink(Sink):
    """Remembers what the page shows.

    A browser asks for this content when it needs it, so a slow browser does not delay the program.

    `devices`: for each device's name, where the estimates of its gyroscope are made. `recorder`: starts and
    stops recordings when the user presses the page's button, if pages may record.

    Raises:
        FlteaError: another program uses the network port, this machine does not have the address to listen
            at, or the file with the password cannot be used.
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
        file, (host, port) = settings.password_file, settings.listen()
        password = None if file is None else ":".join(read_login("dashboard.password_file", file))
        self._sockets = bind("--dashboard", host, port)
        self.url = url_of(host, self._sockets[0].getsockname()[1])
        LibraryErrors(report)
        state = State(self._histories, recorder, settings.may_record)
        names, may = own_names(host, settings.names), recorder if settings.may_record else None
        site = PageSite(names, report, settings.visitors, self._histories, state, may, password)
        self._application, self._report = site.application(ROUTES), report
        self._ready = threading.Event()
        self._thread = threading.Thread(target=self._run, name="live page", daemon=True)
        self._thread.start()
        self._ready.wait()

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
        """End the server. Pages that are open show that it no longer answers."""
        self._loop.add_callback(self._door.close)
        self._loop.add_callback(self._loop.stop)
        self._thread.join(JOIN_S)

    def _run(self) -> None:
        asyncio.set_event_loop(asyncio.new_event_loop())
        self._loop = IOLoop.current()
        self._door = Door(self._sockets, self._application, self._report)
        self._ready.set()
        self._loop.start()
        self._loop.close(all_fds=True)


def open_output(opening: Opening) -> DashboardSink:
    """Start to serve the page, and print its address."""
    devices = {config.name or "": config.estimator.estimate_on for config in opening.configs}
    page = DashboardSink(opening.program.dashboard, devices, opening.report, opening.recorder)
    opening.say(f"fltea: live page at {page.url}\n")
    return page


def check_output(asked: AskedOutput) -> Iterator[Finding]:
    """Yield what is wrong with the file of the password, and whether the page may listen at its address."""
    settings = asked.program.dashboard
    file = settings.password_file
    if file is not None:
        yield from refused("dashboard", lambda: read_login("dashboard.password_file", file))
    yield may_listen("dashboard", settings.listen(), _try_to_listen, asked.system)


def _try_to_listen(host: str, port: int) -> None:
    for one in bind("--dashboard", host, port):
        one.close()
