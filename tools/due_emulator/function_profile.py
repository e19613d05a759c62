"""Counts a program's instructions by function, and by phase.

A phase is a function together with all functions that it calls.
"""

import bisect
import subprocess
from collections import Counter
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Self

from tools.due_emulator.cortex_m3 import THUMB
from tools.due_emulator.cpu import Cpu

NM = "arm-none-eabi-nm"
ELSEWHERE = "(no function)"


def functions_of(elf: Path) -> dict[int, str]:
    """Return the names of a linked program's functions by address.

    If an address has several names, the result has the name by which compiled code calls the function.

    Raises:
        FileNotFoundError: arm-none-eabi-nm is not installed (Debian: binutils-arm-none-eabi).
        subprocess.CalledProcessError: the file is no ELF file.
    """
    command = [NM, "--demangle", "--defined-only", str(elf)]
    text = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    symbols = [(int(line[:8], 16), line[11:]) for line in text.splitlines() if line[9] in "tTwW"]
    symbols.sort(key=lambda symbol: (symbol[1].startswith("__aeabi_"), symbol[1]))
    return {address & ~THUMB: name for address, name in symbols}


class Profile:
    """Counts instructions by function and by phase within a `with` block. This makes the emulation slower.

    `functions`: names by address. A function extends to the next one; if code runs into the next function
    without a jump, its instructions count for the first function until the next jump.

    `phases`: names of functions. A phase lasts from a call of its function to the return. Interrupt handlers
    that run meanwhile do not count for it, nor does another phase that the function calls. A function that
    the compiler has inlined cannot be a phase.

    Raises:
        ValueError: the program has no function with a phase's name.
    """

    def __init__(self, cpu: Cpu, functions: Mapping[int, str], phases: Collection[str] = ()) -> None:
        if unknown := sorted(set(phases) - set(functions.values())):
            raise ValueError(f"no function has this name, or the compiler inlined it: {', '.join(unknown)}")
        self.by_function: Counter[str] = Counter()
        """Number of instructions of each function, without the functions that it called."""
        self.by_phase: Counter[str] = Counter()
        """Number of instructions of each phase, over all its calls."""
        self.calls: Counter[str] = Counter()
        """Number of calls of each phase."""
        self._cpu = cpu
        self._begins = sorted(functions)
        self._names = [functions[address] for address in self._begins]
        self._phases = {address: name for address, name in functions.items() if name in phases}
        self._calls: dict[int, list[tuple[str, int]]] = {}
        """For each number of nested exceptions (0: none): the phases that were called at that depth and have
        not returned, with name and return address. The innermost phase is last.
        """
        self._function = ELSEWHERE
        self._phase: str | None = None
        self._counted = 0

    def __enter__(self) -> Self:
        self._function, self._counted = self._function_at(self._cpu.pc), self._cpu.instructions
        self._cpu.watch(self._on_block)
        return self

    def __exit__(self, *_: object) -> None:
        self._cpu.watch(None)
        self._attribute(self._cpu.instructions)

    def _on_block(self, address: int, instructions: int) -> None:
        self._attribute(instructions)
        self._function = self._function_at(address)
        running = self._calls.setdefault(self._cpu.active_exceptions, [])
        while running and running[-1][1] == address:
            running.pop()
        if address in self._phases:
            call = (self._phases[address], self._cpu.return_address)
            # A function's first block may begin several times in one call of the function: an interrupt came
            # before its first instruction, or the block is the body of a loop. This counts as one call.
            if running[-1:] != [call]:
                running.append(call)
                self.calls[call[0]] += 1
        self._phase = running[-1][0] if running else None

    def _attribute(self, instructions: int) -> None:
        """Add the latest instructions to the function and phase that were running.

        The latest instructions are those since the last call of this method.
        """
        ran = instructions - self._counted
        self._counted = instructions
        if ran:
            self.by_function[self._function] += ran
            if self._phase is not None:
                self.by_phase[self._phase] += ran

    def _function_at(self, address: int) -> str:
        place = bisect.bisect_right(self._begins, address) - 1
        return self._names[place] if place >= 0 else ELSEWHERE
