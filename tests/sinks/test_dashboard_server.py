"""The page's server: who may ask, and that no browser can hold anything up or make anything grow."""

import ast
import base64
import http.client
import json
import os
import re
import socket
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest
from bokeh.document import Document
from bokeh.util.token import generate_jwt_token, generate_session_id
from dashboard_support import records, told
from fltea.records.errors import FlteaError
from fltea.records.records import Estimate
from fltea.settings.outputs import DashboardConfig
from fltea.sinks import page
from fltea.sinks.listening import own_names
from fltea.sinks.page.history import DeviceHistory
from fltea.sinks.page.page import Page
from fltea.sinks.page.server import PageServer
from fltea.sinks.page.sink import DashboardSink
from fltea.sinks.page.tiers import WINDOWS
from support import PATIENCE_S, wait_until

SCRIPT = "/static/js/bokeh.min.js"


def no_report(kind: str, message: str) -> None:
    raise AssertionError((kind, message))


@pytest.fixture(scope="module")
def sink() -> Iterator[DashboardSink]:
    """For requests that leave nothing behind which another test would notice."""
    made = DashboardSink(DashboardConfig(address=0), {"due": "host"}, no_report)
    yield made
    made.close()


def port_of(sink: DashboardSink) -> int:
    return int(sink.url.rstrip("/").rpartition(":")[2])


def get(port: int, path: str = "/", **headers: str) -> tuple[int, str]:
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=PATIENCE_S)
    try:
        connection.request("GET", path, headers=headers)
        answer = connection.getresponse()
        return answer.status, answer.read().decode()
    finally:
        connection.close()


def token_of(port: int) -> str:
    """What a page that was served may open its websocket with."""
    found = re.search(r'"token":"([^"]+)"', get(port)[1])
    assert found is not None
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


@pytest.mark.parametrize("name", ["127.0.0.1", "localhost", "LOCALHOST", "[::1]", "192.168.1.7"])
def test_own_names_and_bare_addresses_are_served(sink: DashboardSink, name: str) -> None:
    port = port_of(sink)
    assert get(port, SCRIPT, Host=f"{name}:{port}")[0] == 200


@pytest.mark.parametrize(
    "name", ["evil.example", "localhost.evil.example", "127.0.0.1.evil.example", "", "1.2.3", "[::1"]
)
def test_names_that_only_resolve_to_us_are_not(sink: DashboardSink, name: str) -> None:
    """DNS rebinding: somebody else's name comes to point here, and his page asks for ours."""
    port = port_of(sink)
    for path in ("/", SCRIPT, "/ws", "/autoload.js"):
        status, body = get(port, path, Host=f"{name}:{port}")
        assert status in (400, 404)
        assert "token" not in body


def test_page_of_another_origin_gets_neither_page_nor_data(sink: DashboardSink) -> None:
    port = port_of(sink)
    token = token_of(port)
    for origin in ("http://evil.example", f"http://evil.example:{port}", "http://127.0.0.1:1", "null"):
        assert get(port, Origin=origin)[0] == 404
        line, one = open_websocket(port, origin, token=token)
        one.close()
        assert " 404 " in line
    line, one = open_websocket(port, f"http://evil.example:{port}", f"evil.example:{port}", token)
    one.close()
    assert " 404 " in line


@pytest.mark.parametrize("name", ["127.0.0.1", "localhost"])
def test_page_of_our_own_gets_its_data(sink: DashboardSink, name: str) -> None:
    port = port_of(sink)
    line, one = open_websocket(port, f"http://{name}:{port}", host=f"{name}:{port}")
    one.close()
    assert " 101 " in line


def test_further_names_can_be_given() -> None:
    assert {"localhost", "10.0.0.5", "page.example"} <= own_names("10.0.0.5", ["page.example"])
    sink = DashboardSink(DashboardConfig(address=0, names=("page.example",)), {"due": "host"}, no_report)
    try:
        assert get(port_of(sink), SCRIPT, Host="page.example")[0] == 200
        assert get(port_of(sink), SCRIPT, Host="pages.example")[0] == 404
    finally:
        sink.close()


# --- address ---


def test_taken_port_is_told_with_what_to_do(sink: DashboardSink) -> None:
    port = port_of(sink)
    with pytest.raises(FlteaError, match=f"port {port} of 127.0.0.1 is taken .* give another port"):
        DashboardSink(DashboardConfig(address=port), {"due": "host"}, no_report)


