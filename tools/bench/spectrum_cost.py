"""Measures the time of the running spectrum and the fit on the board, and compares the results with a PC's.

`spectrum_program.cpp` generates its own noise, adds it to the spectrum of one axis, and fits it twice: first
from a grid of starting values, then from the last result. It is built for the emulated Due, which counts
instructions, and for this machine.
"""

import os
import shutil
import struct
import subprocess
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

from tools.bench.device_cost import AXES, CLOCK_HZ, CYCLES, RATE_HZ
from tools.due_emulator.board import Board
from tools.due_emulator.noise import Constant

ROOT = Path(__file__).resolve().parents[2]
PROGRAM = Path(__file__).with_name("spectrum_program.cpp")
LINKER_SCRIPT = ROOT / "tests/due_emulator/due.ld"
ENGINE = ROOT / "firmware/core/engine"
STRICT = ("-std=gnu++11", "-Wall", "-Wextra", "-Werror", f"-I{ENGINE}")
DUE = (
    *("-mcpu=cortex-m3", "-mthumb", "-Os", "-ffreestanding", "-nostdlib", "-fno-exceptions", "-fno-rtti"),
    *("-fno-threadsafe-statics", "-fno-tree-loop-distribute-patterns", "-ffunction-sections"),
    "-Wl,--gc-sections",
)
MOST_S = 600
"""Largest time that the program may take on the emulated board [s of virtual time]. It is large, because the
board runs at the slow clock that it has after a reset.
"""
PHASES = ("sample", "level", "bins", "first fit", "next fit", "filter", "track")
LAYOUT = struct.Struct("<2I4f10I" + 3 * f"{len(PHASES)}I")
NOISES = ("kSlow", "kWhite", "kFast", "kFullScale", "kConstant")
"""Noises that the program can generate: the names in its enum Kind."""
FILTERS = 3
"""Number of Kalman filters (of the bias tracker) that the program designs."""
FIT_EVERY_S = 3.0
"""Assumed time between fits [s], from which the fits' proportion of the processor's time is computed."""


class Phase(NamedTuple):
    """Calls and instructions of a phase of the program on the emulated board.

    `longest`: largest number of instructions in one call. A fit is computed in many short calls.
    """

    calls: int
    instructions: int
    longest: int


class Found(NamedTuple):
    """The figures of a run of the program."""

    hash: int
    alpha: float
    alpha_std: float
    bins: int
    levels: int
    evaluations: tuple[int, int]
    """Numbers of evaluations of the likelihood in the first fit and in the next."""
    bytes: tuple[int, int, int, int, int]
    """Sizes in memory [bytes]: of an axis's spectrum, of the spectrum's bins in a fit, of a fit, of what an
    axis keeps between fits, and of an axis's bias tracker.
    """
    phases: dict[str, Phase]


def on_pc(samples: int, noise: str = NOISES[0]) -> Found:
    """Run the program on this machine, with one of NOISES.

    Only the emulated Due counts instructions, so all counts in `phases` are zero here.

    Raises:
        subprocess.CalledProcessError: the program cannot be built.
    """
    with tempfile.TemporaryDirectory() as folder:
        program = Path(folder) / "program"
        _compile(program, "g++", "-O2", "-ffp-contract=off", *_flags(samples, noise))
        return _read(subprocess.run([program], capture_output=True, check=True).stdout)


def on_due(samples: int, noise: str = NOISES[0]) -> Found:
    """Run the program on the emulated Due.

    Raises:
        FileNotFoundError: there is no compiler for the Due.
        subprocess.CalledProcessError: the program cannot be built.
        TimeoutError: the program does not end in time.
    """
    with tempfile.TemporaryDirectory() as name:
        elf, raw = Path(name) / "program.elf", Path(name) / "program.bin"
        link = ("-T", LINKER_SCRIPT, "-lgcc")
        _compile(elf, "arm-none-eabi-g++", *DUE, *_flags(samples, noise), link=link)
        _run("arm-none-eabi-objcopy", "-O", "binary", elf, raw)
        symbols = _run("arm-none-eabi-nm", "--demangle", elf)
        (line,) = (line for line in symbols.splitlines() if line.endswith("::results"))
        board = Board(raw.read_bytes(), seed=1, world=Constant())
    address = int(line[:8], 16)
    for second in range(1, MOST_S):
        board.run_until(second)
        data = board.memory.read(address, LAYOUT.size)
        if data is not None and int.from_bytes(data[:4], "little") == 1:
            return _read(data)
    raise TimeoutError(f"the program has not ended within {MOST_S} s of the board's time")


