"""Flash the firmware to an Arduino Due: find the board, choose a tool, write, and wait for a HELLO message.

This is the only module that opens a port at 1200 baud, which erases a Due. firmware/README.md explains the
USB ids, the opening at 1200 baud ("touch") and bossac.
"""

import errno
import json
import os
import re
import shutil
import struct
import subprocess
import termios
import time
from collections.abc import Callable
from pathlib import Path
from typing import Literal, NamedTuple

import serial
from serial.tools import list_ports

from fltea.records.errors import FlteaError, UsageError
from fltea.records.events import Chunk, Failed
from fltea.records.small_file import read_small
from fltea.records.visible import visible
from fltea.wire import layout as wire
from fltea.wire.block_reader import FrameReader
from fltea.wire.messages import Refused
from fltea.wire.reader import Reader
from fltea.wire.transport import (
    DUE_NATIVE_PORT,
    DUE_PROGRAMMING_PORT,
    DUE_VENDORS,
    FORBIDDEN_BAUD,
    Port,
    explain_open_failure,
    list_ports_text,
)

Method = Literal["auto", "arduino-cli", "platformio", "bossac"]

FQBN = "arduino:sam:arduino_due_x_dbg"

HOLD_S = 1.0
"""Time for which the port is held open at 1200 baud [s]. During this time, the Due's USB chip erases the
flash for 0.49 s and then resets the Due. Both together take 0.74 s (180 ticks of 4.1 ms in ArduinoCore-sam's
Arduino-usbserial.c). If DTR or the speed changes before the end, the chip starts again.
"""

SAFE_BAUD = 115200
"""Speed to which the port is set after 1200 baud. The port must not keep 1200 baud: opening it raises DTR
before a program can set another speed, and that would erase the board again.
"""

SETTLE_S = 0.5
"""Pause after the port was open at 1200 baud [s], in which the board starts its boot loader."""

FLASH_BEGIN = 0x0008_0000
FLASH_BYTES = 512 * 1024
RAM_BEGIN = 0x2007_0000
RAM_END = 0x2008_8000
"""Addresses of flash and RAM of the Due's microcontroller, the ATSAM3X8E (SAM3X datasheet, chapter 7)."""

VERIFY_S = 15.0
"""Longest wait for HELLO after flashing [s]. The board sends HELLO every second, but the port may come back
late.
"""

WRONG_PORT = (
    "is the Due's native port; the firmware speaks on the programming port, the one beside the power socket"
)


ERASE_UNKNOWN = "--erase-unknown-board"
"""Option by which the user allows that a port is opened at 1200 baud although its USB id is not a Due's."""


class Plan(NamedTuple):
    """A plan for flashing: the tool, the port and the command."""

    method: str
    port: str
    touch: bool
    """Whether the port is first opened at 1200 baud, which erases the board."""
    command: list[str]
    build_id: str | None
    """Id of the firmware's build that the board's HELLO must name after flashing; None if any is accepted."""
    warning: str | None = None

    def lines(self) -> list[str]:
        """Return the plan as shell commands."""
        touch = [
            f"stty -F {self.port} {FORBIDDEN_BAUD}   # erases the board when it closes the port",
            f"sleep {HOLD_S:g}",
            f"stty -F {self.port} {SAFE_BAUD}   # and this one when it opens it",
            f"sleep {HOLD_S:g}",
        ]
        return (touch if self.touch else []) + [" ".join(map(_quoted, self.command))]


def clone_root() -> Path | None:
    """Return the folder of the clone that this program runs from; None if it was installed without one."""
    root = Path(__file__).resolve().parents[3]
    return root if (root / "firmware/arduino/fltea/fltea.ino").is_file() else None


