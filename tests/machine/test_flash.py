"""Tests `fltea flash` with fake tools that only record their arguments, and with a pseudo-terminal in place
of a board.
"""

import re
import struct
import subprocess
import termios
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest
from fltea.machine import flash
from fltea.records.errors import FlteaError, UsageError
from fltea.wire import layout as wire
from fltea.wire import transport
from fltea.wire.messages import encode

from tests.rig.host_support import ROOT, WIRE_HELLO, fltea, fltea_here
from tests.rig.terminal import SpeakingPort, speaking

HELLO = WIRE_HELLO._replace(firmware_version="0.1.0 due 12ab34cd", who_am_i=0, sensor_starts=0)


def says(hello: wire.Hello) -> Callable[[int], bytes]:
    return lambda turn: b"\0" + encode(hello, 0, 0)


@pytest.fixture
def board() -> Iterator[SpeakingPort]:
    """Start a board that sends HELLO several times a second."""
    with speaking(says(HELLO), 0.05) as port:
        yield port


UNKNOWN = "--erase-unknown-board"
"""Option that these tests need, since a pseudo-terminal has no USB id."""


class Desk:
    """What a test of `fltea flash` needs: a board, an image, and a folder of tools, which is the command's
    whole PATH.
    """

    def __init__(self, folder: Path, board: SpeakingPort) -> None:
        self.folder, self.board = folder, board
        self.image = folder / "some.bin"
        self.image.write_bytes(struct.pack("<II", 0x2008_8000, 0x0008_0101).ljust(1024, b"\xff"))
        self.image.with_suffix(".json").write_text('{"build_id": "12ab34cd"}')
        (folder / "bin").mkdir()

    def add(self, name: str, *, code: int = 0, version: str = "1.6.1-arduino", folder: str = "bin") -> Path:
        script = self.folder / folder / name
        script.parent.mkdir(parents=True, exist_ok=True)
        script.write_text(
            f'#!/bin/sh\nif [ "$1" = --help ]; then echo "BOSSA Version {version}"; exit 1; fi\n'
            f'echo "{name} $*" >> {self.folder}/calls\n'
            'case "$1" in --port=*) /usr/bin/stty -F "/dev/${1#--port=}" speed '
            f">> {self.folder}/calls;; esac\n"
            f"exit {code}\n"
        )
        script.chmod(0o755)
        return script

    def calls(self) -> list[str]:
        path = self.folder / "calls"
        return path.read_text().splitlines() if path.exists() else []

    def run(self, *arguments: str | Path) -> subprocess.CompletedProcess[str]:
        return fltea_here("flash", "--port", self.board.port, UNKNOWN, *arguments)

    def write(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        return self.run("--image", self.image, *arguments)


@pytest.fixture
def desk(tmp_path: Path, board: SpeakingPort, monkeypatch: pytest.MonkeyPatch) -> Desk:
    monkeypatch.setenv("PATH", str(tmp_path / "bin"))
    monkeypatch.setenv("HOME", str(tmp_path))
    # this shortens the waits of the command, but only within this process
    monkeypatch.setattr(flash, "HOLD_S", 1e-3)
    monkeypatch.setattr(flash, "SETTLE_S", 1e-3)
    return Desk(tmp_path, board)


def test_bossac_after_a_touch_at_1200_baud(desk: Desk) -> None:
    desk.add("bossac")
    done = fltea("flash", "--port", desk.board.port, UNKNOWN, "--image", desk.image, "--yes")
    assert (done.returncode, done.stderr) == (0, "")
    assert "runs '0.1.0 due 12ab34cd'" in done.stdout
    name = desk.board.port.removeprefix("/dev/")
    assert desk.calls() == [f"bossac --port={name} -U false -e -w -v -b {desk.image} -R", "115200"]


@pytest.mark.parametrize(
    ("version", "told"), [("1.8", True), ("1.9.1", True), ("1.7.0", False), ("1.6.1-arduino", False)]
)
def test_versions_of_bossac_that_fail_are_warned_of(version: str, told: bool, desk: Desk) -> None:
    desk.add("bossac", version=version)
    done = desk.write("--dry-run")
    assert done.returncode == 0
    assert (f"warning: bossac {version}" in done.stderr) == told


def test_the_bossac_of_the_arduino_core_is_preferred(desk: Desk) -> None:
    desk.add("bossac", version="1.9.1")
    known = desk.add("bossac", folder=".arduino15/packages/arduino/tools/bossac/1.6.1-arduino")
    done = desk.write("--dry-run")
    assert (done.stderr, str(known) in done.stdout) == ("", True)


def test_arduino_cli_comes_first_then_platformio_then_bossac(desk: Desk) -> None:
    built = re.search(r'kBuildId\[\] = "(\w+)"', (ROOT / "firmware/core/build_id.h").read_text())
    desk.board.speech = says(HELLO._replace(firmware_version=f"0.1.0 arduino {built[1]}"))
    port, project = desk.board.port, ROOT / "firmware/arduino"
    desk.add("bossac")
    assert "bossac" in desk.run("--dry-run").stdout
    for tool in ("pio", "arduino-cli"):
        desk.add(tool)
        assert desk.run("-y").returncode == 0
    assert desk.calls() == [
        f"pio run --project-dir {project} --target upload --upload-port {port}",
        f"arduino-cli compile --fqbn arduino:sam:arduino_due_x_dbg --library {ROOT / 'firmware/core'} "
        f"--upload --port {port} {project / 'fltea'}",
    ]
    assert desk.board.speed() != termios.B1200, "arduino-cli and PlatformIO touch the port themselves"
    assert "bossac" in desk.run("--method", "bossac", "--dry-run").stdout


def test_a_dry_run_does_nothing(desk: Desk) -> None:
    desk.add("bossac")
    before, port = desk.board.speed(), desk.board.port
    done = fltea("flash", "--port", port, UNKNOWN, "--image", desk.image, "--dry-run")
    assert done.returncode == 0
    touch, erase, calm, erase_again, write = (line.split("#")[0].strip() for line in done.stdout.splitlines())
    assert (touch, erase) == (f"stty -F {port} 1200", "sleep 1")
    assert (calm, erase_again) == (f"stty -F {port} 115200", "sleep 1")
    assert write.endswith(f"bossac --port={port.removeprefix('/dev/')} -U false -e -w -v -b {desk.image} -R")
    assert (desk.calls(), desk.board.speed()) == ([], before)


@pytest.mark.parametrize(
    ("hello", "tool", "texts"),
    [
        ({"firmware_version": "0.1.0 due 99999999"}, 0, ["runs '0.1.0 due 99999999', not build 12ab34cd"]),
        ({"schema_hash": 1}, 0, ["schema 0x00000001"]),
        ({}, 3, ["exit code 3", "ERASE"]),
    ],
    ids=["another build", "another protocol", "a tool that fails"],
)
def test_what_fails_is_said_with_the_way_out(
    hello: dict[str, object], tool: int, texts: list[str], desk: Desk
) -> None:
    desk.add("bossac", code=tool)
    desk.board.speech = says(HELLO._replace(**hello))
    done = desk.write("--yes")
    assert (done.returncode, [text for text in texts if text not in done.stderr]) == (1, [])


def test_an_image_of_unknown_build_is_not_judged(desk: Desk) -> None:
    desk.add("bossac")
    desk.image.with_suffix(".json").unlink()
    done = desk.write("--yes")
    assert (done.returncode, "no file beside the image" in done.stdout) == (0, True)


@pytest.mark.parametrize(
    ("arguments", "code", "text"),
    [
        (["--port", "/dev/none"], 1, "/dev/none: there is no such port"),
        ([], 1, "no tool for flashing is installed"),
        (["--method", "platformio"], 1, "platformio is not installed"),
        (["--method", "arduino-cli", "--image", "x"], 2, "--image goes with bossac only"),
    ],
)
def test_what_cannot_be_done_is_said(arguments: list[str], code: int, text: str, desk: Desk) -> None:
    done = desk.run(*arguments)
    assert (done.returncode, text in done.stderr) == (code, True)


@pytest.mark.parametrize(
    ("file", "content", "flag", "text"),
    [
        ("some.bin", None, "--yes", "there is no such image"),
        ("some.json", b"[]", "--yes", "does not state the image's build_id"),
        ("some.bin", b"\x7fELF".ljust(1024, b"\0"), "--yes", "some.bin: is no image for the Due"),
        ("some.json", b'{"build_id": "12ab34cd"}', None, "--yes"),
    ],
    ids=["missing", "nonsense", "no image", "nobody to ask"],
)
def test_what_cannot_be_flashed_erases_nothing(
    file: str, content: bytes | None, flag: str | None, text: str, desk: Desk
) -> None:
    desk.add("bossac")
    before, path = desk.board.speed(), desk.image.with_name(file)
    path.unlink() if content is None else path.write_bytes(content)
    done = desk.write(*([flag] if flag else []))
    assert (done.returncode, text in done.stderr) == (2, True)
    assert (desk.calls(), desk.board.speed()) == ([], before)


def test_outside_of_a_clone_it_says_so() -> None:
    with pytest.raises(UsageError, match="does not run from a clone"):
        flash.make_plan("auto", "/dev/ttyACM0", None, None)


def test_a_silent_board_is_told_after_a_while() -> None:
    with (
        speaking(lambda turn: b"", 60) as board,
        pytest.raises(FlteaError, match=r"no HELLO in 0\.3 s after the upload"),
    ):
        flash.wait_for_hello(board.port, "12ab34cd", timeout_s=0.3)


def test_nothing_else_opens_at_1200_baud() -> None:
    with pytest.raises(UsageError, match="1200 baud is refused"):
        transport.check_url("/dev/ttyACM0", 1200)
    uses = [p.name for p in (ROOT / "host/fltea").rglob("*.py") if "FORBIDDEN_BAUD" in p.read_text()]
    assert sorted(uses) == ["flash.py", "transport.py"]


def ports(monkeypatch: pytest.MonkeyPatch, *found: tuple[str, int | None, int | None]) -> None:
    listed = [SimpleNamespace(device=d, vid=v, pid=p, description="") for d, v, p in found]
    monkeypatch.setattr(flash.list_ports, "comports", lambda: listed)


DUE, NATIVE = (0x2341, 0x003D), (0x2341, 0x003E)


@pytest.mark.parametrize("vid", [0x2341, 0x2A03])
def test_the_only_due_is_found(monkeypatch: pytest.MonkeyPatch, vid: int) -> None:
    plugged = [("/dev/ttyS0", None, None), ("/dev/ttyACM7", vid, 0x003D), ("/dev/ttyACM8", vid, 0x003E)]
    ports(monkeypatch, *plugged)
    assert flash.find_port(None) == "/dev/ttyACM7"


@pytest.mark.parametrize(
    ("usb_id", "wanted", "error", "text"),
    [
        (DUE, False, UsageError, "/dev/pts/.*, /dev/ttyACM0"),
        (NATIVE, False, FlteaError, "native port"),
        (NATIVE, True, UsageError, "native port"),
        ((0x0403, 0x6001), True, UsageError, "0403:6001"),
        ((0x0403, 0x6001), False, FlteaError, "no Arduino Due found"),
    ],
    ids=["several", "native", "native by name", "another by name", "another"],
)
def test_no_other_port_is_ever_touched(
    usb_id: tuple[int, int],
    wanted: bool,
    error: type[FlteaError],
    text: str,
    monkeypatch: pytest.MonkeyPatch,
    board: SpeakingPort,
) -> None:
    ports(monkeypatch, (board.port, *usb_id), *([("/dev/ttyACM0", *DUE)] if usb_id == DUE else []))
    with pytest.raises(error, match=text) as refused:
        flash.find_port(board.port if wanted else None)
    assert type(refused.value) is error


@pytest.mark.parametrize("usb_id", [(None, None), (0x0403, 0x6001)], ids=["no USB id", "of another chip"])
def test_a_port_that_nothing_names_a_due_is_opened_only_with_the_flag(
    usb_id: tuple[int | None, int | None], desk: Desk, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Opening a port at 1200 baud erases the board.

    So the option `--yes` alone does not suffice for a port that may not be a Due.
    """
    ports(monkeypatch, (desk.board.port, *usb_id))
    desk.add("bossac")
    before, given = desk.board.speed(), ("--port", desk.board.port, "--image", desk.image, "--yes")
    for more in ([], ["--dry-run"]):
        done = fltea_here("flash", *given, *more)
        assert (done.returncode, UNKNOWN in done.stderr) == (2, True)
    assert (desk.calls(), desk.board.speed()) == ([], before)
    assert fltea_here("flash", *given, UNKNOWN).returncode == 0
    assert len(desk.calls()) == 2


def test_the_flag_does_not_open_a_native_port(board: SpeakingPort, monkeypatch: pytest.MonkeyPatch) -> None:
    ports(monkeypatch, (board.port, *NATIVE))
    with pytest.raises(UsageError, match="native port"):
        flash.find_port(board.port, erase_unknown=True)


def test_a_due_needs_no_flag(desk: Desk, monkeypatch: pytest.MonkeyPatch) -> None:
    """A Due is flashed without the option `--erase-unknown-board`, which `make flash PORT=PORT` does not
    give.
    """
    ports(monkeypatch, (desk.board.port, *DUE))
    desk.add("bossac")
    done = fltea_here("flash", "--port", desk.board.port, "--image", desk.image, "--yes")
    assert (done.returncode, done.stderr) == (0, "")


def test_a_link_to_the_port_will_do(
    monkeypatch: pytest.MonkeyPatch, board: SpeakingPort, tmp_path: Path
) -> None:
    ports(monkeypatch, (board.port, *DUE))
    link = tmp_path / "due"
    link.symlink_to(board.port)
    assert flash.find_port(str(link)) == board.port
