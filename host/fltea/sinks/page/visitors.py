"""How many may look at the page: each costs memory and processor time, and the estimates come first."""

from collections.abc import Callable
from html import escape
from http import HTTPStatus

from bokeh.util.token import get_session_id
from tornado.httputil import HTTPServerRequest
from tornado.routing import Matcher
from tornado.web import RequestHandler

from fltea.records import clock
from fltea.records.ports import Report
from fltea.records.repeat import OnceAMinute

OPENING = ("/", "/autoload.js", "/ws")
"""Requests that make a new page, unless it is there already."""

TRY_AGAIN_S = 10
"""A page that was left is forgotten within this time."""

PAGE = """<!doctype html><html lang="en"><head><meta charset="utf-8"><title>fltea: too many visitors</title>
<meta http-equiv="refresh" content="{seconds}"><meta name="viewport" content="width=device-width"></head>
<body><h1>Too many visitors</h1><p>{text}</p><p>This page tries again every {seconds} s.</p></body></html>
"""


class OneTooMany(Matcher):
    """Matches a request that would open a page when there are `most` already; reports it once a minute.

    ids: the sessions of the open pages.
    """

    def __init__(self, most: int, ids: Callable[[], set[str]], report: Report) -> None:
        self._most, self._ids, self._report = most, ids, report
        self._often = OnceAMinute()
        self._turned_away = 0

    def match(self, request: HTTPServerRequest) -> dict[str, object] | None:
        """What the handler is made with, or None if there is room."""
        if request.path not in OPENING:
            return None
        ids = self._ids()
        if len(ids) < self._most or (request.path == "/ws" and _session(request) in ids):
            return None
        self._turned_away += 1
        if self._often.is_due("too_many_visitors", clock.host_ns()):
            count, self._turned_away = self._turned_away, 0
            self._report(
                "too_many_visitors", f"{_text(self._most)} Turned away since the last report: {count}."
            )
        return {"target_kwargs": {"most": self._most}}


class Full(RequestHandler):
    """Answers the one too many."""

    def initialize(self, most: int) -> None:
        """Take what the matcher gives."""
        self._most = most

    def prepare(self) -> None:
        """Answer whatever was asked."""
        self.set_status(HTTPStatus.SERVICE_UNAVAILABLE)
        self.set_header("Retry-After", str(TRY_AGAIN_S))
        self.finish(PAGE.format(seconds=TRY_AGAIN_S, text=escape(_text(self._most))))


def _text(most: int) -> str:
    return (
        f"The live page has {most} visitors and takes no more (setting dashboard.visitors). Close it "
        f"elsewhere, or start fltea with --set dashboard.visitors={2 * most}: each costs 2 MB or more, and "
        "1 % of a processor."
    )


def _session(request: HTTPServerRequest) -> str | None:
    """Return the page to which a websocket states that it belongs."""
    token = request.headers.get("Sec-WebSocket-Protocol", "").rpartition(",")[2].strip()
    try:
        return str(get_session_id(token))
    except Exception:  # whatever a client sends
        return None
