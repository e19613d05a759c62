"""Tests of the thread that reads a port, with pseudo-terminals, sockets and errors of the system."""

import errno
import os
import socket
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import serial
from fltea.records.errors import UsageError
from fltea.records.events import Chunk, Failed, Opened, TransportEvent
from fltea.wire import reader as port_reader
from fltea.wire import transport
from fltea.wire.permission import Group, User
from fltea.wire.reader import Reader
from fltea.wire.transport import Port, explain_open_failure

from tests.rig.host_support import PATIENCE_S, ROOT, each_ended, wait_until
from tests.rig.terminal import Terminal


@pytest.fixture
def readers() -> Iterator[Callable[[str | Path], Reader]]:
    def start(url: str | Path) -> Reader:
        reader = Reader(Port(str(url), 250000))
        reader.start()
        return reader

    yield from each_ended(start, Reader.close)


@pytest.fixture
def terminal(tmp_path: Path) -> Iterator[Terminal]:
    found = Terminal(tmp_path / "port")
    yield found
    found.unplug()


def next_of(kind: type[TransportEvent], events: Iterator[TransportEvent | None]) -> TransportEvent:
    deadline = time.monotonic() + PATIENCE_S
    for event in events:
        if isinstance(event, kind):
            return event
        assert time.monotonic() < deadline, f"no {kind.__name__} came"
    raise AssertionError("the reader ended")


def failure(events: Iterator[TransportEvent | None]) -> Failed:
    found = next_of(Failed, events)
    assert isinstance(found, Failed)
    return found


def received(n: int, events: Iterator[TransportEvent | None]) -> bytes:
    data = b""
    while len(data) < n:
        chunk = next_of(Chunk, events)
        assert isinstance(chunk, Chunk)
        data += chunk.data
    return data


def test_bytes_of_a_pty_arrive_at_a_baud_rate_that_has_no_name(terminal, readers) -> None:
    events = readers(terminal.link).events(0.05)
    next_of(Opened, events)
    terminal.send(bytes(range(256)))
    assert received(256, events) == bytes(range(256))


def test_an_unplugged_port_is_an_event_and_is_tried_again(terminal, readers) -> None:
    events = readers(terminal.link).events(0.05)
    next_of(Opened, events)
    terminal.unplug()
    assert [failure(events).kind for _ in range(2)] == ["unplugged", "no_port"]


def broken(*arguments: object) -> bytes:
    raise TypeError("'NoneType' object cannot be interpreted as an integer")


def test_any_exception_of_a_driver_becomes_an_event(monkeypatch, readers) -> None:
    monkeypatch.setattr(type(serial.serial_for_url("loop://")), "read", broken)
    events = readers("loop://").events(0.05)
    for _ in range(2):  # the second time shows that the reading thread goes on after an exception
        next_of(Opened, events)
        assert "NoneType" in failure(events).message


def test_bytes_that_were_read_before_an_exception_are_handed_on(monkeypatch, readers) -> None:
    """The port fails after one byte was read, when it is asked how many more bytes are waiting."""
    kind = type(serial.serial_for_url("loop://"))
    given = iter([b"\x00"])
    monkeypatch.setattr(kind, "read", lambda port, size=1: next(given, None) or broken())
    monkeypatch.setattr(kind, "in_waiting", property(broken))
    events = readers("loop://").events(0.05)
    assert received(1, events) == b"\x00"
    assert "NoneType" in failure(events).message


def test_a_port_whose_descriptor_cannot_be_had_is_tried_again(monkeypatch, terminal, readers) -> None:
    monkeypatch.setattr(transport, "BACKOFF_S", (0.05,))
    with monkeypatch.context() as patch:
        patch.setattr(transport, "_descriptor_of", broken)
        events = readers(terminal.link).events(0.05)
        for _ in range(2):
            assert "NoneType" in failure(events).message
    next_of(Opened, events)


def test_a_second_reader_finds_the_port_busy_and_gets_it_when_it_is_free(terminal, readers) -> None:
    first = readers(terminal.link)
    next_of(Opened, first.events(0.05))
    events = readers(terminal.link).events(0.05)
    busy = failure(events)
    assert busy.kind == "port_busy"
    assert "ModemManager" in busy.message
    first.close()
    next_of(Opened, events)


def test_a_port_that_is_not_there(readers) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    for url, says in (
        (f"socket://127.0.0.1:{port}", "cannot connect"),
        ("hwgrep://no such board", "no such board"),
    ):
        failed = failure(readers(url).events(0.05))
        assert (failed.kind, says in failed.message) == ("no_port", True)


def test_close_ends_the_events_and_frees_the_port(terminal) -> None:
    reader = Reader(Port(str(terminal.link), 250000))
    reader.start()
    events = reader.events(0.05)
    next_of(Opened, events)
    reader.close()
    assert all(event is None or isinstance(event, Chunk) for event in events)
    with serial.Serial(str(terminal.link), exclusive=True):
        pass


def test_a_slow_consumer_costs_bytes_that_are_counted(monkeypatch, terminal) -> None:
    monkeypatch.setattr(port_reader, "QUEUE_BYTES", 55)
    reader = Reader(Port(str(terminal.link), 250000))
    reader.start()
    wait_until(lambda: not reader._queue.empty(), "the port to be open, and what was in it thrown away")
    sent = 0

    def overflows() -> bool:
        nonlocal sent
        sent += os.write(terminal.master, b"0123456789")
        return reader.port.overflow_bytes > 0

    os.set_blocking(terminal.master, True)
    wait_until(overflows, "bytes that nobody took")
    kept = 0
    for event in reader.events(0.05):
        kept += len(event.data) if isinstance(event, Chunk) else 0
        if kept + reader.port.overflow_bytes >= sent:
            break
    reader.close()
    assert kept + reader.port.overflow_bytes == sent


