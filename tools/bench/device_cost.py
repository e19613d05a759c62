"""Measures the board's own estimates: memory, and instructions per axis and sample, by phase.

A phase of the board's work is a function with all functions that it calls.

The firmware is built again, since the committed image has no symbols, and runs on the emulated board.
Instructions are counted, not cycles. The proportion of a real processor's time is computed from an assumed
number of cycles per instruction, `CYCLES`.
"""

import re
import tempfile
from pathlib import Path
from typing import Any

from tools.build_firmware import build
from tools.due_emulator.board import Board
from tools.due_emulator.function_profile import Profile, functions_of
from tools.due_emulator.noise import fractional_world

ROOT = Path(__file__).resolve().parents[2]
CYCLES = 1.4
"""Assumed clock cycles per instruction of a Cortex-M3 with flash at four wait states."""
CLOCK_HZ = 84_000_000
AXES, RATE_HZ = 3, 100
FROM_S, FOR_S = 8.0, 2.0
PHASES = {
    "memory: sums at three orders": r"FixedMemory::states<3>\(",
    "memory: sum at the new order": r"FixedMemory::states<1>\(",
    "memory: sum of variances": r"FixedMemory::variance\(",
    "order and parameter": r"Joint<float>::measure<",
    "state": r"Joint<float>::step<",
    "memory: push; counts of the guard": r"^fltea::engine::baseline::Lane<.*::step\(",
    "centring, supervisor": r"^fltea::AxisEstimator::step\(",
}
"""For each phase (a function with all that it calls): a pattern that matches only the name of its function.
"""


def measure() -> dict[str, Any]:
    """Run the board, and count its instructions. Without the compiler, FileNotFoundError is raised."""
    with tempfile.TemporaryDirectory() as folder:
        image = build(ROOT, "timer", Path(folder))
        functions = functions_of(Path(folder) / "fltea_due.elf")
    names = {label: _the_one(part, list(functions.values())) for label, part in PHASES.items()}
    board = Board(image.data, seed=1, world=fractional_world("alpha=0.5&f=-1"))
    board.run_until(FROM_S)
    idle_ps, before = board.machine.idle_ps, board.cpu.instructions
    with Profile(board.cpu, functions, phases=set(names.values())) as profile:
        board.run_until(FROM_S + FOR_S)
    steps = profile.calls[names["centring, supervisor"]]
    by_phase = {label: profile.by_phase[name] / steps for label, name in names.items()}
    step = sum(by_phase.values())
    floats = sum(n for name, n in profile.by_function.items() if name.startswith(("__aeabi_", "__")))
    return {
        "steps": steps,
        "instructions_by_phase": {label: round(n) for label, n in by_phase.items()},
        "instructions_an_axis_and_step": round(step),
        "of_these_soft_float": round(floats / steps),
        "share_of_estimates_percent": round(100 * step * AXES * RATE_HZ * CYCLES / CLOCK_HZ, 1),
        "instructions_per_s": round((board.cpu.instructions - before) / FOR_S),
        "asleep_percent": round(100 * (board.machine.idle_ps - idle_ps) / (FOR_S * 1e12), 1),
        "flash_bytes": len(image.data),
        "ram_bytes": image.ram_bytes,
    }


def text(found: dict[str, Any]) -> str:
    """Return the figures as a table for people."""
    lines = [f"{label:36} {n:>7,}" for label, n in found["instructions_by_phase"].items()]
    return "\n".join(
        [
            f"instructions an axis and step, of {found['steps']} steps on the emulated Due",
            *lines,
            f"{'together':36} {found['instructions_an_axis_and_step']:>7,}   "
            f"({found['of_these_soft_float']:,} of them soft float)",
            f"three axes at 100 Hz: {found['share_of_estimates_percent']} % of an 84 MHz processor, if an "
            f"instruction takes {CYCLES} cycles",
            f"flash {found['flash_bytes']:,} bytes, RAM {found['ram_bytes']:,} with the stack, all in all",
        ]
    )


def _the_one(pattern: str, names: list[str]) -> str:
    (found,) = {name for name in names if re.search(pattern, name)}
    return found