def measure(samples: int = 60_000) -> dict[str, Any]:
    """Return the figures of the run on the emulated board, and whether a run on this PC gives the same bits.

    `share_percent`: the part of the board's processor time that three axes take.
    """
    due, pc = on_due(samples), on_pc(samples)
    taken = due.phases["sample"].instructions + due.phases["level"].instructions
    track = due.phases["track"].instructions / due.phases["track"].calls
    a_filter = due.phases["filter"].instructions / FILTERS
    a_fit = due.phases["bins"].instructions + due.phases["next fit"].instructions + a_filter
    a_second = AXES * ((taken / samples + track) * RATE_HZ + a_fit / FIT_EVERY_S)
    return {
        "samples": samples,
        "same_bits_as_on_a_pc": due.hash == pc.hash,
        "instructions_a_sample": round(taken / samples),
        "instructions_of_bins": due.phases["bins"].instructions,
        "instructions_of_the_first_fit": due.phases["first fit"].instructions,
        "instructions_of_the_next_fit": due.phases["next fit"].instructions,
        "instructions_of_a_filter": round(a_filter),
        "instructions_of_the_tracker_a_sample": round(track),
        "evaluations": list(due.evaluations),
        "longest_slice": {name: phase.longest for name, phase in due.phases.items()},
        "share_percent": round(100 * a_second * CYCLES / CLOCK_HZ, 1),
        "bytes": list(due.bytes),
    }


def text(found: dict[str, Any]) -> str:
    """Return the figures as lines for people."""
    spectrum, bins, fit, kept, tracked = found["bytes"]
    return "\n".join(
        [
            f"spectrum and fit of an axis, {found['samples']:,} samples on the emulated Due: instructions",
            f"{'spectrum, a sample':36} {found['instructions_a_sample']:>12,}",
            f"{'bins for a fit':36} {found['instructions_of_bins']:>12,}",
            f"{'first fit, from a grid':36} {found['instructions_of_the_first_fit']:>12,}",
            f"{'next fit, from the last answer':36} {found['instructions_of_the_next_fit']:>12,}",
            f"{'filter of a fit':36} {found['instructions_of_a_filter']:>12,}",
            f"{'tracker, a sample':36} {found['instructions_of_the_tracker_a_sample']:>12,}",
            f"three axes at 100 Hz, fitted every {FIT_EVERY_S:g} s: {found['share_percent']} % of an 84 MHz "
            f"processor, if an instruction takes {CYCLES} cycles",
            "longest slices: " + ", ".join(f"{name} {n:,}" for name, n in found["longest_slice"].items()),
            f"bytes: {spectrum:,}, {kept:,} and {tracked:,} an axis, {bins:,} and {fit:,} for bins and fit",
            f"the same bits as on this machine: {'yes' if found['same_bits_as_on_a_pc'] else 'NO'}",
        ]
    )


def _read(data: bytes) -> Found:
    values = LAYOUT.unpack(data)
    _, hash_, alpha, alpha_std, _, _, _, cold, warm, bins, levels, spectrum, *of_fit = values[:16]
    counts = values[16:]
    n = len(PHASES)
    phases = {name: Phase(counts[i], counts[n + i], counts[2 * n + i]) for i, name in enumerate(PHASES)}
    return Found(hash_, alpha, alpha_std, bins, levels, (cold, warm), (spectrum, *of_fit), phases)


def _flags(samples: int, noise: str) -> tuple[str, ...]:
    return *STRICT, f"-DSAMPLES={samples}", f"-DNOISE={noise}"


def _compile(program: Path, *command: str, link: tuple[str | Path, ...] = ()) -> None:
    """Build the program.

    If ccache is installed, it stores the object file, which takes seconds to compile.
    """
    cached = ("ccache",) if shutil.which("ccache") else ()
    made = program.with_suffix(".o")
    _run(*cached, *command, "-c", PROGRAM, "-o", made)
    _run(*command, made, *link, "-o", program)


def _run(*command: str | Path) -> str:
    words = [str(part) for part in command]
    # With these variables, ccache finds what another clone of the repository has compiled.
    one_place = {"CCACHE_BASEDIR": str(ROOT), "CCACHE_NOHASHDIR": "1"}
    environment = os.environ | one_place
    return subprocess.run(words, capture_output=True, text=True, check=True, env=environment).stdout
