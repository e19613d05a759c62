"""Tests of many serial ports in one loop.

Whatever one port does, the other ports lose nothing, and all ports are read in every round of the loop.
"""

import contextlib
import fcntl
import os
import socket
import struct
import termios
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from pathlib import Path

import pytest
import serial
from fltea.records.clock import host_ns
from fltea.records.events import Failed, Opened, Reads, Tick
from fltea.wire import transport
from fltea.wire.ports import Ports
from fltea.wire.transport import Port
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.rig.host_support import PATIENCE_S, each_ended, wait_until
from tests.rig.terminal import Terminal, unplug

BAUD = 250_000


class Loop:
    """Reads ports as the daemon does, and stores the events of each port."""

    def __init__(self, urls: Sequence[str | Path], latency_s: float = 0.0) -> None:
        self.ports = Ports([Port(str(url), BAUD, latency_s) for url in urls])
        self.heard: list[list[Reads | Opened | Failed | Tick]] = [[] for _ in urls]

    def round(self, wait_s: float = 0.05) -> None:
        for place, event in self.ports.poll(wait_s):
            self.heard[place].append(event)

    def until(self, condition: Callable[[], bool], what: str) -> None:
        deadline_s = time.monotonic() + PATIENCE_S
        while not condition():
            assert time.monotonic() < deadline_s, f"waited in vain for {what}: {self.heard}"
            self.round()

    def data(self, place: int) -> bytes:
        return b"".join(event.data for event in self.heard[place] if isinstance(event, Reads))

    def kinds(self, place: int) -> list[str]:
        """Return what happened to one port, in order: "opened", or the kind of a failure."""
        events = (event for event in self.heard[place] if isinstance(event, Opened | Failed))
        return [event.kind if isinstance(event, Failed) else "opened" for event in events]

    def opened(self, *places: int) -> None:
        self.until(lambda: all("opened" in self.kinds(place) for place in places), f"{places} to be open")


@pytest.fixture
def terminals(tmp_path: Path) -> Iterator[Callable[[int], list[Terminal]]]:
    yield from each_ended(lambda count: [Terminal(tmp_path / f"port{k}") for k in range(count)], unplug)


@pytest.fixture
def loop_of() -> Iterator[Callable[[Sequence[str | Path]], Loop]]:
    yield from each_ended(Loop, lambda loop: loop.ports.close())


@pytest.fixture
def many(terminals, loop_of) -> tuple[list[Terminal], Loop]:
    """Return ten terminals, and a loop that has opened them as ports."""
    found = terminals(10)
    loop = loop_of([one.link for one in found])
    loop.opened(*range(10))
    return found, loop


@settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(st.tuples(st.integers(0, 9), st.binary(min_size=1, max_size=300) | st.none()), max_size=30))
def test_what_comes_from_a_port_is_its_own_in_any_order_of_sending_and_reading(
    many: tuple[list[Terminal], Loop], story: list[tuple[int, bytes | None]]
) -> None:
    """`story`: list of what happens, in order. An item is a port with the bytes that it receives, or with
    None, which means a round of the loop. All examples use the same ports.
    """
    terminals, loop = many
    sent = [loop.data(place) for place in range(10)]
    for place, data in story:
        if data is None:
            loop.round(0.001)
        else:
            terminals[place].send(data)
            sent[place] += data
    loop.until(lambda: [loop.data(place) for place in range(10)] == sent, "all that was sent")
    assert all(loop.kinds(place) == ["opened"] for place in range(10))


