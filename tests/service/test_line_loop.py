"""The loop that walks all devices on ports: each takes what is its own, and ends for itself."""

import os
import pty
import threading
import tty
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any

import pytest
from blocks import of, samples_of
from fltea.records import clock
from fltea.records.events import Event, RawBlock, Tick, Trouble
from fltea.records.records import Hello
from fltea.service.bell import Bell
from fltea.service.lines import LineLoop, has_line
from fltea.service.open_source import open_source
from fltea.service.pressure import Pressure
from fltea.settings.config import load_config
from fltea.sources.serial import SerialSource
from fltea.stream.beside import Beside
from fltea.wire import layout as wire
from fltea.wire.messages import encode
from host_support import PATIENCE_S, WIRE_HELLO, each_ended, wait_until


class Line:
    """A device on a pseudo-terminal, and its walk as far as the loop knows it.

    raises: what `take` does with a sample. fails: the walk fails with its first trouble, as under `--once`.
    """

    def __init__(self) -> None:
        self.master, slave = pty.openpty()
        tty.setraw(slave)
        self.source = SerialSource(os.ttyname(slave), 250_000)
        os.close(slave)
        self.name = self.source.url
        self.failure: Trouble | None = None
        self.raises: Exception | None = None
        self.fails = False
        self.finished = 0
        self.finish_raises: Exception | None = None
        self.on_finish: Callable[[], None] = lambda: None
        self.events: list[Event] = []
        self._sent = 0

    def send(self, count: int) -> None:
        if not self._sent:
            os.write(self.master, b"\0" + encode(WIRE_HELLO, 0, 0))
        for k in range(self._sent, self._sent + count):
            os.write(self.master, encode(wire.Sample(k, -k, 0, 0, 0, 16384, 0, 0), k, k * 10_000))
        self._sent += count

    def take(self, event: Event, *, tell: bool) -> None:
        self.events.append(event)
        if self.raises is not None and isinstance(event, RawBlock):
            raise self.raises
        if self.fails and isinstance(event, Trouble):
            self.failure = event

    def finish(self) -> None:
        self.finished += 1
        self.on_finish()
        if self.finish_raises is not None:
            raise self.finish_raises

    @property
    def heard(self) -> list[int]:
        """Numbers of the samples that it took."""
        return [raw.sequence for raw in samples_of(self.events)]


class FakePressure(Pressure):
    """Keeps what it is told."""

    def __init__(self) -> None:
        super().__init__(Beside(), lambda kind, message: None)
        self.waited_ns: list[int] = []
        self.looks = 0

    def waited(self, ns: int) -> None:
        self.waited_ns.append(ns)

    def look(self, now_ns: int) -> None:
        self.looks += 1


class Running:
    """The loop in its thread."""

    def __init__(self, *lines: Line) -> None:
        self.ended: list[tuple[Any, Exception | None]] = []
        self.pressure = FakePressure()
        self.bell = Bell()
        self.loop = LineLoop(
            lines,  # type: ignore[arg-type]
            lambda walk, error: self.ended.append((walk, error)),
            lambda: [self.bell],
            self.pressure,
        )
        self.fault: Exception | None = None
        self.thread = threading.Thread(target=self._run)

    def start(self) -> "Running":
        self.thread.start()
        return self

    def _run(self) -> None:
        try:
            self.loop.run()
        except Exception as error:
            self.fault = error

    def join(self) -> None:
        self.thread.join(PATIENCE_S)
        assert not self.thread.is_alive()

    def end(self) -> None:
        if self.thread.is_alive():
            self.loop.close()
        self.join()


@pytest.fixture
def lines() -> Iterator[Callable[[int], list[Line]]]:
    yield from each_ended(
        lambda count: [Line() for _ in range(count)], lambda made: [os.close(line.master) for line in made]
    )


@pytest.fixture
def running() -> Iterator[Callable[..., Running]]:
    def start(*lines: Line) -> Running:
        one = Running(*lines).start()
        for line in lines:
            wait_until(lambda line=line: line.source._wire._connected, "all to be open")
        return one

    yield from each_ended(start, Running.end)


