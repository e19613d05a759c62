"""Accept the connections of browsers to a page.

The number of connections, and the time for which one may be idle, are limited.
"""

import contextlib
import logging
import resource
import socket
import time
from collections.abc import Sequence
from typing import cast

from tornado.http1connection import HTTP1ServerConnection
from tornado.httpserver import HTTPServer
from tornado.httputil import HTTPConnection, HTTPMessageDelegate, HTTPServerConnectionDelegate
from tornado.ioloop import IOLoop
from tornado.iostream import IOStream
from tornado.netutil import bind_sockets
from tornado.web import Application

from fltea.records import clock
from fltea.records.ports import Report
from fltea.records.repeat import OnceAMinute
from fltea.sinks.listening import cannot_listen

MOST = 128
"""Largest number of open connections. A browser needs one connection, and for a moment up to six. At most a
quarter of the process's file descriptors is used for connections.
"""

IDLE_S, SWEEP_S = 30.0, 5.0
"""`IDLE_S`: time after which a connection is closed if its browser sends no request or does not read the
answer [s].
`SWEEP_S`: time between two checks of which connections have to be closed [s].
"""

REST_S = 1.0
"""After a connection could not be accepted, for example for lack of file descriptors, no connection is
accepted for this time [s].
"""

LARGEST_HEADER = 16_384
UNREAD = 1 << 16
"""Number of bytes of an answer that the operating system may buffer while a browser does not read. By default
the system would buffer megabytes.
"""


def bind(option: str, host: str, port: int) -> list[socket.socket]:
    """Listen at an address and port. `option`: name of the setting that gives them, for error messages.

    Raises:
        FlteaError: another program uses the address, or this machine does not have it.
    """
    try:
        sockets = bind_sockets(port, host)
    except (OSError, UnicodeError) as error:
        raise cannot_listen(option, host, port, error) from error
    # accepted connections inherit this size of the send buffer from the listening sockets
    for one in sockets:
        one.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, UNREAD)
    return sockets


class Door(HTTPServerConnectionDelegate):
    """Serves a web application on sockets, in the event loop of the thread that creates this object.

    A new connection may exceed the limit of all connections. Then the connection that has been idle longest
    is closed. One address may have half of all allowed connections. If it opens another, its own connection
    that has been idle longest is closed.
    """

    def __init__(self, sockets: Sequence[socket.socket], application: Application, report: Report) -> None:
        self._loop, self._sockets = IOLoop.current(), list(sockets)
        self._application, self._report = application, report
        self._http = HTTPServer(self, max_body_size=0, max_header_size=LARGEST_HEADER)
        self._open: dict[IOStream, tuple[str, float]] = {}
        """For each connection, the browser's address, and the time at which the connection began to wait for
        a request. The connection that has waited longest comes first.
        """
        self._often = OnceAMinute()
        self._closed_for_room = 0
        self.most = min(MOST, resource.getrlimit(resource.RLIMIT_NOFILE)[0] // 4)
        self._listen()
        self._sweep_due = self._loop.call_later(SWEEP_S, self._sweep)

    @property
    def connections(self) -> int:
        return sum(not stream.closed() for stream in self._open)

    def close(self) -> None:
        """Accept no more connections, and close the open ones."""
        self._loop.remove_timeout(self._sweep_due)
        for one in self._sockets:
            self._loop.remove_handler(one)
            one.close()
        for stream in list(self._open):
            stream.close()

    def start_request(self, server_conn: object, request_conn: HTTPConnection) -> HTTPMessageDelegate:
        """Note that a connection waits for a request from now on. The library tornado calls this method."""
        stream = cast(HTTP1ServerConnection, server_conn).stream
        if (found := self._open.pop(stream, None)) is not None:
            self._open[stream] = found[0], time.monotonic()
        return self._application.start_request(server_conn, request_conn)

    def _listen(self) -> None:
        for one in self._sockets:
            if one.fileno() >= 0:
                self._loop.add_handler(one, self._accept, IOLoop.READ)

    def _accept(self, listening: socket.socket, events: int) -> None:
        for _ in range(MOST):
            try:
                connection, address = listening.accept()
            except (BlockingIOError, ConnectionAbortedError):
                return
            except OSError as error:
                for one in self._sockets:
                    self._loop.remove_handler(one)
                self._loop.call_later(REST_S, self._listen)
                self._say(
                    f"the page cannot take connections for now: {error.strerror}. Everything else goes on."
                )
                return
            self._make_room(str(address[0]))
            stream = IOStream(connection, max_buffer_size=1 << 17)
            self._open[stream] = str(address[0]), time.monotonic()
            self._http.handle_stream(stream, address)

    def _make_room(self, name: str) -> None:
        self._forget_closed()
        of_address = [stream for stream, (other, _) in self._open.items() if other == name]
        if len(of_address) * 2 >= self.most:
            of_address[0].close()
        elif len(self._open) >= self.most:
            next(iter(self._open)).close()
        else:
            return
        self._closed_for_room += 1
        self._say(
            f"more than {self.most} connections to the page, or {self.most // 2} from one address. Those "
            f"idle longest are closed: {self._closed_for_room} so far, the last to make room for {name}."
        )

    def _say(self, text: str) -> None:
        if self._often.is_due("too_many_connections", clock.host_ns()):
            self._report("too_many_connections", text)

    def _sweep(self) -> None:
        self._sweep_due = self._loop.call_later(SWEEP_S, self._sweep)
        old = time.monotonic() - IDLE_S
        for stream, (_, since) in list(self._open.items()):
            if since < old:
                stream.close()
        self._forget_closed()

    def _forget_closed(self) -> None:
        for stream in [stream for stream in self._open if stream.closed()]:
            del self._open[stream]


class LibraryErrors(logging.Handler):
    """Reports errors of the libraries tornado and asyncio, at most one a minute.

    This object replaces the libraries' own log handlers.

    The libraries' own handlers would write to stderr. Messages that are less severe than errors are dropped.
    """

    def __init__(self, report: Report) -> None:
        super().__init__(logging.ERROR)
        self._report = report
        self._once_a_minute = OnceAMinute()
        for name in ("tornado", "asyncio"):
            logger = logging.getLogger(name)
            logger.propagate = False
            logger.setLevel(logging.ERROR)
            logger.handlers = [self]

    def emit(self, record: logging.LogRecord) -> None:
        """Report an error, unless one was reported within the last minute."""
        if not self._once_a_minute.is_due("page_fault", clock.host_ns()):
            return
        what = (record.getMessage().strip().splitlines() or [""])[0]
        error = record.exc_info[1] if record.exc_info else None
        cause = "" if error is None else f" ({type(error).__name__}: {error})"
        # the error of a failed report is dropped, since it would come to this method again
        with contextlib.suppress(Exception):
            self._report("page_fault", f"the page has a fault; everything else goes on. {what}{cause}")
