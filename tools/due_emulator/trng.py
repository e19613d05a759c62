"""The true random number generator (SAM3X datasheet, chapter 41). In the emulation it is seeded."""

import numpy as np

from tools.due_emulator.machine import PS_PER_S, Alarm, Machine
from tools.due_emulator.peripheral import Peripheral

KEY = 0x52_4E47
CYCLES = 84
"""Number of clock cycles that the generator needs for a new random word (SAM3X datasheet, 41.1)."""
DATRDY = 1


class Trng(Peripheral):
    """Returns the words of a seeded generator.

    Resets do not restart the generator, so each boot gets other words.
    """

    status = "ISR"

    def __init__(self, machine: Machine, seed: int) -> None:
        super().__init__(machine, "TRNG")
        self._rng = np.random.default_rng((seed, 0x7216))
        self._alarm = Alarm(machine, self._ready)

    def reset(self) -> None:
        """Switch the generator off."""
        self._alarm.cancel()
        super().reset()
        self.settle_irq()

    def on_read(self, register: str) -> int:
        """Read a register. A read of ISR clears its flag DATRDY (a new word is ready).

        A random word may be read only after DATRDY was seen.
        """
        value = self.registers[register]
        if register == "ISR":
            self.registers["ISR"] = 0
            self.settle_irq()
        elif register == "ODATA":
            if not value:
                self.machine.fault("TRNG_ODATA is read when no new word is there: wait for TRNG_ISR.DATRDY")
            self.registers["ODATA"] = 0
            if not self._alarm.is_set:
                self._next()
        return value

    def on_write(self, register: str, value: int) -> None:
        """Write a register. The control register CR accepts only values that contain the key."""
        if register == "CR":
            if value >> 8 != KEY:
                self.machine.fault(f"TRNG_CR = 0x{value:08X} without its key 0x524E47: the chip ignores it")
            self._alarm.cancel()
            if value & 1:
                self._next()
        else:
            super().on_write(register, value)

    def _next(self) -> None:
        self._alarm.set(CYCLES * PS_PER_S // self.machine.mck_hz)

    def _ready(self) -> None:
        # The word is never 0, because 0 means "no word yet" here; the real generator can return 0.
        self.registers["ODATA"] = int(self._rng.integers(1, 1 << 32))
        self.registers["ISR"] = DATRDY
        self.settle_irq()
        # The real generator replaces a word that was not read. Here the next word is generated only when a
        # word is read.