def test_each_walk_takes_what_its_own_device_says(lines, running) -> None:
    many = lines(12)
    one = running(*many)
    for part in range(1, 4):
        for k, line in enumerate(many):
            line.send(k + part)
    total = [3 * k + 6 for k in range(12)]
    wait_until(lambda: [len(line.heard) for line in many] == total, "all samples")
    one.end()
    for line, count in zip(many, total, strict=True):
        assert line.heard == list(range(count))
        assert isinstance(line.events[0], Hello)
        assert line.finished == 1
    assert sorted(map(id, many)) == sorted(id(walk) for walk, _ in one.ended)
    assert [error for _, error in one.ended] == [None] * 12


def test_a_walk_that_raises_ends_alone(lines, running) -> None:
    left, broken, right = lines(3)
    broken.raises = ZeroDivisionError("its fault")
    one = running(left, broken, right)
    for line in (broken, left, right):
        line.send(5)
    wait_until(lambda: len(left.heard) == len(right.heard) == 5, "the others")
    wait_until(lambda: bool(one.ended), "its end")
    for line in (broken, left, right):
        line.send(5)
    wait_until(lambda: len(left.heard) == len(right.heard) == 10, "the others, who go on")
    assert one.ended == [(broken, broken.raises)]
    assert broken.finished == 0
    assert len(of(RawBlock, broken.events)) == 1, "it takes no more"
    assert one.thread.is_alive()


def test_a_walk_that_fails_is_finished_and_the_loop_ends_with_the_last(lines, running) -> None:
    first, second = lines(2)
    first.fails = second.fails = True
    second.finish_raises = OSError(28, "No space left")
    one = running(first, second)
    fault = encode(wire.Fault(wire.FaultCode.SENSOR_MISSING, 0), 0, 0)
    for line in (first, second):
        line.send(2)
        wait_until(lambda line=line: len(line.heard) == 2, "samples")
        os.write(line.master, fault)
        wait_until(lambda line=line: any(walk is line for walk, _ in one.ended), "its end")
        assert line.finished == 1
    one.join()
    assert one.ended == [(first, None), (second, second.finish_raises)]


def test_outputs_are_told_before_the_loop_waits_and_when_it_ends(lines, running) -> None:
    (line,) = lines(1)
    one = running(line)
    one.bell.clear()
    line.send(3)
    assert one.bell.wait(PATIENCE_S)
    wait_until(lambda: len(line.heard) == 3, "all samples")
    line.on_finish = one.bell.clear
    one.loop.close()
    one.join()
    assert one.bell.wait(0), "of what a walk publishes when it is finished"


def test_who_has_nothing_to_say_is_told_that_time_passes(lines, running) -> None:
    talks, is_silent = lines(2)
    running(talks, is_silent)
    talks.send(3)
    wait_until(lambda: len(of(Tick, is_silent.events)) >= 2, "ticks")
    assert talks.heard == [0, 1, 2]


def test_how_long_samples_waited_beyond_the_latency_is_known(monkeypatch, lines, running) -> None:
    (line,) = lines(1)
    line.source.port.latency_s = 2.0
    late = SimpleNamespace(host_ns=lambda: clock.host_ns() + 10**10)
    monkeypatch.setattr("fltea.service.lines.clock", late)
    one = running(line)
    line.send(3)
    wait_until(lambda: len(line.heard) == 3 and one.pressure.looks > 0, "samples and a look")
    assert all(ns >= 8 * 10**9 for ns in one.pressure.waited_ns)
    assert one.pressure.waited_ns


def test_a_fault_of_the_loop_itself_ends_every_walk(monkeypatch, lines) -> None:
    """Else a daemon that hears nothing any more would look alive."""
    many = lines(2)
    one = Running(*many)

    def broken(timeout_s: float, bells: list[Bell]) -> None:
        raise OSError(9, "Bad file descriptor")

    monkeypatch.setattr(one.loop._ports, "poll", broken)
    one.start().join()
    assert [walk for walk, _ in one.ended] == many
    assert {error for _, error in one.ended} == {one.fault}
    assert isinstance(one.fault, OSError)


@pytest.mark.parametrize(
    ("url", "expected"),
    [
        ("serial:/dev/ttyACM0", True),
        ("serial:socket://localhost:7777", True),
        ("hwgrep://2341:003d", True),
        ("loop://", False),
        ("rfc2217://localhost:7777", False),
        ("synthetic:", False),
    ],
)
def test_which_sources_have_a_line(url: str, expected: bool) -> None:
    class Of:
        source = open_source(load_config(None, {"source": url}))

    assert has_line(Of()) is expected  # type: ignore[arg-type]