def find_port(wanted: str | None, *, erase_unknown: bool = False) -> str:
    """Return the path of the programming port: `wanted`, or that of the only Due of this machine.

    `wanted`: path of a port; None: find the port of the only Due.
    `erase_unknown`: accept a `wanted` whose USB id is not that of a Due's programming port.

    Raises:
        UsageError: `wanted` is not the programming port of a Due, or it is None and there are several Dues.
        FlteaError: there is no such port.
    """
    ports = {os.path.realpath(p.device): (p.vid, p.pid) for p in list_ports.comports()}
    boards = {path: pid for path, (vid, pid) in ports.items() if vid in DUE_VENDORS}
    dues = [path for path, pid in boards.items() if pid == DUE_PROGRAMMING_PORT]
    natives = [path for path, pid in boards.items() if pid == DUE_NATIVE_PORT]
    if wanted is not None:
        path = os.path.realpath(wanted)
        if not os.path.exists(path):
            raise FlteaError(f"{wanted}: there is no such port. {list_ports_text()}")
        if path in natives:
            raise UsageError(f"{wanted} {WRONG_PORT}.")
        if path not in dues and not erase_unknown:
            raise UsageError(_unknown(wanted, *ports.get(path, (None, None))))
        return path
    if len(dues) > 1:
        raise UsageError(f"there are several Dues: {', '.join(sorted(dues))}. Choose one with --port.")
    if dues:
        return dues[0]
    if natives:
        raise FlteaError(f"{natives[0]} {WRONG_PORT}. Plug the cable in there.")
    raise FlteaError(
        "no Arduino Due found (USB id 2341:003d or 2a03:003d). Is it plugged in by its programming port, the "
        f"one beside the power socket, with a cable that carries data? {list_ports_text()}"
    )


def _unknown(port: str, vid: int | None, pid: int | None) -> str:
    if vid is None or pid is None:
        what = f"{port} has no USB id, so nobody knows whether an Arduino Due is there"
    else:
        what = f"{port} is no Arduino Due (its USB id is {vid:04x}:{pid:04x}, a Due's 2341:003d or 2a03:003d)"
    return (
        f"{what}. The port was not opened, since opening it at 1200 baud erases some boards. If it is a "
        f"Due's programming port all the same, with another USB chip: {ERASE_UNKNOWN}. {list_ports_text()}"
    )


def make_plan(method: Method, port: str, image: Path | None, root: Path | None) -> Plan:
    """Choose the tool for flashing, and return the plan with its command.

    `method`: the tool; `auto` is the first installed one of arduino-cli, PlatformIO and bossac.
    `image`: a binary for bossac, the only tool that takes one.
    `root`: folder of the clone; None if there is none.

    Raises:
        UsageError: the arguments contradict each other, or files of the firmware are missing.
        FlteaError: the tool is not installed.
    """
    if image is not None and method not in ("auto", "bossac"):
        raise UsageError(f"--image goes with bossac only; {method} builds the Arduino port from its sources.")
    if root is None and (image is None or method in ("arduino-cli", "platformio")):
        raise UsageError(
            "this fltea does not run from a clone of the project, so it has no firmware beside it. Run it in "
            "a clone, or give --image FILE."
        )
    pio = next((name for name in ("pio", "platformio") if shutil.which(name)), None)
    available = {
        "arduino-cli": image is None and shutil.which("arduino-cli") is not None,
        "platformio": image is None and pio is not None,
        "bossac": _bossac() is not None,
    }
    chosen = method if method != "auto" else next((name for name, there in available.items() if there), None)
    if chosen is None or not available[chosen]:
        missing = "no tool for flashing is installed" if chosen is None else f"{chosen} is not installed"
        raise FlteaError(
            f"{missing}. Best is arduino-cli (then: arduino-cli core install arduino:sam, which also brings "
            "bossac 1.6.1), or PlatformIO (pip install platformio)."
        )
    if chosen == "bossac":
        return _bossac_plan(port, image, root)
    assert root is not None
    sketch, build_id = root / "firmware/arduino/fltea", _build_id_of_sources(root)
    if chosen == "arduino-cli":
        command = ["arduino-cli", "compile", "--fqbn", FQBN, "--library", str(root / "firmware/core")]
        command += ["--upload", "--port", port, str(sketch)]
    else:
        assert pio is not None
        command = [pio, "run", "--project-dir", str(sketch.parent)]
        command += ["--target", "upload", "--upload-port", port]
    return Plan(chosen, port, False, command, build_id)


