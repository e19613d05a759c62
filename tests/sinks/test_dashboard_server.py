"""The page's server: who may ask, and that no browser can hold anything up or make anything grow."""

import ast
import base64
import contextlib
import os
import re
import socket
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from bokeh.util.token import generate_jwt_token, generate_session_id
from dashboard_support import records
from fltea.records.errors import FlteaError
from fltea.records.ports import Report
from fltea.settings.outputs import DashboardConfig
from fltea.sinks import page
from fltea.sinks.page.page import Page
from fltea.sinks.page.server import PageServer
from fltea.sinks.page.sink import DashboardSink
from host_support import PATIENCE_S, ask, port_of, wait_until

SCRIPT = "/static/js/bokeh.min.js"


def no_report(kind: str, message: str) -> None:
    raise AssertionError((kind, message))


@contextlib.contextmanager
def serving(report: Report = no_report, **settings: Any) -> Iterator[DashboardSink]:
    """A server of its own, for what another test would notice."""
    made = DashboardSink(DashboardConfig(address=0, **settings), {"due": "host"}, report)
    try:
        yield made
    finally:
        made.close()


@pytest.fixture(scope="module")
def sink() -> Iterator[DashboardSink]:
    """For requests that leave nothing behind which another test would notice."""
    with serving() as made:
        yield made


def token_of(port: int) -> str:
    """What a page that was served may open its websocket with."""
    found = re.search(r'"token":"([^"]+)"', ask(port)[1])
    return found[1]


def open_websocket(
    port: int, origin: str, host: str | None = None, token: str | None = None
) -> tuple[str, socket.socket]:
    """The first line of the answer, and a socket that nobody has to read from."""
    token = token or token_of(port)
    one = socket.create_connection(("127.0.0.1", port), timeout=PATIENCE_S)
    key = base64.b64encode(os.urandom(16)).decode()
    lines = [
        "GET /ws HTTP/1.1",
        f"Host: {host or f'127.0.0.1:{port}'}",
        "Upgrade: websocket",
        "Connection: Upgrade",
        f"Sec-WebSocket-Key: {key}",
        "Sec-WebSocket-Version: 13",
        f"Sec-WebSocket-Protocol: bokeh, {token}",
        f"Origin: {origin}",
    ]
    one.sendall("\r\n".join([*lines, "", ""]).encode())
    answer = b""
    while b"\r\n" not in answer:
        answer += one.recv(1)
    return answer.decode().strip(), one


# --- who may ask ---


def test_names_that_only_resolve_to_us_are_not_served(sink: DashboardSink) -> None:
    """Which names these are: test_listening."""
    port = port_of(sink.url)
    for path in ("/", SCRIPT, "/ws", "/autoload.js"):
        for name in ("evil.example", ""):
            status, body, _ = ask(port, path, Host=f"{name}:{port}")
            assert status in (400, 404)
            assert "token" not in body
    assert ask(port, SCRIPT, Host=f"LOCALHOST:{port}").status == 200


def test_page_of_another_origin_gets_neither_page_nor_data(sink: DashboardSink) -> None:
    port = port_of(sink.url)
    token = token_of(port)
    for origin in ("http://evil.example", f"http://evil.example:{port}", "http://127.0.0.1:1", "null"):
        assert ask(port, Origin=origin).status == 404
        line, one = open_websocket(port, origin, token=token)
        one.close()
        assert " 404 " in line
    line, one = open_websocket(port, f"http://evil.example:{port}", f"evil.example:{port}", token)
    one.close()
    assert " 404 " in line


@pytest.mark.parametrize("name", ["127.0.0.1", "localhost"])
def test_page_of_our_own_gets_its_data(sink: DashboardSink, name: str) -> None:
    port = port_of(sink.url)
    line, one = open_websocket(port, f"http://{name}:{port}", host=f"{name}:{port}")
    one.close()
    assert " 101 " in line


def test_further_names_can_be_given() -> None:
    with serving(names=("page.example",)) as named:
        assert ask(port_of(named.url), SCRIPT, Host="page.example").status == 200
        assert ask(port_of(named.url), SCRIPT, Host="pages.example").status == 404


def test_taken_port_is_told_with_what_to_do(sink: DashboardSink) -> None:
    port = port_of(sink.url)
    with pytest.raises(FlteaError, match=f"port {port} of 127.0.0.1 is taken .* give another port"):
        DashboardSink(DashboardConfig(address=port), {"due": "host"}, no_report)


# --- browsers that misbehave ---


def test_page_needs_nothing_from_elsewhere(sink: DashboardSink) -> None:
    page = ask(port_of(sink.url)).text
    links = re.findall(r'(?:src|href)="([^"]*)"', page)
    assert links == ["static/js/bokeh.min.js"]
    assert "http://" not in page.replace("http://www.w3.org", "")
    assert "https://" not in page


