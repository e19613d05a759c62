"""Tests of the loop over all serial ports.

Each device stream gets the samples of its own device, and ends independently of the others.
"""

import os
import pty
import threading
import tty
from collections.abc import Callable, Iterator
from typing import Any

import msgspec
import pytest
from fltea.records import clock
from fltea.records.block import Block
from fltea.records.events import Event, Ints, Trouble
from fltea.records.records import Error, Hello, Stats
from fltea.service.device_stream import DeviceStream
from fltea.service.hub import Hub
from fltea.service.port_loop import HANDLERS, PortLoop, PortStop, has_port
from fltea.service.pressure import Pressure
from fltea.settings.config import load_config
from fltea.sources.open_source import open_source
from fltea.sources.serial import SerialSource
from fltea.stream.decode import Rows
from fltea.stream.fit_worker import FitWorker
from fltea.wire import layout as wire
from fltea.wire.messages import encode

from tests.rig.blocks import of
from tests.rig.host_support import PATIENCE_S, WIRE_HELLO, each_ended, wait_until
from tests.rig.memory_sink import Memory


class Watched(DeviceStream):
    """A device stream that reports all events that it receives to its `Line`, the test's device."""

    line: "Line"

    def take(self, event: Event) -> None:
        super().take(event)
        self.line.on_event(event)

    def took(self, arrived_ns: Ints, rows: Rows, *, unprinted: bool) -> None:
        self.line.arrived_ns += arrived_ns.tolist()
        self.line.on_samples(rows)
        super().took(arrived_ns, rows, unprinted=unprinted)

    def finish(self, *, whole: bool = False, now_ns: int = 0) -> None:
        self.line.finished += 1
        super().finish(whole=whole, now_ns=now_ns)
        if self.line.finish_raises is not None:
            raise self.line.finish_raises


class Line:
    """A device on a pseudo-terminal, and its device stream.

    `raises`: an exception that the stream raises at the first samples. `fails`: whether the stream fails at
    the first error of its device (event `Trouble`), as with `--once`.
    """

    def __init__(self, number: int, hub: Hub) -> None:
        self.master, slave = pty.openpty()
        tty.setraw(slave)
        self.source = SerialSource(os.ttyname(slave), 250_000)
        os.close(slave)
        config = load_config(None, {"source": f"serial:{self.source.url}"})
        self.stream = Watched(self.source, msgspec.structs.replace(config, name=f"board{number}"), hub, None)
        self.stream.line = self
        self.raises: Exception | None = None
        self.fails = False
        self.finished = 0
        self.finish_raises: Exception | None = None
        self.events: list[Event] = []
        self.heard: list[int] = []
        self.arrived_ns: list[int] = []
        self.on_hello: Callable[[], None] = lambda: None
        self._sent = 0

    def on_event(self, event: Event) -> None:
        self.events.append(event)
        if isinstance(event, Hello):
            self.on_hello()
        if self.fails and isinstance(event, Trouble):
            self.stream.failure = event

    def on_samples(self, rows: Rows) -> None:
        if self.raises is not None:
            raise self.raises
        self.heard += rows[1][0].tolist()

    def send(self, count: int) -> None:
        if not self._sent:
            os.write(self.master, b"\0" + encode(WIRE_HELLO, 0, 0))
        for k in range(self._sent, self._sent + count):
            os.write(self.master, encode(wire.Sample(k, -k, 0, 0, 0, 16384, 0, 0), k, k * 10_000))
        self._sent += count


class FakePressure(Pressure):
    """A `Pressure` (which reports too much load) that records the calls that it receives."""

    def __init__(self) -> None:
        super().__init__(FitWorker(), lambda kind, message: None)
        self.waited_ns: list[int] = []
        self.looks = 0

    def waited(self, ns: int) -> None:
        self.waited_ns.append(ns)

    def check(self, now_ns: int) -> None:
        self.looks += 1