@pytest.mark.parametrize("baud", [1200, 0, -1])
def test_refused_baud_rates(baud: int) -> None:
    with pytest.raises(UsageError, match="erases its flash" if baud == 1200 else "not possible"):
        Port("/dev/ttyACM0", baud)


@pytest.mark.parametrize(
    ("number", "kind", "words"),
    [
        (errno.EACCES, "no_permission", "usermod -aG dialout"),
        (errno.EPERM, "no_permission", "usermod -aG"),
        (errno.EBUSY, "port_busy", "fltea devices"),
        (errno.EAGAIN, "port_busy", "fltea devices"),
        (errno.ENOENT, "no_port", "there is no port"),
        (errno.ENODEV, "no_port", "there is no port"),
        (errno.EIO, "open_failed", "cannot open"),
    ],
)
def test_what_the_operating_system_says_is_explained(number: int, kind: str, words: str) -> None:
    found, text = explain_open_failure("/dev/ttyX", serial.SerialException(number, os.strerror(number)))
    assert found == kind
    assert words in text


def test_no_permission_names_what_opens_the_port(monkeypatch) -> None:
    """Without permission for the port, the error names the command that gives it. All cases are tested in
    tests/machine/test_devices.py.

    While fltea searches for a board, the port is unknown, so the error names the usual group of ports.
    """
    monkeypatch.setattr(transport, "this_user", lambda: User("anna", set(), set()))
    denied = PermissionError(errno.EACCES, "denied")
    text = explain_open_failure(transport.ANY_BOARD, denied)[1]
    assert "usually belong to the group 'dialout': sudo usermod -aG dialout anna" in text
    monkeypatch.setattr(transport, "group_of", lambda path: Group(986, "uucp", True))
    assert "sudo usermod -aG uucp anna" in explain_open_failure("/dev/ttyX", denied)[1]


@pytest.mark.parametrize(
    "url",
    [
        "carrier-pigeon://home",
        "hwgrep://[",
        "socket://localhost",
        "rfc2217://pi:x",
        "RFC2217://pi",
        "SOCKET://pi",
    ],
)
def test_urls_that_no_retry_can_cure_are_refused(url: str) -> None:
    with pytest.raises(UsageError, match="no serial port that this program knows"):
        Port(url, 250000)


@pytest.mark.parametrize("baud", [-1, 0, 99_999_999_999])
def test_a_speed_that_no_port_has_is_refused(baud: int) -> None:
    with pytest.raises(UsageError, match="is not possible"):
        Port("/dev/ttyX", baud)


@pytest.mark.parametrize("scheme", ["spy", "SPY", "alt", "cp2110"])
def test_urls_that_write_files_or_load_classes_are_refused_before_pyserial_sees_them(
    scheme: str, tmp_path: Path
) -> None:
    """Other schemes of pyserial's URLs are refused before pyserial sees them. For `spy:`, pyserial would
    empty the file named by `?file=` when it parses the URL.
    """
    file = tmp_path / "mine"
    file.write_text("kept")
    with pytest.raises(UsageError, match=f"'{scheme.lower()}://' is not among the kinds of addresses"):
        Port(f"{scheme}:///dev/null?file={file}", 250000)
    assert file.read_text() == "kept"


@pytest.mark.parametrize("scheme", transport.SCHEMES)
def test_each_kind_of_address_is_documented(scheme: str) -> None:
    assert f"`serial:{scheme}://" in (ROOT / "host/docs/guide/sources.md").read_text("utf-8")


def test_a_port_that_dies_at_once_is_tried_ever_more_slowly(monkeypatch) -> None:
    waits: list[float] = []
    reader = Reader(Port("loop://", 250000))
    monkeypatch.setattr(type(serial.serial_for_url("loop://")), "read", _dead)

    def wait(timeout: float) -> None:
        waits.append(timeout)
        if len(waits) == 6:
            reader._stop.set()

    monkeypatch.setattr(reader._stop, "wait", wait)
    reader._run()
    assert waits == [*transport.BACKOFF_S, transport.BACKOFF_S[-1]]


def _dead(self: object, size: int = 1) -> bytes:
    raise OSError(errno.EIO, "gone")


def test_missing_ports_are_answered_with_those_that_exist(monkeypatch) -> None:
    class Port:
        device, description = "/dev/ttyACM7", "Arduino Due Prog. Port"

    monkeypatch.setattr(transport.list_ports, "comports", lambda: [Port()])
    text = explain_open_failure("/dev/ttyACM0", FileNotFoundError(errno.ENOENT, "none"))[1]
    assert "/dev/ttyACM7 (Arduino Due Prog. Port)" in text


@pytest.mark.parametrize("url", ["/dev/none", "loop://"])
def test_what_fails_while_a_failure_is_explained_ends_no_reading(url: str, monkeypatch, readers) -> None:
    """Explaining a failure reads this machine's groups and ports, which may fail as well."""
    monkeypatch.setattr(type(serial.serial_for_url("loop://")), "open", broken)
    monkeypatch.setattr(transport, "explain_open_failure", broken)
    events = readers(url).events(0.05)
    for _ in range(2):
        found = failure(events)
        assert (found.kind, f"cannot open {url}" in found.message) == ("open_failed", True)
