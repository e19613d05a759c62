"""Serves the page from a thread of its own, to browsers that came by a name of this machine."""

import asyncio
import gc
import threading
from collections.abc import Callable, Collection, Sequence

from bokeh.application import Application
from bokeh.application.handlers.function import FunctionHandler
from bokeh.document import Document
from bokeh.server.server import BaseServer
from bokeh.server.tornado import BokehTornado
from tornado.httpserver import HTTPServer
from tornado.httputil import HTTPServerRequest
from tornado.ioloop import IOLoop
from tornado.netutil import bind_sockets
from tornado.routing import AnyMatches, Matcher, Rule, RuleRouter
from tornado.web import Application as WebApplication

from fltea.records.ports import Report
from fltea.sinks.listening import cannot_listen, is_from_here, is_own, own_names
from fltea.sinks.page.visitors import Full, OneTooMany

UNUSED_SESSION_MS = 5_000
"""What a closed page may still cost. A page that was cut off for longer loads itself again."""

LARGEST_MESSAGE = 1 << 20
JOIN_S = 0.4


class OwnName(Matcher):
    """Lets a request pass that names this machine, and whose page, if it is a page's, came from here too.

    A page of somebody else's site can neither read ours (its `Origin` is another) nor become ours by letting
    its name resolve to this machine (its `Host` is a name we do not have).
    """

    def __init__(self, names: Collection[str]) -> None:
        self._names = names

    def match(self, request: HTTPServerRequest) -> dict[str, object] | None:
        """An empty match, or None for "not here"."""
        is_from_us = is_from_here(request.host, request.headers.get("Origin"))
        return {} if is_from_us and is_own(request.host, self._names) else None


class PageServer:
    """Bokeh's server on a loop in a thread of its own.

    make: fills the document of each page. names: further names under which the page may be asked for.
    visitors: pages that may be open at a time; others are reported. rules: what else is answered.

    Raises:
        FlteaError: the port is taken, or the address is not ours.
    """

    def __init__(
        self,
        host: str,
        port: int,
        names: Collection[str],
        make: Callable[[Document], None],
        visitors: int,
        report: Report,
        rules: Sequence[Rule] = (),
    ) -> None:
        try:
            sockets = bind_sockets(port, host)
        except (OSError, UnicodeError) as error:
            raise cannot_listen("--dashboard", host, port, error) from error
        self.port: int = sockets[0].getsockname()[1]
        self._sockets = sockets
        self._names = own_names(host, names)
        self._make, self._visitors, self._report = make, visitors, report
        self._rules = list(rules)
        self._application = Application(FunctionHandler(self._fill))
        self._ready = threading.Event()
        self._thread = threading.Thread(target=self._run, name="live page", daemon=True)
        self._thread.start()
        self._ready.wait()
        # bokeh has all garbage collected whenever a page is closed, while no thread can move: 60 ms on a fast
        # machine, or 5 if what lives for ever anyway is left out.
        gc.collect()
        gc.freeze()

    @property
    def pages(self) -> int:
        """Pages that are open, or were until a few seconds ago."""
        return len(self._ids())

    def close(self) -> None:
        """End the server; open pages notice the loss of their connection."""
        self._loop.add_callback(self._stop)
        self._thread.join(JOIN_S)
        gc.unfreeze()

    def _run(self) -> None:
        asyncio.set_event_loop(asyncio.new_event_loop())
        self._loop = IOLoop.current()
        tornado = BokehTornado(
            {"/": self._application},
            extra_websocket_origins=["*"],  # OwnName has seen to it
            use_index=False,
            keep_alive_milliseconds=UNUSED_SESSION_MS,  # finds those that closed while they were being opened
            check_unused_sessions_milliseconds=UNUSED_SESSION_MS,
            unused_session_lifetime_milliseconds=UNUSED_SESSION_MS,
            stats_log_frequency_milliseconds=3_600_000,
            websocket_max_message_size_bytes=LARGEST_MESSAGE,
        )
        full = Rule(OneTooMany(self._visitors, self._ids, self._report), Full)
        inside = WebApplication([], log_function=lambda handler: None)  # it takes a 503 for a fault
        inside.wildcard_router.add_rules([full, *self._rules, Rule(AnyMatches(), tornado)])
        http = HTTPServer(RuleRouter([Rule(OwnName(self._names), inside)]), max_body_size=LARGEST_MESSAGE)
        http.add_sockets(self._sockets)
        self._server = BaseServer(self._loop, tornado, http)
        self._server.start()
        self._ready.set()
        self._loop.start()
        self._loop.close(all_fds=True)

    def _ids(self) -> set[str]:
        return {session.id for session in self._server.get_sessions("/")}

    def _fill(self, document: Document) -> None:
        """Make a page, unless several that came at once found room for one; theirs stays empty."""
        if self.pages < self._visitors:
            self._make(document)

    async def _stop(self) -> None:
        self._server.stop(wait=False)
        self._server.unlisten()
        self._loop.add_callback(self._loop.stop)