class Pages:
    """Counts the updates that pages were sent."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.made: list[Any] = []
        self.asked = 0
        update, make = Page.update, Page.__init__

        def made(page: Page, *arguments: Any) -> None:
            self.made.append(page)
            make(page, *arguments)

        def asked(page: Page) -> None:
            self.asked += 1
            update(page)

        monkeypatch.setattr("fltea.sinks.page.page.PERIOD_MS", 30)
        monkeypatch.setattr(Page, "__init__", made)
        monkeypatch.setattr(Page, "update", asked)


def test_browser_that_stops_reading_is_sent_nothing_more(
    small: DashboardSink, monkeypatch: pytest.MonkeyPatch
) -> None:
    pages = Pages(monkeypatch)
    port = port_of(small.url)
    line, one = open_websocket(port, f"http://127.0.0.1:{port}")
    assert " 101 " in line
    for record in records("n=400"):
        small.write(record)
    before = pages.asked
    wait_until(lambda: pages.asked >= before + 8, "eight turns")
    assert [page._tick for page in pages.made] == [1]
    one.close()


@pytest.mark.slow
def test_closed_pages_leave_nothing_behind(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fltea.sinks.page.server.UNUSED_SESSION_MS", 200)
    with serving() as quick:
        port = port_of(quick.url)
        for _ in range(4):
            line, one = open_websocket(port, f"http://127.0.0.1:{port}")
            assert " 101 " in line
            one.close()
        for _ in range(2):
            ask(port)
        wait_until(lambda: quick._server.pages == 0, "the end of all sessions")
        pages = Pages(monkeypatch)
        time.sleep(0.7)  # two periods of what would still be running
        assert pages.asked == 0


def test_fault_in_a_page_is_told_once_and_ends_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    told_of: list[tuple[str, str]] = []
    failed: list[Page] = []

    def fail(page: Page) -> None:
        failed.append(page)
        raise RuntimeError("broken on purpose")

    monkeypatch.setattr("fltea.sinks.page.page.PERIOD_MS", 30)
    monkeypatch.setattr(Page, "update", fail)
    with serving(lambda *error: told_of.append(error)) as sink:
        ask(port_of(sink.url))
        wait_until(lambda: len(failed) >= 4, "further faults")
        assert ask(port_of(sink.url)).status == 200
        assert len(told_of) == 1
        assert told_of[0][0] == "page_fault"
        assert "broken on purpose" in told_of[0][1]


def test_close_with_an_open_page_leaves_no_thread_and_frees_the_port() -> None:
    before = set(threading.enumerate())
    sink = DashboardSink(DashboardConfig(address=0), {"due": "host"}, no_report)
    port = port_of(sink.url)
    _, one = open_websocket(port, f"http://127.0.0.1:{port}")
    sink.close()
    wait_until(lambda: before.issuperset(threading.enumerate()), "the end of its threads")
    one.close()
    again = PageServer("127.0.0.1", port, (), lambda document: None, 1, no_report)
    again.close()


# --- how many there may be ---


@pytest.fixture
def told_by() -> list[tuple[str, str]]:
    return []


@pytest.fixture
def small(told_by: list[tuple[str, str]], monkeypatch: pytest.MonkeyPatch) -> Iterator[DashboardSink]:
    monkeypatch.setattr(
        "fltea.sinks.page.server.UNUSED_SESSION_MS", 60_000
    )  # on a slow machine none ends in between
    with serving(lambda *error: told_by.append(error), visitors=1) as made:
        yield made


def test_one_visitor_too_many_is_told_how_to_be_let_in(
    small: DashboardSink, told_by: list[tuple[str, str]]
) -> None:
    """200 visitors took 260 MB."""
    port = port_of(small.url)
    token = token_of(port)
    for path in ("/", "/autoload.js?bokeh-autoload-element=1", "/?x=1"):
        status, body, _ = ask(port, path)
        assert status == 503
        assert "1 visitor" in body
        assert "--set dashboard.visitors=2" in body
        assert "token" not in body
    assert ask(port, SCRIPT).status == 200
    assert small._server.pages == 1
    assert [kind for kind, _ in told_by] == ["too_many_visitors"]
    line, one = open_websocket(port, f"http://127.0.0.1:{port}", token=token)
    one.close()
    assert " 101 " in line, "a page that is there already gets its data"


def test_websocket_of_no_page_is_one_visitor_too_many(small: DashboardSink) -> None:
    port = port_of(small.url)
    ask(port)
    for token in (generate_jwt_token(generate_session_id()), "nonsense"):
        line, one = open_websocket(port, f"http://127.0.0.1:{port}", token=token)
        one.close()
        assert " 503 " in line
    assert small._server.pages == 1


def test_visitors_who_come_at_once_are_not_more(
    small: DashboardSink, monkeypatch: pytest.MonkeyPatch
) -> None:
    pages = Pages(monkeypatch)
    port = port_of(small.url)
    threads = [threading.Thread(target=ask, args=(port,)) for _ in range(20)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(pages.made) == 1


def test_when_one_leaves_another_is_let_in(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fltea.sinks.page.server.UNUSED_SESSION_MS", 200)
    with serving(lambda *error: None, visitors=1) as quick:
        port = port_of(quick.url)
        line, one = open_websocket(port, f"http://127.0.0.1:{port}")
        assert " 101 " in line
        assert ask(port).status == 503
        one.close()
        wait_until(lambda: ask(port).status == 200, "room")


def test_the_page_knows_only_what_records_say() -> None:
    """Neither estimator nor walk: nothing native that a thread which outlives the program could hold.

    Nor do the documents that it writes know more.
    """
    folder = Path(page.__file__).parent
    found = {module for file in folder.glob("*.py") for module in modules_of(file)}
    assert {module.split(".")[1] for module in found} == {"documents", "records", "settings", "sinks"}
    written = list((folder.parents[1] / "documents").glob("*.py"))
    assert len(written) > 2
    assert {module for file in written for module in modules_of(file)} <= {
        "fltea.records.fit",
        "fltea.records.version",
        "fltea.records.visible",
    }


def modules_of(file: Path) -> set[str]:
    """Our own modules that a file imports from."""
    nodes = ast.walk(ast.parse(file.read_text()))
    names = {node.module or "" for node in nodes if isinstance(node, ast.ImportFrom)}
    return {name for name in names if name.startswith("fltea.")}
