"""Decide which requests to a page are answered, and set the headers of every answer."""

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
"""A request with a wrong password is answered only after this time [s], which slows the guessing of
passwords.
"""

BY_SCRIPT = "X-Fltea"
"""A header that only the script of our own page can send. If a page of another site tried to send it, the
browser would first ask this server for permission, and get none.
"""

BURST = 10
"""At most as many requests may come at once as the average rate allows in this time [s]. At 5 requests per
second, these are 50.
"""

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
    """Limits the average number of requests per second. For a moment, more are allowed (see `BURST`)."""

    def __init__(self, a_second: float) -> None:
        self._a_second = a_second
        self._left, self._refilled = a_second * BURST, time.monotonic()

    def take(self) -> bool:
        """Count one more request, and return whether the limit allows this request."""
        now = time.monotonic()
        self._left += (now - self._refilled) * self._a_second
        self._left, self._refilled = min(self._left, self._a_second * BURST), now
        if self._left < 1:
            return False
        self._left -= 1
        return True


class Site:
    """The data that all requests to a page share.

    `package`: contains the files page.html, page.css and page.js. `names`: host names of the page.
    `password`: USER:PASSWORD, or None. `a_second`: average number of requests per second that are answered.
    `full`: text of the answer to a request that exceeds this number.
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
        """Return whether one more request is answered now. Refusals are reported at most once a minute.

        `for_visitor`: whether the request has the right password, or no password is needed. All other
        requests have a separate limit, so that somebody who guesses passwords does not slow visitors who know
        it.
        """
        if (self._visitors if for_visitor else self._strangers).take():
            return True
        if self._often.is_due("too_many_visitors", clock.host_ns()):
            self._report("too_many_visitors", self.full)
        return False

    def application(self, routes: Routes) -> Application:
        """Return the web application that answers requests for the page's files and for the given routes."""
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
    """Handles a request to a page, and refuses it if it is not allowed."""

    def initialize(self, site: Site) -> None:
        """Keep the argument `site`, which the library tornado passes to the handler of every route."""
        self.site = site

    def set_default_headers(self) -> None:
        for name, value in HEADERS.items():
            self.set_header(name, value)
        self.clear_header("Server")

    async def prepare(self) -> None:
        """Refuse a request that is not allowed.

        A request is refused if it names another host, comes from another site's page, lacks the password, or
        exceeds the limit.

        A request from another site's page is known by its `Origin`. Another site may also let its own host
        name resolve to this machine, so that its page seems to be ours. Its requests are known by their
        `Host`, which is not one of our names.
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
        except ValueError:  # the text is not base64, or not ASCII
            return False
        return scheme.lower() == "basic" and hmac.compare_digest(found, password)

    def write_error(self, status_code: int, **kwargs: Any) -> None:
        """Answer with an HTTP error as text."""
        self.refuse(status_code, f"{status_code} {self._reason}")

    def refuse(self, status: int, text: str) -> None:
        """Answer with an HTTP status and a message for people."""
        self.set_status(status)
        self.set_header("Content-Type", "text/plain; charset=utf-8")
        self.finish(f"{text}\n")

    def answer(self, found: Any) -> None:
        """Answer with `found`, encoded as JSON."""
        self.set_header("Content-Type", "application/json")
        self.write(msgspec.json.encode(found))

    def number(self, name: str, usual: int, most: int) -> int:
        """Return the request's argument `name` as an integer. A larger number than `most` becomes `most`.

        Return `usual` if the argument is missing.
        """
        text = self.get_argument(name, str(usual))
        if not (text.isascii() and text.isdigit()) or len(text) > 9:
            raise HTTPError(HTTPStatus.BAD_REQUEST)
        return min(int(text), most)


class File(Handler):
    """Handles a request for one of the page's files."""

    def get(self, name: str) -> None:
        kind, content = self.site.files[name]
        self.set_header("Content-Type", f"{kind}; charset=utf-8")
        self.write(content)


class NotFound(Handler):
    """Handles a request for something that does not exist."""

    async def prepare(self) -> None:
        """Answer that nothing was found (404), or that the request is not allowed."""
        await super().prepare()
        if not self._finished:
            raise HTTPError(HTTPStatus.NOT_FOUND)
