"""Tests with as many devices as the limit of file descriptors permits: all devices are read and recorded.

With more devices, the program refuses to start.
"""

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from fltea.recording.part_reader import read_entries
from fltea.recording.session import WIRE
from fltea.service.descriptors import RESERVE
from fltea.sources.mcap import find_sessions
from fltea.wire import layout as wire
from fltea.wire.messages import encode

from tests.rig.host_support import WIRE_HELLO, each_ended
from tests.rig.terminal import Terminal, unplug
from tools.faults.program import Program

DEVICES = 40
OPEN_AT_START = 8
"""Largest number of descriptors that are open at the start: standard input, output and error, and those of
the interpreter.
"""

LIMIT = RESERVE + OPEN_AT_START + 2 * DEVICES
"""Limit of file descriptors, which has room for two for each device. If a serial port needed five
descriptors, as with pyserial, only eighteen devices would fit.
"""

HELLO = b"\0" + encode(WIRE_HELLO, 0, 0)
SAMPLES = b"".join(encode(wire.Sample(k, -k, 0, 0, 0, 16384, 0, 0), k, k * 10_000) for k in range(5))


@pytest.fixture
def terminals(tmp_path: Path) -> Iterator[list[Terminal]]:
    made = [Terminal(tmp_path / f"d{k}") for k in range(DEVICES)]
    yield made
    unplug(made)


@pytest.fixture
def limited(terminals: list[Terminal], tmp_path: Path) -> Iterator[Callable[[int], Program]]:
    """Yield a function that starts the daemon on all devices, with a given limit of file descriptors."""
    urls = [part for one in terminals for part in ("--source", f"serial:{one.link}")]

    def start(descriptors: int) -> Program:
        prlimit = ("prlimit", f"--nofile={descriptors}:{descriptors}")
        return Program(["run", *urls, "--samples", "--record", tmp_path / "recording"], before=prlimit)

    yield from each_ended(start, Program.kill)


def test_all_devices_are_read_and_recorded_with_two_descriptors_each(
    limited: Callable[[int], Program], terminals: list[Terminal], tmp_path: Path
) -> None:
    program = limited(LIMIT)
    begun: set[str] = set()

    def all_heard() -> bool:
        for one in terminals:  # Bytes that are sent to a port before the daemon has opened it are discarded.
            if one.link.name not in begun:
                one.send(HELLO)
        for name in {record["device"] for record in program.of("hello")} - begun:
            begun.add(name)
            terminals[int(name.removeprefix("d"))].send(SAMPLES)
        return len(program.of("sample")) == DEVICES * 5

    program.wait_for(all_heard, "all samples")
    assert program.end() == (0, "")
    sessions, _ = find_sessions([tmp_path / "recording"])
    assert len(sessions) == DEVICES
    for session in sessions:
        (part,) = session.parts
        entries = list(read_entries(part))
        assert SAMPLES in b"".join(entry.data for entry in entries if entry.topic == WIRE)


def test_devices_for_which_there_are_none_are_refused_before_anything_begins(
    limited: Callable[[int], Program], tmp_path: Path
) -> None:
    code, errors = limited(RESERVE + 2 * 20).end(None)
    assert code == 2
    assert "40 devices need" in errors
    assert "which is enough for" in errors
    assert "'ulimit -n" in errors
    assert "LimitNOFILE=" in errors
    assert not (tmp_path / "recording").exists()
