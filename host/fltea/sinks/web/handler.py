"""Who may ask a page for something, and with what every answer begins."""

import asyncio
import base64
import hmac
import time
from collections.abc import Collection, Sequence
from http import HTTPStatus
from importlib import resources
from typing import Any

import msgspec
from tornado.web import Application, HTTPError, RequestHandler

from fltea.records import clock
from fltea.records.ports import Report
from fltea.records.repeat import OnceAMinute
from fltea.sinks.listening import is_from_here, is_own

TYPES = {"html": "text/html", "css": "text/css", "js": "text/javascript"}
WRONG_PASSWORD_S = 0.5
"""How long a wrong password waits for its answer."""

BY_SCRIPT = "X-Fltea"
"""A header. A page of another site cannot send it: its browser would first ask us, and we do not answer."""

BURST = 10
"""So many seconds' requests may come at once."""

TRY_AGAIN_S = 10
HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; "
    "img-src 'self' data:; form-action 'none'; frame-ancestors 'none'; base-uri 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
}

Routes = Sequence[tuple[str, type["Handler"]]]


class Room:
    """For how many requests a second there is room; more only for a moment."""

    def __init__(self, a_second: float) -> None:
        self._a_second = a_second
        self._left, self._refilled = a_second * BURST, time.monotonic()

    def take(self) -> bool:
        """Whether there is room for one request more."""
        now = time.monotonic()
        self._left += (now - self._refilled) * self._a_second
        self._left, self._refilled = min(self._left, self._a_second * BURST), now
        if self._left < 1:
            return False
        self._left -= 1
        return True


class Site:
    """What all requests to a page share.

    package: has the files page.html, page.css and page.js. names: under which the page may be asked for.
    password: USER:PASSWORD, or None. a_second: requests that are answered, more only for a moment. full: what
    is said to whoever comes beyond that.
    """

    def __init__(
        self,
        package: str,
        names: Collection[str],
        report: Report,
        a_second: float,
        full: str,
        password: str | None = None,
    ) -> None:
        self.names, self.full = names, full
        self.password = None if password is None else password.encode()
        here = {name: (__package__, name) for name in ("common.css", "common.js")}
        files = here | {name: (package, f"page.{name[5:] or 'html'}") for name in ("", "page.css", "page.js")}
        self.files = {
            name: (TYPES[file.rpartition(".")[2]], resources.files(of).joinpath(file).read_bytes())
            for name, (of, file) in files.items()
        }
        self._report, self._often = report, OnceAMinute()
        self._visitors, self._strangers = Room(a_second), Room(a_second)

    def has_room(self, *, for_visitor: bool) -> bool:
        """Whether one request more is answered now; that none is gets reported once a minute.

        for_visitor: of somebody who knows the password, if there is one. Others have a room of their own, so
        that whoever guesses it takes none from those who know it.
        """
        if (self._visitors if for_visitor else self._strangers).take():
            return True
        if self._often.is_due("too_many_visitors", clock.host_ns()):
            self._report("too_many_visitors", self.full)
        return False

    def application(self, routes: Routes) -> Application:
        """Return what answers requests for the files, and for what else there is."""
        given = {"site": self}
        files = (r"/(|page\.css|page\.js|common\.css|common\.js)", File, given)
        return Application(
            [files, *((path, handler, given) for path, handler in routes)],
            log_function=lambda handler: None,
            compress_response=True,
            default_handler_class=NotFound,
            default_handler_args=given,
        )


class Handler(RequestHandler):
    """A request to a page; those of whom it is none of their business are turned away."""

    def initialize(self, site: Site) -> None:
        """Take what the route gives."""
        self.site = site

    def set_default_headers(self) -> None:
        """Set what every answer has."""
        for name, value in HEADERS.items():
            self.set_header(name, value)
        self.clear_header("Server")

    async def prepare(self) -> None:
        """Turn away who does not ask by a name of ours, or from a page of another site, or too often.

        A page of somebody else's can neither read ours (its `Origin` is another) nor become ours by letting
        its name resolve to this machine (its `Host` is a name we do not have).
        """
        if not is_own(self.request.host, self.site.names):
            raise HTTPError(HTTPStatus.MISDIRECTED_REQUEST)
        if not is_from_here(self.request.host, self.request.headers.get("Origin")):
            raise HTTPError(HTTPStatus.FORBIDDEN)
        is_visitor = self.site.password is None or self._knows_password(self.site.password)
        if not self.site.has_room(for_visitor=is_visitor):
            self.set_header("Retry-After", str(TRY_AGAIN_S))
            self.refuse(HTTPStatus.SERVICE_UNAVAILABLE, self.site.full)
        elif not is_visitor:
            await asyncio.sleep(WRONG_PASSWORD_S)
            self.set_header("WWW-Authenticate", 'Basic realm="fltea", charset="UTF-8"')
            raise HTTPError(HTTPStatus.UNAUTHORIZED)

    def _knows_password(self, password: bytes) -> bool:
        scheme, _, given = self.request.headers.get("Authorization", "").partition(" ")
        try:
            found = base64.b64decode(given, validate=True)
        except ValueError:  # no base64, or no ASCII
            return False
        return scheme.lower() == "basic" and hmac.compare_digest(found, password)

    def write_error(self, status_code: int, **kwargs: Any) -> None:
        """Say what is wrong, as text."""
        self.refuse(status_code, f"{status_code} {self._reason}")

    def refuse(self, status: int, text: str) -> None:
        """End with a sentence for people."""
        self.set_status(status)
        self.set_header("Content-Type", "text/plain; charset=utf-8")
        self.finish(f"{text}\n")

    def answer(self, found: Any) -> None:
        """Answer with JSON."""
        self.set_header("Content-Type", "application/json")
        self.write(msgspec.json.encode(found))

    def number(self, name: str, usual: int, most: int) -> int:
        """Return an argument that is a number from 0 on."""
        text = self.get_argument(name, str(usual))
        if not (text.isascii() and text.isdigit()) or len(text) > 9:
            raise HTTPError(HTTPStatus.BAD_REQUEST)
        return min(int(text), most)


class File(Handler):
    """A file of the page."""

    def get(self, name: str) -> None:
        """Give it."""
        kind, content = self.site.files[name]
        self.set_header("Content-Type", f"{kind}; charset=utf-8")
        self.write(content)


class NotFound(Handler):
    """What there is not."""

    async def prepare(self) -> None:
        """Turn away, and tell those who may ask that there is nothing."""
        await super().prepare()
        if not self._finished:
            raise HTTPError(HTTPStatus.NOT_FOUND)