@pytest.mark.parametrize("host", ["203.0.113.7", "no-such-name.invalid"])
def test_foreign_address_is_told_with_what_to_do(host: str) -> None:
    with pytest.raises(FlteaError, match="no address of this machine"):
        DashboardSink(DashboardConfig(address=f"{host}:0"), {"due": "host"}, no_report)


@pytest.mark.parametrize("address", ["page", "127.0.0.1:", ":5006", "::1:5006", "70000", "-1"])
def test_address_that_is_none_is_refused(address: str) -> None:
    with pytest.raises(ValueError, match="address"):
        DashboardConfig(address=address)


def test_loopback_unless_told_otherwise() -> None:
    assert DashboardConfig(address=5006).listen() == ("127.0.0.1", 5006)
    assert DashboardConfig(address="[::1]:5006").listen() == ("::1", 5006)


# --- browsers that misbehave ---


def test_page_needs_nothing_from_elsewhere(sink: DashboardSink) -> None:
    _, page = get(port_of(sink))
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

        monkeypatch.setattr(Page, "__init__", made)
        monkeypatch.setattr(Page, "update", asked)


def test_browser_that_stops_reading_is_sent_nothing_more(
    small: DashboardSink, monkeypatch: pytest.MonkeyPatch
) -> None:
    pages = Pages(monkeypatch)
    port = port_of(small)
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
    quick = DashboardSink(DashboardConfig(address=0), {"due": "host"}, no_report)
    port = port_of(quick)
    try:
        for _ in range(4):
            line, one = open_websocket(port, f"http://127.0.0.1:{port}")
            assert " 101 " in line
            one.close()
        for _ in range(2):
            get(port)
        wait_until(lambda: quick._server.pages == 0, "the end of all sessions")
        pages = Pages(monkeypatch)
        time.sleep(0.7)  # two periods of what would still be running
        assert pages.asked == 0
    finally:
        quick.close()


@pytest.mark.slow
def test_fault_in_a_page_is_told_once_and_ends_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    told_of: list[tuple[str, str]] = []
    sink = DashboardSink(DashboardConfig(address=0), {"due": "host"}, lambda *error: told_of.append(error))

    def fail(page: Page) -> None:
        raise RuntimeError("broken on purpose")

    monkeypatch.setattr(Page, "update", fail)
    try:
        get(port_of(sink))
        wait_until(lambda: bool(told_of), "the report")
        time.sleep(0.7)
        assert get(port_of(sink))[0] == 200
        assert len(told_of) == 1
        assert told_of[0][0] == "page_fault"
        assert "broken on purpose" in told_of[0][1]
    finally:
        sink.close()


def test_close_with_an_open_page_leaves_no_thread_and_frees_the_port() -> None:
    before = set(threading.enumerate())
    sink = DashboardSink(DashboardConfig(address=0), {"due": "host"}, no_report)
    port = port_of(sink)
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
    config = DashboardConfig(address=0, visitors=1)
    made = DashboardSink(config, {"due": "host"}, lambda *error: told_by.append(error))
    yield made
    made.close()


def test_one_visitor_too_many_is_told_how_to_be_let_in(
    small: DashboardSink, told_by: list[tuple[str, str]]
) -> None:
    """200 visitors took 260 MB."""
    port = port_of(small)
    token = token_of(port)
    for path in ("/", "/autoload.js?bokeh-autoload-element=1", "/?x=1"):
        status, body = get(port, path)
        assert status == 503
        assert "1 visitor" in body
        assert "--set dashboard.visitors=2" in body
        assert "token" not in body
    assert get(port, SCRIPT)[0] == 200
    assert small._server.pages == 1
    assert [kind for kind, _ in told_by] == ["too_many_visitors"]
    line, one = open_websocket(port, f"http://127.0.0.1:{port}", token=token)
    one.close()
    assert " 101 " in line, "a page that is there already gets its data"


def test_websocket_of_no_page_is_one_visitor_too_many(small: DashboardSink) -> None:
    port = port_of(small)
    get(port)
    for token in (generate_jwt_token(generate_session_id()), "nonsense"):
        line, one = open_websocket(port, f"http://127.0.0.1:{port}", token=token)
        one.close()
        assert " 503 " in line
    assert small._server.pages == 1


