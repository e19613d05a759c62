"""Tests, over real sockets, of the web server of both live pages (of one device and of many): access, rate
limits, number of connections.
"""

import asyncio
import base64
import errno
import socket
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest
from fltea.sinks.listening import own_names
from fltea.sinks.web import door as door_module
from fltea.sinks.web.door import Door, LibraryErrors, bind
from fltea.sinks.web.handler import Handler, Site
from tornado.ioloop import IOLoop

from tests.rig.host_support import PATIENCE_S, ask, each_ended, wait_until


class Echo(Handler):
    def get(self) -> None:
        if self.get_argument("fail", ""):
            raise RuntimeError("broken on purpose")
        self.answer({"number": self.number("n", 3, 10)})


class Served:
    """A server that runs in a separate thread.

    `reports`: errors that the server has reported.
    """

    def __init__(self, sockets: list[socket.socket] | None = None, **of_site: Any) -> None:
        self.reports: list[tuple[str, str]] = []
        self._sockets = sockets or bind("--listen", "127.0.0.1", 0)
        self.port: int = self._sockets[0].getsockname()[1]
        usual: dict[str, Any] = {"names": own_names("127.0.0.1", ()), "a_second": 1000.0, "full": "Too many."}
        self._site = Site("fltea.fleet", report=self._report, **usual | of_site)
        self._ready = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()
        assert self._ready.wait(PATIENCE_S)

    def _report(self, kind: str, text: str) -> None:
        self.reports.append((kind, text))

    def _run(self) -> None:
        asyncio.set_event_loop(asyncio.new_event_loop())
        self._loop = IOLoop.current()
        LibraryErrors(self._report)
        self.door = Door(self._sockets, self._site.application([("/echo", Echo)]), self._report)
        self._ready.set()
        self._loop.start()
        self._loop.close(all_fds=True)

    def connect(self) -> socket.socket:
        return socket.create_connection(("127.0.0.1", self.port), timeout=PATIENCE_S)

    def turn(self, call: Callable[[], None] = lambda: None) -> None:
        """Call a function in the server's event loop, and wait until the call has ended."""
        turned = threading.Event()
        self._loop.add_callback(lambda: (call(), turned.set()))
        assert turned.wait(PATIENCE_S)

    def close(self) -> None:
        self._loop.add_callback(self.door.close)
        self._loop.add_callback(self._loop.stop)
        self._thread.join(PATIENCE_S)


Serve = Callable[..., Served]


@pytest.fixture
def serve() -> Iterator[Serve]:
    yield from each_ended(Served, Served.close)


def is_closed(one: socket.socket) -> bool:
    """Return whether the other side has closed the connection."""
    one.settimeout(0.0)
    try:
        return one.recv(1) == b""
    except BlockingIOError:
        return False
    except ConnectionResetError:
        return True


# --- access ---


def test_only_who_came_by_a_name_of_ours_and_from_a_page_of_ours_is_answered(serve: Serve) -> None:
    """A request is refused if its header Host is no name of this page, or if its header Origin is another
    page. test_listening tests which host names are accepted.
    """
    port = serve(names=own_names("127.0.0.1", ("page.example",))).port
    for path in ("/", "/common.js", "/echo", "/nothing"):
        assert ask(port, path, Host=f"evil.example:{port}").status == 421
        for origin in ("http://evil.example", f"http://evil.example:{port}", "http://127.0.0.1:1", "null"):
            assert ask(port, path, Origin=origin).status == 403
    assert ask(port, "/echo", Host="page.example").text == '{"number":3}'
    assert ask(port, "/echo?n=99", Origin=f"http://127.0.0.1:{port}").text == '{"number":10}'
    assert [ask(port, f"/echo?n={n}").status for n in ("-1", "x", "9" * 10)] == [400] * 3
    assert ask(port, "/nothing").status == 404


def test_nothing_comes_from_elsewhere_and_no_text_becomes_a_script(serve: Serve) -> None:
    port = serve().port
    for path in ("/", "/page.js", "/page.css", "/common.js", "/common.css"):
        status, text, headers = ask(port, path)
        assert status == 200
        assert "//" not in text.replace("http://www.w3.org", "").replace("// ", "")
        assert "default-src 'none'" in headers["Content-Security-Policy"]
        assert "unsafe" not in headers["Content-Security-Policy"]


def test_a_fault_is_reported_once_and_ends_nothing(serve: Serve) -> None:
    served = serve()
    assert [ask(served.port, "/echo?fail=1").status for _ in range(5)] == [500] * 5
    assert ask(served.port, "/echo").status == 200
    assert [kind for kind, _ in served.reports] == ["page_fault"]
    assert "broken on purpose" in served.reports[0][1]