def test_one_that_hangs_while_it_is_opened_holds_up_nobody(monkeypatch, terminals, loop_of) -> None:
    many, go = terminals(3), threading.Event()
    opening = Port.open

    def slow(port: Port) -> Opened | Failed:
        if port.url == str(many[1].link):
            assert go.wait(PATIENCE_S)
        return opening(port)

    monkeypatch.setattr(Port, "open", slow)
    loop = loop_of([one.link for one in many])
    loop.opened(0, 2)
    for k in range(20):
        for place in (0, 2):
            many[place].send(b"x")
        for _ in range(2):
            loop.round()
        assert len(loop.data(0)) == len(loop.data(2)) == k + 1, "at the latest in the second round"
    assert loop.kinds(1) == []
    loop.until(lambda: bool(loop.heard[1]), "word that nothing came from it")
    assert {type(event) for event in loop.heard[1]} == {Tick}
    go.set()
    loop.opened(1)
    many[1].send(b"late")
    loop.until(lambda: loop.data(1) == b"late", "the late one's data")


def test_one_that_dies_and_comes_back_costs_the_others_nothing(monkeypatch, terminals, loop_of) -> None:
    monkeypatch.setattr(transport, "BACKOFF_S", (0.05,))
    many = terminals(3)
    loop = loop_of([one.link for one in many])
    loop.opened(0, 1, 2)
    sent = b""
    for k in range(3):
        many[1].unplug()
        loop.until(lambda k=k: loop.kinds(1).count("unplugged") == k + 1, "the loss")
        loop.until(lambda: loop.kinds(1)[-1] == "no_port", "a try in vain")
        many[1].plug()
        while loop.kinds(1)[-1] != "opened":
            text = b"%d" % len(sent)
            sent += text
            for place in (0, 2):
                many[place].send(text)
            loop.round()
        many[1].send(b"back")
        loop.until(lambda k=k: loop.data(1) == b"back" * (k + 1), "its data")
    loop.until(lambda: loop.data(0) == loop.data(2) == sent, "all that was sent")
    assert loop.kinds(0) == loop.kinds(2) == ["opened"]


def test_one_that_floods_loses_nothing_and_holds_up_nobody(terminals, loop_of) -> None:
    many = terminals(3)
    loop = loop_of([one.link for one in many])
    loop.opened(0, 1, 2)
    flood = 0
    for k in range(300):
        with contextlib.suppress(BlockingIOError):
            # before every round, this loop writes until the buffer of the terminal is full
            for _ in range(100):
                flood += os.write(many[1].master, bytes(1000))
        many[k % 2 * 2].send(b"x")
        # Bytes written to a terminal may arrive a moment later. Until the "x" arrives, at most eight reads of
        # the flooded port are allowed. Reading everything in its full buffer would take 16 reads.
        floods = 0
        while len(loop.data(0)) + len(loop.data(2)) <= k:
            before = len(loop.heard[1])
            loop.round()
            floods += len(loop.heard[1]) - before
            assert floods <= 8
    loop.until(lambda: len(loop.data(1)) == flood, "the rest of the flood")
    assert flood > 100_000


def test_reads_wait_for_each_other_and_keep_their_own_times(monkeypatch) -> None:
    """A pipe replaces the port, since bytes that are written to a pipe can be read at once."""
    near, far = os.pipe()
    os.set_blocking(near, False)
    monkeypatch.setattr(Port, "fileno", lambda port: near)
    monkeypatch.setattr(Port, "open", lambda port: Opened(host_ns(), 0))
    loop = Loop(["/dev/none"], latency_s=3600)
    loop.opened(0)
    before_ns = host_ns()
    for text in (b"one", b"and two"):
        os.write(far, text)
        wait_until(lambda: not waiting(near), "it to be read")
    loop.until(lambda: loop.data(0) == b"oneand two", "both")
    loop.ports.close()
    reads = [event for event in loop.heard[0] if isinstance(event, Reads)]
    assert [chunk.data for one in reads for chunk in one.chunks()] == [b"one", b"and two"]
    first_ns, second_ns = (chunk.host_ns for one in reads for chunk in one.chunks())
    assert before_ns < first_ns < second_ns < host_ns()
    os.close(near)
    os.close(far)


def waiting(descriptor: int) -> int:
    """Return the number of bytes that wait to be read from a descriptor."""
    (found,) = struct.unpack("i", fcntl.ioctl(descriptor, termios.FIONREAD, bytes(4)))
    return int(found)