def test_visitors_who_come_at_once_are_not_more(
    small: DashboardSink, monkeypatch: pytest.MonkeyPatch
) -> None:
    pages = Pages(monkeypatch)
    port = port_of(small)
    threads = [threading.Thread(target=get, args=(port,)) for _ in range(20)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(pages.made) == 1


def test_when_one_leaves_another_is_let_in(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fltea.sinks.page.server.UNUSED_SESSION_MS", 200)
    quick = DashboardSink(DashboardConfig(address=0, visitors=1), {"due": "host"}, lambda *error: None)
    try:
        port = port_of(quick)
        line, one = open_websocket(port, f"http://127.0.0.1:{port}")
        assert " 101 " in line
        assert get(port)[0] == 503
        one.close()
        wait_until(lambda: get(port)[0] == 200, "room")
    finally:
        quick.close()


def test_visitors_are_at_least_one() -> None:
    with pytest.raises(ValueError, match="visitors"):
        DashboardConfig(address=5006, visitors=0)


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
        "fltea.records.version",
        "fltea.records.visible",
    }


def modules_of(file: Path) -> set[str]:
    """Our own modules that a file imports from."""
    nodes = ast.walk(ast.parse(file.read_text()))
    names = {node.module or "" for node in nodes if isinstance(node, ast.ImportFrom)}
    return {name for name in names if name.startswith("fltea.")}


# --- what a page sends ---


class Browser:
    """The other side of a page, in this thread."""

    def __init__(self, *groups: list[Any]) -> None:
        self.history = told(*groups)
        self.page = Page(Document(), {"due": self.history, "other": DeviceHistory("other", "host")})

    def choose(self, **choice: Any) -> None:
        usual: dict[str, Any] = {"device": "", "axis": "", "window": None, "ack": self.page._tick}
        self.page._control.data = {name: [value] for name, value in {**usual, **choice}.items()}

    def update(self) -> dict[str, Any]:
        self.page.update()
        said: dict[str, Any] = json.loads(self.page._facts.data["json"][0])
        self.choose()
        return said


def test_figures_hold_the_estimates_and_only_the_new_ones_are_sent() -> None:
    found = records("n=400")
    browser = Browser(found[:-1])
    told_first = browser.update()
    rows = browser.page._figures.estimates
    last = next(r for r in reversed(found) if isinstance(r, Estimate))
    browser.choose(window=0)
    told_now = browser.update()
    assert told_first["seq"] == told_now["seq"] == last.seq
    x = last.axes["gyro_x"]
    assert (rows.data["alpha"][-1], rows.data["f"][-1]) == (x.alpha, x.f)
    assert rows.data["alpha_high"][-1] == x.alpha + x.alpha_std
    assert rows.data["alpha_low"][-1] == x.alpha - x.alpha_std
    before = len(rows.data["alpha"])
    browser.history.write(msgspec.structs.replace(found[-3], seq=last.seq + 1))
    browser.history.write(msgspec.structs.replace(found[-3], seq=last.seq + 2))
    browser.update()
    assert len(rows.data["alpha"]) == before + 1


def test_source_of_a_page_does_not_outgrow_its_window() -> None:
    found = records("n=3400")
    browser = Browser(found[:200])
    browser.choose(window=0)
    for k in range(200, len(found), 100):
        for record in found[k : k + 100]:
            browser.history.write(record)
        browser.update()
    assert len(browser.page._figures.estimates.data["alpha"]) == 30 * 100 + 2


def test_choices() -> None:
    browser = Browser(records("n=400"))
    assert browser.update()["axis"] == "gyro_x"
    browser.choose(axis="gyro_z", window=2)
    told_now = browser.update()
    assert (told_now["axis"], told_now["window"]) == ("gyro_z", 2)
    browser.choose(device="other")
    assert browser.update()["device"] == "other"
    browser.choose(device="due", axis="gyro_y")
    assert browser.update()["axis"] == "gyro_y"


@pytest.mark.parametrize(
    "choice",
    [
        {"axis": "gyro_q"},
        {"axis": 3},
        {"axis": None},
        {"device": ["due"]},
        {"window": len(WINDOWS)},
        {"window": -1},
        {"window": "0"},
        {"ack": "x"},
        {"ack": None},
        {"device": "<script>"},
    ],
)
def test_choices_that_make_no_sense_change_nothing(choice: dict[str, Any]) -> None:
    browser = Browser(records("n=400"))
    before = browser.update()
    browser.choose(**choice)
    after = browser.update()
    for name in ("device", "axis", "window", "axes"):
        assert after[name] == before[name]


@pytest.mark.parametrize("data", [{}, {"device": []}, {"device": ["due"], "axis": "gyro_x"}, {"ack": [1, 2]}])
def test_choices_of_a_wrong_shape_are_ignored(data: dict[str, Any]) -> None:
    browser = Browser(records("n=400"))
    browser.page._on_control("data", None, data)
    assert browser.update()["axis"] == "gyro_x"