def _bossac_plan(port: str, image: Path | None, root: Path | None) -> Plan:
    if image is None:
        assert root is not None
        image = root / "firmware/due/image/fltea_due.bin"
    if not image.is_file():
        raise UsageError(f"{image}: there is no such image.")
    check_image(image)
    facts = image.with_suffix(".json")
    try:
        build_id = str(json.loads(read_small(facts))["build_id"]) if facts.is_file() else None
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise UsageError(f"{facts}: does not state the image's build_id ({error}).") from error
    name = os.path.relpath(port, "/dev") if port.startswith("/dev/") else port
    bossac = _bossac()
    assert bossac is not None
    command = [bossac, f"--port={name}", "-U", "false", "-e", "-w", "-v", "-b", str(image), "-R"]
    version = _bossac_version(bossac)
    warning = None
    if version is None or re.match(r"1\.[89]", version):
        warning = (
            f"bossac {version or 'of unknown version'}: 1.8 and 1.9 are widely reported to fail on the Due, "
            "and then leave it erased. 1.6.1-arduino works (it comes with arduino-cli's core arduino:sam)."
        )
    return Plan("bossac", port, True, command, build_id, warning)


def check_image(image: Path) -> None:
    """Refuse an image that does not begin with a vector table for the Due.

    The ARMv7-M Architecture Reference Manual describes the table in B1.5.3.

    Raises:
        UsageError: the file cannot be read, or is no image for the Due.
    """
    content = read_small(image)
    if not 8 <= len(content) <= FLASH_BYTES:
        wrong = f"it has {len(content)} bytes, the flash {FLASH_BYTES}"
    else:
        stack, reset = struct.unpack_from("<II", content)
        if not RAM_BEGIN < stack <= RAM_END or stack % 4:
            wrong = f"its first word puts the stack at 0x{stack:08x}, which is not in RAM"
        elif not FLASH_BEGIN + 8 < reset < FLASH_BEGIN + len(content) or reset % 2 == 0:
            wrong = f"its second word puts the reset handler at 0x{reset:08x}, which is no Thumb code in it"
        else:
            return
    raise UsageError(
        f"{image}: is no image for the Due: {wrong}. Give the plain binary (.bin), linked to "
        f"0x{FLASH_BEGIN:x}. Nothing was erased."
    )


def _bossac() -> str | None:
    """Return the path of bossac; the Arduino core's bossac is preferred, since it is known to work."""
    arduino = Path.home() / ".arduino15/packages/arduino/tools/bossac/1.6.1-arduino/bossac"
    return str(arduino) if os.access(arduino, os.X_OK) else shutil.which("bossac")


