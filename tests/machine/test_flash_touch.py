"""Tests of what happens before the flashing tool runs: which files are accepted as an image, and in which
order the port is opened and closed at 1200 baud.
"""

import errno
import struct
import termios
from collections.abc import Iterator
from pathlib import Path

import pytest
import serial
from fltea.machine import flash
from fltea.records.errors import FlteaError, UsageError

from tests.rig.host_support import ROOT
from tests.rig.terminal import SpeakingPort, speaking


@pytest.fixture
def board() -> Iterator[SpeakingPort]:
    with speaking(lambda turn: b"", 60) as port:
        yield port


class Line:
    """A port that records each call of it, with the terminal's speed at that time."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, board: SpeakingPort) -> None:
        self.seen: list[tuple[str, object, int]] = []
        self.dtr_error: BaseException | None = OSError(errno.ENOTTY, "what a pseudo-terminal says")
        self.sleep_error: BaseException | None = None
        self._speed = board.speed
        line = self

        class Watched(serial.Serial):
            def open(self) -> None:
                super().open()
                line.note("open")

            @property
            def dtr(self) -> bool:
                raise NotImplementedError

            @dtr.setter
            def dtr(self, value: bool) -> None:
                line.note("dtr", value)
                if line.dtr_error:
                    raise line.dtr_error

            def close(self) -> None:
                if self.is_open:
                    line.note("close")
                super().close()

        monkeypatch.setattr(serial, "Serial", Watched)

    def note(self, what: str, value: object = None) -> None:
        self.seen.append((what, value, self._speed()))

    def sleep(self, duration_s: float) -> None:
        self.note("sleep", duration_s)
        if self.sleep_error:
            raise self.sleep_error


@pytest.fixture
def line(monkeypatch: pytest.MonkeyPatch, board: SpeakingPort) -> Line:
    return Line(monkeypatch, board)


ERASE_AND_RESET_S = 180 * 256 * 256 / 16e6
"""Time in which the USB chip erases and resets the board [s]: 180 ticks of its timer (16 MHz, divided twice
by 256).
"""


def test_the_touch_holds_1200_baud_until_erased_and_leaves_another_rate(
    board: SpeakingPort, line: Line
) -> None:
    flash.touch(board.port, line.sleep)
    hold_s = line.seen[2][1]
    assert line.seen == [
        ("open", None, termios.B115200),
        ("dtr", False, termios.B1200),
        ("sleep", hold_s, termios.B1200),
        ("close", None, termios.B115200),
    ]
    assert isinstance(hold_s, float)
    assert hold_s > ERASE_AND_RESET_S
    assert board.speed() == termios.B115200


def test_a_port_without_a_dtr_line_is_no_failure_but_a_broken_one_is(board: SpeakingPort, line: Line) -> None:
    line.dtr_error = OSError(errno.EIO, "broken")
    with pytest.raises(FlteaError, match=r"was lost during the touch.*broken"):
        flash.touch(board.port, line.sleep)
    assert line.seen[-1] == ("close", None, termios.B115200)


@pytest.mark.parametrize("where", ["dtr", "sleep"])
def test_an_interrupted_touch_leaves_no_1200_baud(where: str, board: SpeakingPort, line: Line) -> None:
    if where == "dtr":
        line.dtr_error = KeyboardInterrupt()
    else:
        line.sleep_error = KeyboardInterrupt()
    with pytest.raises(KeyboardInterrupt):
        flash.touch(board.port, line.sleep)
    assert line.seen[-2][0::2] == (where, termios.B1200)
    assert line.seen[-1] == ("close", None, termios.B115200)


def test_a_port_that_is_unplugged_during_the_touch_is_a_plain_error(
    board: SpeakingPort, line: Line, monkeypatch: pytest.MonkeyPatch
) -> None:
    def unplugged(*_: object) -> None:
        raise termios.error(errno.EIO, "gone")

    def sleep(_: float) -> None:
        monkeypatch.setattr(termios, "tcsetattr", unplugged)

    with pytest.raises(FlteaError, match=r"was lost during the touch.*gone"):
        flash.touch(board.port, sleep)
    assert line.seen[-1][0] == "close"


def test_a_port_that_cannot_be_touched_is_told(tmp_path: Path) -> None:
    with pytest.raises(FlteaError, match="there is no port"):
        flash.touch(str(tmp_path / "none"))


def tool(folder: Path, code: int) -> str:
    script = folder / "tool"
    script.write_text(f"#!/bin/sh\n: > {folder}/ran\nexit {code}\n")
    script.chmod(0o755)
    return str(script)


def test_bossac_starts_after_the_touch_and_a_pause(board: SpeakingPort, line: Line, tmp_path: Path) -> None:
    plan = flash.Plan("bossac", board.port, True, [tool(tmp_path, 0)], None)

    def sleep(duration_s: float) -> None:
        line.sleep(duration_s)
        assert not (tmp_path / "ran").exists()

    flash.carry_out(plan, sleep)
    (closed, _, _), (slept, pause_s, speed) = line.seen[-2:]
    assert (closed, slept, speed) == ("close", "sleep", termios.B115200)
    assert isinstance(pause_s, float)
    assert pause_s >= 0.5
    assert (tmp_path / "ran").exists()


def test_a_tool_that_cannot_be_started_after_the_touch_leaves_word_of_the_erased_board(
    board: SpeakingPort, line: Line, tmp_path: Path
) -> None:
    plan = flash.Plan("bossac", board.port, True, [str(tmp_path / "none")], None)
    with pytest.raises(FlteaError, match=r"could not be started.*ERASE"):
        flash.carry_out(plan, line.sleep)


def test_a_tool_that_touches_the_port_itself_may_leave_1200_baud(
    board: SpeakingPort, line: Line, tmp_path: Path
) -> None:
    plan = flash.Plan("platformio", board.port, False, [tool(tmp_path, 4)], None)
    with pytest.raises(FlteaError, match=r"exit code 4.*[Uu]nplug the USB cable"):
        flash.carry_out(plan, line.sleep)
    assert line.seen == []


def image_bytes(stack: int = 0x2008_8000, reset: int = 0x0008_0101, size: int = 1024) -> bytes:
    return struct.pack("<II", stack, reset).ljust(size, b"\xff")[:size]


@pytest.fixture
def image(tmp_path: Path) -> Path:
    return tmp_path / "some.bin"


def test_the_committed_image_is_not_refused() -> None:
    flash.check_image(ROOT / "firmware/due/image/fltea_due.bin")


@pytest.mark.parametrize(
    "content",
    [
        image_bytes(stack=0x2007_0004),
        image_bytes(reset=0x0008_0009),
        image_bytes(reset=0x0008_03FF),
        image_bytes(reset=0x000F_FFFF, size=512 * 1024),
    ],
    ids=["stack", "first", "last", "largest"],
)
def test_an_image_at_a_limit_is_not_refused(content: bytes, image: Path) -> None:
    image.write_bytes(content)
    flash.check_image(image)


@pytest.mark.parametrize(
    ("content", "why"),
    [
        (b"", "0 bytes"),
        (image_bytes(size=7), "7 bytes"),
        (image_bytes(size=512 * 1024 + 1), "524289 bytes"),
        (b"\x7fELF\x01\x01\x01".ljust(2048, b"\0"), "stack at 0x464c457f"),
        (b"\xff" * 2048, "stack at 0xffffffff"),
        (image_bytes(stack=0x2007_0000), "stack at 0x20070000"),
        (image_bytes(stack=0x2008_8004), "stack at 0x20088004"),
        (image_bytes(stack=0x2007_2002), "stack at 0x20072002"),
        (image_bytes(reset=0x0008_0100), "reset handler at 0x00080100"),
        (image_bytes(reset=0x0007_FFFF), "reset handler at 0x0007ffff"),
        (image_bytes(reset=0x0008_0007), "reset handler at 0x00080007"),
        (image_bytes(reset=0x0008_0401), "reset handler at 0x00080401"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_a_file_that_is_no_image_is_refused(content: bytes, why: str, image: Path) -> None:
    image.write_bytes(content)
    with pytest.raises(UsageError, match=f"no image for the Due.*{why}"):
        flash.check_image(image)


def test_an_image_that_cannot_be_read_is_told(image: Path) -> None:
    with pytest.raises(UsageError, match=r"cannot be read.*No such file"):
        flash.check_image(image)
