"""Answer the requests of the live page.

A request asks for the state of a device, for the start or stop of a recording, or for a download.
"""

from collections.abc import Callable, Collection, Mapping
from http import HTTPStatus
from typing import Any, ClassVar

from tornado.ioloop import IOLoop
from tornado.web import HTTPError

from fltea.records.errors import FlteaError
from fltea.records.ports import Recorder, Report
from fltea.sinks.page.downloads import Seen, report_of, seen, yaml_of
from fltea.sinks.page.history import DeviceHistory
from fltea.sinks.page.state import State
from fltea.sinks.web.handler import BY_SCRIPT, Handler, Site

NOT_ALLOWED = (
    "Recording from this page is off, since other machines reach it. Start fltea with --record, or with "
    "--set dashboard.record=true."
)

FULL = (
    "The live page has {0} visitors and takes no more (setting dashboard.visitors). Close it elsewhere, or "
    "start fltea with --set dashboard.visitors={1}. The page tries again in a moment."
)

MOST_PARTS = 20


class PageSite(Site):
    """The data that all requests share.

    `recorder`: starts and stops recordings; None if pages may not do so.
    """

    def __init__(
        self,
        names: Collection[str],
        report: Report,
        visitors: int,
        histories: Mapping[str, DeviceHistory],
        state: State,
        recorder: Recorder | None,
        password: str | None,
    ) -> None:
        # Each page sends one request a second. The allowed number of requests a second is a little higher,
        # since pages may ask early, and more often just after they were opened.
        full = FULL.format(visitors, 2 * visitors)
        super().__init__(__package__, names, report, 1.2 * visitors + 1, full, password)
        self.histories, self.state, self.recorder = histories, state, recorder


class _Handler(Handler):
    site: PageSite

    @property
    def history(self) -> DeviceHistory:
        """The history of the requested device."""
        name = self.get_query_argument("device", "", strip=False)
        if name not in self.site.histories:
            raise HTTPError(HTTPStatus.NOT_FOUND)
        return self.site.histories[name]


class _State(_Handler):
    """Handles the request for the state of a device.

    `GET /state?device=NAME&axis=NAME&window=N&parts=NAME:CHECKSUM,…&cursor=CURSOR&drawn=CURSOR`

    `State.read` explains `parts`, `cursor` and `drawn`.
    """

    def get(self) -> None:
        """Answer with those parts of the page whose checksum is not the one in the request."""
        state = self.site.state
        view = state.view(
            self.get_query_argument("device", "", strip=False),
            self.get_query_argument("axis", ""),
            self.number("window", 1, 9),
        )
        had = _pairs(self.get_query_argument("parts", ""))
        self.set_header("Content-Type", "application/json")
        self.write(
            state.read(
                view,
                had,
                self.get_query_argument("cursor", None),
                self.get_query_argument("drawn", None),
            )
        )


class _Recording(_Handler):
    """Handles `POST /recording?device=NAME&want=on|off`, which starts or stops a recording."""

    async def post(self) -> None:
        """Start or stop the recording, and answer when it has started or stopped."""
        recorder, want = self.site.recorder, self.get_query_argument("want", "")
        if self.request.headers.get(BY_SCRIPT) is None:
            self.refuse(HTTPStatus.FORBIDDEN, "Only the live page may send this request.")
            return
        history = self.history
        if recorder is None:
            self.refuse(HTTPStatus.FORBIDDEN, NOT_ALLOWED)
            return
        if want not in ("on", "off"):
            self.refuse(HTTPStatus.BAD_REQUEST, "The argument 'want' has to be 'on' or 'off'.")
            return
        with history.lock:
            hello = history.hello
        loop = IOLoop.current()
        try:
            if want == "on":
                await loop.run_in_executor(None, recorder.start, history.name, hello)
            else:
                await loop.run_in_executor(None, recorder.stop, history.name)
        except FlteaError as error:
            self.refuse(HTTPStatus.CONFLICT, str(error))
            return
        self.set_status(HTTPStatus.NO_CONTENT)


class _Download(_Handler):
    """Handles the download of a file. The file is made in the server's thread, from all data so far."""

    kind: ClassVar[str]
    ending: ClassVar[str]
    make: ClassVar[Callable[[Seen], str]]

    def get(self) -> None:
        history = self.history
        try:
            with history.lock:
                found = seen(history)
            text = type(self).make(found)
        except FlteaError as error:
            self.refuse(HTTPStatus.CONFLICT, str(error))
            return
        self.set_header("Content-Type", f"{self.kind}; charset=utf-8")
        self.set_header("Content-Disposition", f'attachment; filename="{found.stem}{self.ending}"')
        self.write(text)


class _Report(_Download):
    kind, ending, make = "text/html", ".html", report_of


class _Yaml(_Download):
    kind, ending, make = "application/yaml", "_imu.yaml", yaml_of


ROUTES: list[tuple[str, type[Handler]]] = [
    ("/state", _State),
    ("/recording", _Recording),
    ("/report.html", _Report),
    ("/imu.yaml", _Yaml),
]


def _pairs(text: str) -> dict[str, str]:
    """Return the names in a list such as `a:1,b:,c`. Each name is returned with the text after its colon."""
    found: dict[str, Any] = {}
    for pair in text.split(",")[:MOST_PARTS]:
        name, _, value = pair.partition(":")
        found[name] = value
    return found