class Running:
    """The port loop, running in its thread."""

    def __init__(self, hub: Hub, *lines: Line) -> None:
        self.ended: list[tuple[Any, Exception | None]] = []
        self.pressure = FakePressure()
        self.loop = PortLoop(
            [line.stream for line in lines],
            lambda stream, error: self.ended.append((stream, error)),
            hub,
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
def page() -> Memory:
    return Memory("page")


@pytest.fixture
def hub(page: Memory) -> Iterator[Hub]:
    one = Hub(lambda error: None)
    one.add(page)
    yield one
    for each in one.close():
        assert each.done(PATIENCE_S)


@pytest.fixture
def lines(hub: Hub) -> Iterator[Callable[[int], list[Line]]]:
    yield from each_ended(
        lambda count: [Line(k, hub) for k in range(count)],
        lambda made: [os.close(line.master) for line in made],
    )


@pytest.fixture
def running(hub: Hub) -> Iterator[Callable[..., Running]]:
    def start(*lines: Line) -> Running:
        one = Running(hub, *lines).start()
        for line in lines:
            wait_until(lambda line=line: line.source.decoder.counts()[3] == 1, "all to be open")
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
    assert sorted(id(line.stream) for line in many) == sorted(id(stream) for stream, _ in one.ended)
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
    assert one.ended == [(broken.stream, broken.raises)]
    assert broken.finished == 0
    assert not broken.heard
    assert one.thread.is_alive()


def test_a_device_whose_samples_cannot_be_taken_ends_alone(lines, running) -> None:
    left, broken = lines(2)
    decoder = broken.stream._pipeline._decoder
    begin = decoder.begin
    decoder.begin = lambda sensors: begin([(one[0], [7, 7, 7], *one[2:]) for one in sensors])
    one = running(left, broken)
    for line in (broken, left):
        line.send(5)
    wait_until(lambda: bool(one.ended), "its end")
    left.send(5)
    wait_until(lambda: len(left.heard) == 10, "the other, which goes on")
    ((stream, error),) = one.ended
    assert stream is broken.stream
    assert isinstance(error, ValueError)
    assert "as many axes as their epoch began with" in str(error)


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
        wait_until(lambda line=line: any(stream is line.stream for stream, _ in one.ended), "its end")
        assert line.finished == 1
    one.join()
    assert one.ended == [(first.stream, None), (second.stream, second.finish_raises)]


def test_at_the_end_nothing_waits_for_more(hub, lines, monkeypatch, running) -> None:
    """With many devices, samples wait for further ones, so that larger blocks are processed together.

    At the end of the program, the waiting samples are processed at once. In this test, they would
    otherwise wait for PATIENCE_NS = 1,000 s, which is longer than the test lasts.
    """
    monkeypatch.setattr("fltea.service.port_loop.PATIENCE_NS", 10**12)
    monkeypatch.setattr("fltea.service.port_loop.DEVICES_A_SECOND", 0)
    (line,) = lines(1)
    one = running(line)
    line.send(40)
    wait_until(lambda: line.source.decoder.counts()[1] == 41, "all frames")
    assert not line.heard
    one.end()
    assert line.heard == list(range(40))
    assert line.finished == 1


@pytest.mark.slow
def test_who_has_nothing_to_say_is_told_that_time_passes(page, lines, running) -> None:
    talks, is_silent = lines(2)
    running(talks, is_silent)
    talks.send(3)
    name = is_silent.stream.name
    wait_until(lambda: sum(one.device == name for one in of(Stats, page.items)) >= 2, "its statistics")
    assert talks.heard == [0, 1, 2]


def test_nothing_overtakes_samples_that_wait_for_more(page, lines, running) -> None:
    """With many devices, samples wait for further ones, so outputs that take blocks get them a little later.
    Events that occur after the samples still come after them.
    """
    many = lines(40)
    first = many[0]
    running(*many)
    first.send(1)
    wait_until(lambda: first.heard == [0], "a sample")
    first.send(30)
    os.write(first.master, encode(wire.Fault(wire.FaultCode.SENSOR_MISSING, 0), 0, 0))
    first.send(30)
    name = first.stream.name
    wait_until(
        lambda: len(first.heard) == 61 and any(one.device == name for one in of(Error, page.items)), "all"
    )
    mine = [one for one in page.items if isinstance(one, Block | Error) and one.device == name]
    place = next(k for k, one in enumerate(mine) if isinstance(one, Error))
    assert [seq for one in of(Block, mine[:place]) for seq in one.seq] == list(range(31))


def test_how_long_samples_waited_is_known(lines, running) -> None:
    (line,) = lines(1)
    sent, times_ns = threading.Event(), list[int]()

    def hold() -> None:
        assert sent.wait(PATIENCE_S)
        times_ns.append(clock.host_ns())

    line.on_hello = hold
    one = running(line)
    line.send(1)
    wait_until(lambda: any(isinstance(event, Hello) for event in line.events), "a HELLO")
    line.send(2)
    begin_ns = clock.host_ns()
    wait_until(lambda: clock.host_ns() - begin_ns > 50_000_000, "the samples to be late")
    sent.set()
    wait_until(lambda: len(line.heard) == 3 and max(one.pressure.waited_ns, default=0) > 0, "a look")
    assert max(one.pressure.waited_ns) >= times_ns[0] - line.arrived_ns[1] > 0


def test_a_fault_of_the_loop_itself_ends_every_walk(monkeypatch, hub, lines) -> None:
    """A fault of the port loop itself ends all device streams. Otherwise the daemon would seem to work
    although it receives nothing any more.
    """
    many = lines(2)
    one = Running(hub, *many)

    def broken(now_ns: int) -> None:
        raise OSError(9, "Bad file descriptor")

    monkeypatch.setattr(one.loop._openings, "begin", broken)
    one.start().join()
    assert [stream for stream, _ in one.ended] == [line.stream for line in many]
    assert {error for _, error in one.ended} == {one.fault}
    assert isinstance(one.fault, OSError)


def test_each_thing_that_may_happen_has_a_handler() -> None:
    assert set(HANDLERS) == set(PortStop)


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

    assert has_port(Of()) is expected  # type: ignore[arg-type]
