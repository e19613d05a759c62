"""A count of clock cycles that is computed only when it is read, so that counting takes no time."""

from collections.abc import Callable

from tools.due_emulator.machine import PS_PER_S, Machine
from tools.due_emulator.quick_reads import QuickRegister


class CycleCounter:
    """Counts cycles of a clock from a given time on. The clock's rate may change meanwhile.

    `rate_hz`: function that returns the clock's present rate [Hz] as numerator and denominator.
    """

    def __init__(self, machine: Machine, rate_hz: Callable[[], tuple[int, int]]) -> None:
        self._machine = machine
        self._rate_hz = rate_hz
        self._rate = rate_hz()
        self._from_ps = 0
        self._from_cycles = 0

    def restart(self, cycles: int = 0) -> None:
        """Set the count to `cycles`, and continue at the present rate."""
        self._from_ps = self._machine.now_ps
        self._from_cycles = cycles
        self._rate = self._rate_hz()

    def rate_changed(self) -> None:
        """Continue from the present count at the new rate, because the clock's rate has just changed."""
        if self._rate_hz() != self._rate:
            self.restart(self.cycles)

    @property
    def cycles(self) -> int:
        """Present count in whole cycles."""
        hz, divider = self._rate
        return self._from_cycles + (self._machine.now_ps - self._from_ps) * hz // (PS_PER_S * divider)

    def ps_until(self, cycles: int) -> int:
        """Return the time until the count reaches `cycles` [ps]; 0 if it has reached it."""
        hz, divider = self._rate
        at_ps = self._from_ps - (-(cycles - self._from_cycles) * PS_PER_S * divider // hz)
        return max(0, at_ps - self._machine.now_ps)

    def lay_out(self, register: QuickRegister, period: int) -> None:
        """Let `execution.cpp` read this count from a register without Python.

        When the register's value reaches `period`, it begins at 0 again.
        """
        register.count(self._from_ps, self._from_cycles, self._rate, period)
