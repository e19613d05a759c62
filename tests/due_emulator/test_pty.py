"""Tests of the emulated board's serial port as a pseudo-terminal.

Opening the port resets the board. At a wrong baud rate the bytes are garbage, and 1200 baud erases the flash.
A warning is printed if the emulation is too slow.
"""

import json
import signal
import subprocess
import sys
import time
from itertools import pairwise

import pytest
import serial

from tests.rig.machine_support import FOLDER, Bench, program
from tools.due_emulator.pty_front import AGAIN_S, Front, Pace

ROOT = FOLDER.parents[1]
TIMEOUT_S = 60
"""Longest time to wait for a process that hangs [s]. No assertion depends on it."""

NOTICED_S = 1.0
"""Time in which the emulator certainly notices that the port was closed [s]. The emulator polls the port
every few milliseconds. If the port was closed and opened between two polls, it notices nothing.
"""

COUNT_UP = """
  full_speed
  store 0x400E1A54, 0x8000
  uart_on 21
  systick 41999, 7
  movs r4, #0
3: wfi
  wait 0x400E0814, 0x2
  ldr r0, =0x400E081C
  str r4, [r0]
  adds r4, #1
  uxtb r4, r4
  b 3b
tick:
  bx lr
"""
"""Program that sends 0, 1, 2 and so on, 2,000 bytes a second. It sleeps in between, so that the emulator
keeps up with real time.
"""


@pytest.fixture
def emulator(tmp_path):
    """Run the emulator with the program that sends rising numbers; return the process and the port."""
    image, link = tmp_path / "count.bin", tmp_path / "port"
    image.write_bytes(program(COUNT_UP, {15: "tick"}))
    options = ["--pty", "--json", "--link", link, "--image", image]
    command = [sys.executable, "-m", "tools.due_emulator", *options]
    process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    line = process.stdout.readline()
    assert line.startswith(f"{link}: count.bin"), line + (process.stderr.read() if process.poll() else "")
    yield process, link
    if process.poll() is None:
        process.kill()
        process.wait()
    for stream in (process.stdout, process.stderr):
        stream.close()


def end(process, number):
    process.send_signal(number)
    out, err = process.communicate(timeout=TIMEOUT_S)
    return process.returncode, out, err


@pytest.mark.slow
def test_opening_resets_the_board_each_time_and_a_signal_ends_it_cleanly(emulator):
    process, link = emulator
    # A terminal keeps its settings after it is closed. Before the first settings are made, bytes are lost.
    with serial.Serial(str(link), 250_000) as port:
        assert port.read(1)
    for _ in range(2):
        time.sleep(NOTICED_S)
        data = b""
        with open(link, "rb", buffering=0) as port:
            while len(data) < 300:
                data += port.read(300 - len(data))
        assert data == bytes(n % 256 for n in range(300))
    time.sleep(NOTICED_S)
    code, out, err = end(process, signal.SIGINT)
    assert (code, err) == (0, "")
    assert "opened 3 time(s)" in out
    assert not link.is_symlink()


def test_sigterm_ends_it_too(emulator):
    process, link = emulator
    assert end(process, signal.SIGTERM)[0] == 0
    assert not link.is_symlink()


def test_the_wrong_baud_rate_gives_garbage(emulator):
    process, link = emulator
    with serial.Serial(str(link), 115_200) as port:
        data = port.read(300)
    expected = bytes(n % 256 for n in range(300))
    assert sum(a == b for a, b in zip(data, expected, strict=True)) < 30
    assert end(process, signal.SIGINT)[0] == 0


def test_1200_baud_erases_the_flash(emulator):
    process, link = emulator
    with serial.Serial(str(link), 1200):
        assert "1200 baud" in process.stderr.readline()
    code, out, err = end(process, signal.SIGINT)
    assert (code, err) == (0, ""), "told once"
    assert json.loads(out)["bytes"] == 0


class FakePort:
    """A fake port that seems to be open for the first `looks` polls."""

    def __init__(self, baud, looks):
        self.baud = baud
        self.looks = looks

    @property
    def is_open(self):
        self.looks -= 1
        return self.looks >= 0

    def flush(self):
        return True


def test_a_board_whose_flash_was_erased_does_not_run(capsys):
    board = Bench(program(COUNT_UP, {15: "tick"})).board
    Front(board, FakePort(250_000, 10))._run()
    assert board.now_s > 0.01, "it runs until then"
    before_s = board.now_s
    Front(board, FakePort(1200, 10))._run()
    assert board.now_s == before_s
    assert board.memory.is_blank
    assert set(board.memory.flash[:]) == {0xFF}
    assert capsys.readouterr().err.count("1200 baud") == 1


def told_of(speed, for_s, step_s=0.02):
    """Return times and texts of the emulator's warnings, for a board that is emulated at a given speed.

    `speed(real_s)`: ratio of emulated time to real time, as a function of real time [s].
    """
    pace, real_s, board_s, found = Pace(), 0.0, 0.0, []
    while real_s < for_s:
        real_s += step_s
        board_s += step_s * speed(real_s)
        if (words := pace.check(real_s, board_s)) is not None:
            found.append((real_s, words))
    return found


def test_half_speed_is_told_within_two_seconds_with_the_speed():
    at_s, words = told_of(lambda _: 0.53, 10)[0]
    assert at_s < 2
    assert "53%" in words
    assert "behind" in words


def test_what_lasts_is_told_once_a_minute():
    moments = [at_s for at_s, _ in told_of(lambda _: 0.5, 3 * AGAIN_S - 10)]
    assert len(moments) == 3
    assert min(b - a for a, b in pairwise(moments)) >= AGAIN_S


def test_a_board_that_keeps_up_or_is_a_little_late_is_no_news():
    assert told_of(lambda _: 1.0, 100) == []
    assert told_of(lambda real_s: 0.0 if real_s < 0.4 else 1.0, 100) == []


def test_a_lag_that_is_being_made_good_is_not_told_again():
    # The emulator stands still for three seconds, then runs at double speed until the board has caught up.
    moments = told_of(lambda real_s: 0.0 if real_s < 3 else 2.0 if real_s < 6 else 1.0, 100)
    assert [round(at_s) for at_s, _ in moments] == [1]