# --- limits ---


def test_more_requests_than_are_answered_are_told_so_and_later_ones_answered(serve: Serve) -> None:
    served = serve(a_second=2.0, full="Too many. Raise it.")
    found = [ask(served.port, "/echo") for _ in range(60)]
    assert [one.status for one in found[:20]] == [200] * 20, "for a moment"
    refused = next(one for one in found if one.status == 503)
    assert refused.text == "Too many. Raise it.\n"
    assert refused.headers["Retry-After"] == "10"
    assert served.reports == [("too_many_visitors", "Too many. Raise it.")]
    wait_until(lambda: ask(served.port, "/echo").status == 200, "room")


def test_who_guesses_the_password_takes_no_room_from_who_knows_it(serve: Serve) -> None:
    """Clients that guess the password take no room from one that knows it. Once, 40 clients that guessed for
    8 s locked the owner out.
    """
    served = serve(a_second=2.0, password="me:hunter2")
    known, wrong = (
        {"Authorization": "Basic " + base64.b64encode(text).decode()} for text in (b"me:hunter2", b"me:no")
    )
    with ThreadPoolExecutor(20) as pool:
        guesses = [*pool.map(lambda _: ask(served.port, "/echo", **wrong).status, range(60))]
        assert set(guesses) == {401, 503}
        assert [ask(served.port, "/echo", **known).status for _ in range(15)] == [200] * 15
    assert served.reports[0][0] == "too_many_visitors"


@pytest.mark.slow
def test_idle_connections_are_few_and_a_reader_still_gets_its_page(serve: Serve) -> None:
    """Idle connections are limited. Once, 330 of them used all file descriptors of the daemon, so that its
    recording failed.
    """
    served = serve()
    idle = [served.connect() for _ in range(330)]
    assert ask(served.port, "/echo").status == 200
    assert served.door.connections <= served.door.most // 2
    wait_until(lambda: sum(map(is_closed, idle)) >= 330 - served.door.most // 2, "hung up")
    assert [kind for kind, _ in served.reports] == ["too_many_connections"], "once a minute"
    assert "127.0.0.1" in served.reports[0][1]
    for one in idle:
        one.close()


def test_the_one_idle_longest_makes_room_not_the_one_that_asks(serve: Serve) -> None:
    served = serve()
    served.door.most = 8
    reader, idle = served.connect(), []
    for _ in range(10):
        idle.append(served.connect())
        reader.sendall(b"GET /echo HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
        answer = b""
        while b'{"number":3}' not in answer:
            answer += (more := reader.recv(4096))
            assert more, "the one that asks was closed"
    wait_until(lambda: [is_closed(one) for one in idle] == [True] * 7 + [False] * 3, "the first ones' end")


def test_a_connection_that_asks_for_nothing_or_takes_no_answer_is_closed(
    serve: Serve, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(door_module, "IDLE_S", 0.1)
    monkeypatch.setattr(door_module, "SWEEP_S", 0.05)
    served = serve()
    silent, slow, deaf = served.connect(), served.connect(), served.connect()
    slow.sendall(b"GET /echo HTTP/1.1\r\nHost: 127")
    deaf.sendall(b"GET /common.js HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n" * 200)
    wait_until(lambda: is_closed(silent) and is_closed(slow), "hung up")
    wait_until(lambda: served.door.connections == 0, "nobody")


class Exhausted(socket.socket):
    """A listening socket whose first `accept` fails for lack of file descriptors."""

    failures = 1

    def __init__(self) -> None:
        super().__init__()
        self.asked = 0

    def accept(self) -> Any:
        self.asked += 1
        if self.asked <= self.failures:
            raise OSError(errno.EMFILE, "Too many open files")
        return super().accept()


def test_without_descriptors_nobody_is_let_in_for_a_while_and_then_again(
    serve: Serve, monkeypatch: pytest.MonkeyPatch
) -> None:
    """After a failed `accept`, the server waits. Once, each failure was reported with a traceback and
    `accept` was tried again at once, 81,740 times.
    """
    monkeypatch.setattr(door_module, "REST_S", 3600.0)
    listening = Exhausted()
    listening.bind(("127.0.0.1", 0))
    listening.listen()
    listening.setblocking(False)
    served = serve(sockets=[listening])
    waiting = served.connect()
    wait_until(lambda: listening.asked == 1, "an accept that fails")
    for _ in range(50):
        served.turn()
    assert listening.asked == 1
    assert [kind for kind, _ in served.reports] == ["too_many_connections"]
    assert "Too many open files" in served.reports[0][1]
    served.turn(served.door._listen)
    assert ask(served.port, "/echo").status == 200
    waiting.close()
