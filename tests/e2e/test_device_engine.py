"""Tests of a simulated device that computes estimates, and of the real command, connected by a
pseudo-terminal.
"""

import os
import select
import termios
from pathlib import Path

import pytest
from fltea.wire import layout as wire
from fltea.wire.messages import Frame

from tests.rig.host_support import Processes, wait_until
from tests.rig.plain_decoder import decoded


def test_the_stand_in_begins_again_for_a_program_that_empties_the_port_late(
    processes: Processes, tmp_path: Path
) -> None:
    """When pyserial opens a port, it discards the bytes that the port has already received. On a busy
    machine, it does so late. The first bytes of the simulated device are then lost.

    So the simulated device boots again, with a new HELLO, if a program discards the received bytes.
    """
    link = tmp_path / "device"
    processes.stand_in(link)
    port = os.open(link, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    heard = b""

    def boots() -> set[int]:
        nonlocal heard
        heard += os.read(port, 4096) if has_input(port) else b""
        return {message.boot_id for message in messages(heard) if isinstance(message, wire.Hello)}

    try:
        wait_until(lambda: len(boots()) == 1, "the first beginning")
        termios.tcflush(port, termios.TCIFLUSH)
        wait_until(lambda: len(boots()) == 2, "the second beginning")
    finally:
        os.close(port)


def messages(heard: bytes) -> list[wire.Message]:
    return [one.item.message for one in decoded(heard) if isinstance(one.item, Frame)]


def has_input(port: int) -> bool:
    return bool(select.select([port], [], [], 0)[0])


def test_both_stand_side_by_side(processes: Processes, tmp_path: Path) -> None:
    """The board's estimates are published next to the host's estimates of the same samples.

    The rate is 200 Hz. At this rate, the start-up window of 500 samples takes only 2.5 s, and even a busy
    machine reads the port in time.
    """
    port = tmp_path / "device"
    processes.stand_in(port, "--estimate", "--noise", "rate_hz=200")
    daemon = processes.daemon("--source", f"serial:{port}", "--estimate-on", "both")
    daemon.wait_for(lambda: len(daemon.of("device_estimate")) > 20, "estimates of the device")
    code, stderr = daemon.end()
    assert (code, stderr) == (0, "")
    compared = daemon.of("device_estimate")
    assert all(record["comparable"] for record in compared)
    differences = [abs(axis["alpha_difference"]) for one in compared for axis in one["axes"].values()]
    assert 0 < max(differences) < 1e-6
    assert {record["seq"] for record in compared} <= {record["seq"] for record in daemon.of("estimate")}


@pytest.mark.slow
def test_with_once_a_device_that_does_not_estimate_is_a_failure(processes: Processes, tmp_path: Path) -> None:
    port = tmp_path / "device"
    processes.stand_in(port)
    daemon = processes.daemon("--source", f"serial:{port}", "--estimate-on", "device", "--once")
    code, stderr = daemon.end(None)
    assert code == 1
    assert stderr.startswith("fltea: error: the device sends samples, but in 5 s no estimates of its own")
    assert stderr.count("\n") == 1
    assert daemon.errors() == ["no_device_estimates"]
    assert not daemon.of("estimate")
