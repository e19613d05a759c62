"""Run small assembly programs on emulated boards. The programs are assembled when needed."""

import subprocess
import tempfile
from functools import cache
from pathlib import Path

import pytest

from tests.rig.toolchain import arm_compiler
from tools.due_emulator.board import Board
from tools.due_emulator.machine import PS_PER_S, EmulationFault
from tools.due_emulator.memory_map import RAM_BASE
from tools.due_emulator.noise import Constant

FOLDER = Path(__file__).resolve().parents[1] / "due_emulator"
FLAGS = [
    "-mcpu=cortex-m3",
    "-mthumb",
    "-Os",
    "-std=gnu++11",
    "-fno-exceptions",
    "-fno-rtti",
    "-Wall",
    "-Wextra",
]
FLAGS += ["-Werror", "-nostdlib", "-ffreestanding", "-fno-tree-loop-distribute-patterns"]

PRELUDE = (FOLDER / "prelude.S").read_text(encoding="utf-8")

TICK_EACH_MS = "systick 3999, 7\n"
COUNT = "\n count_ticks\n"
"""Assembly code that makes SysTick fire every millisecond at the clock rate after reset. Its handler counts
in the first word of RAM.
"""


def program(text, handlers=None):
    """Return the image of a program that begins with the assembly code `text`.

    `handlers`: label of the handler by exception number.
    """
    return _build(_source(text, handlers), ".S")


def linked_program(folder, text, handlers=None):
    """Build a program as `program` does, and write it as an ELF file.

    Return the file's path and the image.
    """
    return _link(folder, _source(text, handlers), ".S")


def cpp_program(path):
    return _build(path.read_text(), ".cpp")


def _source(text, handlers):
    vectors = "".join(f"handler {n}, {label}\n" for n, label in sorted((handlers or {}).items()))
    return f"{PRELUDE}{vectors}.org 4 * 61\n.text\nreset:\n{text}\n.ltorg\n"


@cache
def _build(source, suffix):
    with tempfile.TemporaryDirectory() as name:
        return _link(Path(name), source, suffix)[1]


def _link(folder, source, suffix):
    compiler = arm_compiler()
    (folder / f"program{suffix}").write_text(source)
    elf, raw = folder / "program.elf", folder / "program.bin"
    for command in (
        [compiler, *FLAGS, "-T", FOLDER / "due.ld", folder / f"program{suffix}", "-lgcc", "-o", elf],
        ["arm-none-eabi-objcopy", "-O", "binary", elf, raw],
    ):
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
    return elf, raw.read_bytes()


class Bench:
    """An emulated board with a program, the bytes that the board sent, and access to the program's results in
    RAM.
    """

    def __init__(self, image, **options):
        self.received = bytearray()
        self.board = Board(image, **{"seed": 1, "world": Constant(), **options})
        self.board.bridge.deliver = self._take

    def _take(self, byte):
        self.received.append(byte)
        return True

    def run(self, seconds):
        self.board.run_until(seconds)
        return self

    def fault(self, seconds=1.0):
        """Run the program, and return the reason for which the emulator ends the run."""
        with pytest.raises(EmulationFault) as caught:
            self.board.run_until(seconds)
        return caught.value.reason

    def slot(self, n):
        """Return word `n` of RAM, where the program stores a result."""
        return int.from_bytes(self.board.memory.read(RAM_BASE + 4 * n, 4), "little")


def run(text, seconds=0.01, handlers=None, **options):
    return Bench(program(text, handlers), **options).run(seconds)


def peripheral(board, name):
    """Return a peripheral of the microcontroller by its name in the vendor's description."""
    return next(one for one in board.peripherals if one.name == name)


def reason(action, *arguments):
    """Call `action`, and return the reason for which the emulator ends the run."""
    with pytest.raises(EmulationFault) as caught:
        action(*arguments)
    return caught.value.reason


def fault_of(text, seconds=0.1, handlers=None):
    return Bench(program(text, handlers)).fault(seconds)


MS = PS_PER_S // 1000
FAR = 0x0037_0809
"""Value for the register CKGR_MOR. It switches the crystal and the RC oscillator on.

The start-up time of the crystal is 64 cycles of the slow clock (1.95 ms). Each write of this register has to
contain the key 0x37.
"""
PLLA_168 = 1 << 29 | 13 << 16 | 0x3F << 8 | 1


def crystal(board: Board) -> None:
    board.pmc.write("CKGR_MOR", FAR)
    board.machine.advance(2 * MS)
    board.pmc.write("CKGR_MOR", FAR | 1 << 24)
    board.machine.advance(MS)


def plla(board: Board) -> None:
    crystal(board)
    board.pmc.write("CKGR_PLLAR", PLLA_168)
    board.machine.advance(2 * MS)


def wait_states(board: Board) -> None:
    for controller in board.flash_controllers:
        controller.write("FMR", 4 << 8)


def full_speed(board: Board) -> None:
    wait_states(board)
    plla(board)
    for value in (0x11, 0x12):
        board.pmc.write("MCKR", value)
        board.machine.advance(MS)
