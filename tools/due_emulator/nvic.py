"""The Cortex-M3's interrupts and priorities.

These are its interrupt controller NVIC and the system exceptions (ARMv7-M Architecture Reference Manual, B1.5
and B3.4).
"""

from tools.due_emulator.machine import Machine

SVCALL, PENDSV, SYSTICK = 11, 14, 15
FIRST_IRQ = 16
IRQS = 45
"""Number of interrupts of the ATSAM3X8E (SAM3X datasheet, 9.1)."""
PRIORITY_MASK = 0xF0
"""Mask of the four priority bits that the chip implements."""
LOWEST = 0x100


class Nvic:
    """Pending, active and enabled exceptions, by exception number (16 + interrupt number).

    The request signal of an interrupt makes the interrupt pending when it rises, and again if it is still
    high when the handler returns.
    """

    def __init__(self, machine: Machine) -> None:
        self._machine = machine
        self.reset()

    def reset(self) -> None:
        """Return to the state after a reset of the chip."""
        self.pending = 0
        self.enabled = 1 << PENDSV | 1 << SYSTICK
        self.active: list[int] = []
        self.priority = bytearray(FIRST_IRQ + IRQS)
        self.priority_group = 0
        self._lines = 0

    def set_line(self, irq: int, level: bool) -> None:
        """Raise or lower the request signal of an interrupt."""
        bit = 1 << FIRST_IRQ + irq
        if level and not self._lines & bit:
            self.pending |= bit
        self._lines = self._lines | bit if level else self._lines & ~bit

    def pend(self, exception: int) -> None:
        """Make an exception pending."""
        self.pending |= 1 << exception

    def unpend(self, exception: int) -> None:
        """Clear a pending exception. If its request signal is still high, it is pending again at once."""
        self.pending &= ~(1 << exception) | self._lines

    def group(self, exception: int) -> int:
        """Return the part of the priority that decides about preemption; a smaller value is more urgent."""
        return self.priority[exception] & -(2 << self.priority_group)

    def urgent(self, base_priority: int = 0) -> int | None:
        """Return the pending exception that would be handled now if PRIMASK let interrupts in.

        `base_priority`: the register BASEPRI, which holds back less urgent interrupts; 0 holds back none.
        """
        waiting = self.pending & self.enabled
        if not waiting:
            return None
        best = (waiting & -waiting).bit_length() - 1
        while waiting := waiting & waiting - 1:
            other = (waiting & -waiting).bit_length() - 1
            if self.priority[other] < self.priority[best]:
                best = other
        running = min(map(self.group, self.active), default=LOWEST)
        if base_priority:
            running = min(running, base_priority & -(2 << self.priority_group))
        return best if self.group(best) < running else None

    def enter(self, exception: int) -> None:
        """Make an exception active, because its handler begins."""
        self.pending &= ~(1 << exception)
        self.active.append(exception)

    def leave(self) -> int:
        """End the active exception whose handler returns; return its number."""
        exception = self.active.pop()
        self.pending |= self._lines & 1 << exception
        return exception


def describe_exception(exception: int) -> str:
    """Return the name of an exception, for texts that people read."""
    return f"interrupt {exception - FIRST_IRQ}" if exception >= FIRST_IRQ else f"exception {exception}"