def test_a_socket_whose_connection_hangs(monkeypatch, terminals, loop_of) -> None:
    many, go = terminals(2), threading.Event()

    def hang(*arguments: object, **more: object) -> socket.socket:
        assert go.wait(PATIENCE_S)
        raise TimeoutError("timed out")

    monkeypatch.setattr(socket, "create_connection", hang)
    loop = loop_of([many[0].link, "socket://192.0.2.1:7000", many[1].link])
    loop.opened(0, 2)
    many[0].send(b"first")
    many[1].send(b"second")
    loop.until(lambda: (loop.data(0), loop.data(2)) == (b"first", b"second"), "the others")
    assert loop.kinds(1) == []
    go.set()
    loop.until(lambda: loop.kinds(1) == ["no_port"], "word that nobody answers")
    failed = next(event for event in loop.heard[1] if isinstance(event, Failed))
    assert "cannot connect to socket://192.0.2.1:7000" in failed.message


def test_sockets_and_their_loss(loop_of) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        url = f"socket://127.0.0.1:{server.getsockname()[1]}"
        loop = loop_of([url, url])
        loop.opened(0, 1)
        peers = [server.accept()[0] for _ in range(2)]
        for k, peer in enumerate(peers):
            peer.sendall(b"%d" % k * 1000)
        loop.until(lambda: len(loop.data(0)) == len(loop.data(1)) == 1000, "both")
        assert {loop.data(0)[:1], loop.data(1)[:1]} == {b"0", b"1"}
        dead = int(loop.data(1)[:1] == b"0")  # index of the port that is connected to peers[0]
        peers[0].sendall(b"last words")
        peers[0].close()
        loop.until(lambda: loop.kinds(dead)[-1] == "unplugged", "the loss")
        assert loop.data(dead).endswith(b"last words"), "what was sent before the loss is read before it"
        peers[1].sendall(b"more")
        loop.until(lambda: loop.data(1 - dead).endswith(b"more"), "the other one")
        loop.until(lambda: loop.kinds(dead) == ["opened", "unplugged", "opened"], "it to come back")
        again, _ = server.accept()
        again.close()
        peers[1].close()


def test_ports_that_fail_are_tried_ever_more_slowly(monkeypatch, loop_of) -> None:
    now_ns = [10**11]
    for module in ("ports", "openings"):
        monkeypatch.setattr(f"fltea.wire.{module}.host_ns", lambda: now_ns[0])
    tried: list[int] = []
    monkeypatch.setattr(Port, "open", lambda port: tried.append(now_ns[0]) or Failed("no_port", "none", 0))
    loop = loop_of(["/dev/none"])
    for k in range(7):
        while len(loop.kinds(0)) == k:
            loop.round(0.001)
            now_ns[0] += 50_000_000
    waits = [after - before for before, after in pairwise(tried)]
    for wait, least_s in zip(waits, [*transport.BACKOFF_S, transport.BACKOFF_S[-1]], strict=True):
        assert wait >= least_s * 1e9


def test_closing_frees_every_port_also_one_that_was_just_opened(monkeypatch, terminals) -> None:
    many, go, released = terminals(3), threading.Event(), threading.Event()
    opening, closing = Port.open, Port.close

    def slow(port: Port) -> Opened | Failed:
        if port.url == str(many[2].link):
            assert go.wait(PATIENCE_S)
        return opening(port)

    def close(port: Port) -> None:
        closing(port)
        if go.is_set() and port.url == str(many[2].link):
            released.set()

    monkeypatch.setattr(Port, "open", slow)
    monkeypatch.setattr(Port, "close", close)
    loop = Loop([one.link for one in many])
    loop.ports._openings.begin(0)
    opened = loop.ports._openings._opened
    wait_until(lambda: opened.qsize() == 2, "ports that the loop does not know to be open")
    loop.ports.close()
    loop.ports.wake()  # a call of `wake` after `close` does no harm
    go.set()
    assert released.wait(PATIENCE_S)
    for one in many:
        with serial.Serial(str(one.link), exclusive=True):
            pass
