"""What a page can ask for: to record, and to download a report."""

import secrets
from collections.abc import Callable, Mapping
from http import HTTPStatus

from tornado.ioloop import IOLoop
from tornado.routing import PathMatches, Rule
from tornado.web import RequestHandler

from fltea.records.errors import FlteaError
from fltea.records.ports import Recorder
from fltea.sinks.page.downloads import Seen, report_of, seen, yaml_of
from fltea.sinks.page.history import DeviceHistory

TOKEN = "X-Fltea-Token"
"""Name of a header."""

NOT_ALLOWED = (
    "Pages may not record here, since not only this machine reaches them. Start fltea with --record, or with "
    "--set dashboard.record=true."
)


class Actions:
    """Answers requests that only our own page can make, since they have to bring its token.

    A page of another site can neither read the token nor set the header; it is another one at every start.

    recorder: None where pages may not record.
    """

    def __init__(self, histories: Mapping[str, DeviceHistory], recorder: Recorder | None) -> None:
        self.histories, self.recorder = histories, recorder
        self.token = secrets.token_urlsafe(24)

    def rules(self) -> list[Rule]:
        """Return the addresses where actions are asked for."""
        made = {"actions": self}
        return [
            Rule(PathMatches("/recording$"), Recording, made),
            Rule(PathMatches("/report.html$"), Download, made | {"make": report_of, "ending": ".html"}),
            Rule(PathMatches("/imu.yaml$"), Download, made | {"make": yaml_of, "ending": "_imu.yaml"}),
        ]


class _OfOurPage(RequestHandler):
    """A request with the page's token, about one device."""

    def initialize(self, actions: Actions) -> None:
        """Take what the rule gives."""
        self._actions = actions

    def prepare(self) -> None:
        """Turn away who has not the token, and who asks for a device that there is not."""
        self.set_header("Cache-Control", "no-store")
        self.set_header("X-Content-Type-Options", "nosniff")
        given = self.request.headers.get(TOKEN, "")
        if not secrets.compare_digest(given.encode(), self._actions.token.encode()):
            self.refuse(HTTPStatus.FORBIDDEN, "This is for the live page alone; load it again.")
        elif self.get_query_argument("device", "") not in self._actions.histories:
            self.refuse(HTTPStatus.NOT_FOUND, "There is no such device.")

    def refuse(self, status: HTTPStatus, text: str) -> None:
        """End with a sentence for people."""
        self.set_status(status)
        self.set_header("Content-Type", "text/plain; charset=utf-8")
        self.finish(text)

    @property
    def history(self) -> DeviceHistory:
        """The history of the device that was asked for."""
        return self._actions.histories[self.get_query_argument("device")]


class Recording(_OfOurPage):
    """`POST /recording?device=NAME&want=on|off`."""

    async def post(self) -> None:
        """Start or stop a recording, and come back when that is done."""
        recorder, history = self._actions.recorder, self.history
        want = self.get_query_argument("want", "")
        if recorder is None:
            self.refuse(HTTPStatus.FORBIDDEN, NOT_ALLOWED)
            return
        if want not in ("on", "off"):
            self.refuse(HTTPStatus.BAD_REQUEST, "want is on or off.")
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


class Download(_OfOurPage):
    """`GET /report.html?device=NAME` and `GET /imu.yaml?device=NAME`: a file, made in this thread."""

    def initialize(self, actions: Actions, make: Callable[[Seen], str], ending: str) -> None:  # type: ignore[override]
        """Take what the rule gives."""
        super().initialize(actions)
        self._make, self._ending = make, ending

    def get(self) -> None:
        """Make the file of what was seen so far."""
        try:
            with self.history.lock:
                found = seen(self.history)
            text = self._make(found)
        except FlteaError as error:
            self.refuse(HTTPStatus.CONFLICT, str(error))
            return
        kind = "text/html" if self._ending == ".html" else "application/yaml"
        self.set_header("Content-Type", f"{kind}; charset=utf-8")
        self.set_header("Content-Disposition", f'attachment; filename="{found.stem}{self._ending}"')
        self.finish(text)