def _bossac_version(bossac: str) -> str | None:
    try:
        done = subprocess.run([bossac, "--help"], capture_output=True, text=True, timeout=10, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return None
    found = re.search(r"Version (\S+)", done.stdout + done.stderr)
    return found[1] if found else None


def _build_id_of_sources(root: Path) -> str:
    header = root / "firmware/core/build_id.h"
    found = (
        re.search(r'kBuildId\[\] = "([0-9a-f]{8})"', header.read_text("utf-8")) if header.is_file() else None
    )
    if found is None:
        raise UsageError(f"{header}: states no build id. Run 'make gen'.")
    return found[1]


def carry_out(plan: Plan, sleep: Callable[[float], None] = time.sleep) -> None:
    """Carry out a plan: open the port at 1200 baud if the plan says so, and run its command in the terminal.

    Raises:
        FlteaError: the port cannot be opened, or the command failed.
    """
    if plan.touch:
        touch(plan.port, sleep)
        sleep(SETTLE_S)
    way_out = (
        "The board is erased by now, but cannot be ruined that way: its boot loader is in ROM. Press "
        "the button ERASE, then RESET, and try again, best with another tool (--method)."
        if plan.touch
        else "See its message above; close whatever else uses the port. Unplug the USB cable and plug it in "
        f"again: the tool may have left the port at {FORBIDDEN_BAUD} baud, and then whatever opens it erases "
        "the board. Then try again."
    )
    try:
        code = subprocess.run(plan.command, check=False).returncode
    except OSError as error:
        raise FlteaError(f"{plan.command[0]} could not be started ({error}). {way_out}") from error
    if code:
        raise FlteaError(f"{plan.command[0]} failed with exit code {code}. {way_out}")


def touch(port: str, sleep: Callable[[float], None] = time.sleep) -> None:
    """Drop DTR at 1200 baud, so that the Due's USB chip erases the flash and resets the Due.

    The port stays open until the reset has ended. Then its speed is set to SAFE_BAUD, even if an exception
    was raised.

    Raises:
        FlteaError: the port cannot be opened, or was lost.
    """
    connection = serial.Serial(baudrate=SAFE_BAUD, exclusive=True)
    connection.port = port
    try:
        connection.open()
    except (OSError, termios.error) as error:
        raise FlteaError(explain_open_failure(port, error)[1]) from error
    try:
        with connection:
            try:
                connection.baudrate = FORBIDDEN_BAUD
                _drop_dtr(connection)
                sleep(HOLD_S)
            finally:
                connection.baudrate = SAFE_BAUD
    except (OSError, termios.error) as error:
        raise FlteaError(
            f"{port} was lost during the touch at {FORBIDDEN_BAUD} baud ({error}): is the cable loose? The "
            "board may be erased by now. Unplug the USB cable, plug it in again, and try again."
        ) from error


def _drop_dtr(connection: serial.Serial) -> None:
    try:
        connection.dtr = False
    except OSError as error:
        # ENOTTY and EINVAL mean that the port is a pseudo-terminal, which has no DTR
        if error.errno not in (errno.ENOTTY, errno.EINVAL):
            raise


def wait_for_hello(port: str, build_id: str | None, timeout_s: float = VERIFY_S) -> wire.Hello:
    """Return the HELLO of the board at `port`, after checking that it names build `build_id`.

    Raises:
        FlteaError: no HELLO came within `timeout_s`, or it is of another protocol version or another build.
    """
    reader, frames = Reader(Port(port, wire.BAUD)), FrameReader()
    deadline_s = time.monotonic() + timeout_s
    trouble = "it said nothing that is a frame of fltea"
    reader.start()
    try:
        for event in reader.events(0.2):
            if isinstance(event, Failed):
                trouble = event.message.rstrip(".")
            elif isinstance(event, Chunk):
                for frame in frames.feed(event.data):
                    if isinstance(frame, Refused):
                        raise FlteaError(f"{port}: {frame.message}. The upload did not take.")
                    if isinstance(frame.message, wire.Hello):
                        return _checked(frame.message, port, build_id)
            if time.monotonic() > deadline_s:
                break
    finally:
        reader.close()
    raise FlteaError(
        f"{port}: no HELLO in {timeout_s:g} s after the upload ({trouble}). Press RESET and try 'fltea "
        f"inspect {port}'; if that stays silent, flash again."
    )


def _checked(hello: wire.Hello, port: str, build_id: str | None) -> wire.Hello:
    running = hello.firmware_version.split()[-1:]
    if build_id is not None and running != [build_id]:
        raise FlteaError(
            f"{port}: the board runs '{visible(hello.firmware_version)}', not build {build_id}. The upload "
            "did not take, or went to another board: flash again."
        )
    return hello


def _quoted(word: str) -> str:
    return f"'{word}'" if " " in word else word
