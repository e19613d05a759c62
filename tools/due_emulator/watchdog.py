"""The watchdog timer of the SAM3X (datasheet, chapter 15).

After a reset the watchdog is on, with a time-out of 16 s, and its mode register can be written once.
"""

from collections.abc import Callable

from tools.due_emulator.machine import PS_PER_S, SLOW_CLOCK_HZ, Alarm, Machine
from tools.due_emulator.peripheral import Peripheral

KEY = 0xA5
DIVIDER = 128
IRQ = 4
WDUNF, WDERR = 1, 2


class Watchdog(Peripheral):
    """Calls `bite`, which resets the board, when the program has not fed the watchdog in time.

    The watchdog does not count while the processor sleeps if the mode bit WDIDLEHLT is set, as it is after a
    reset.
    """

    def __init__(self, machine: Machine, bite: Callable[[], None]) -> None:
        super().__init__(machine, "WDT")
        self._bite = bite
        self._alarm = Alarm(machine, self._look)
        self._fed_ps = 0
        self._written = False
        self._feed()

    def reset(self) -> None:
        """Reset the watchdog, which switches it on with the longest time-out."""
        super().reset()
        self._written = False
        self.machine.set_irq(IRQ, False)
        self._feed()

    @property
    def period_ps(self) -> int:
        """Time within which the watchdog must be fed [ps]."""
        return self.field("MR", "WDV") * DIVIDER * PS_PER_S // SLOW_CLOCK_HZ

    def on_read(self, register: str) -> int:
        """Read a register; a read of the status register SR clears its flags."""
        value = self.registers[register]
        if register == "SR":
            self.registers["SR"] = 0
            self.machine.set_irq(IRQ, False)
        return value

    def on_write(self, register: str, value: int) -> None:
        """Write a register: CR feeds the watchdog; the mode register MR may be written once after a reset."""
        if register == "CR":
            if value >> 24 != KEY or not value & 1:
                self.machine.fault(f"WDT_CR = 0x{value:08X}: to feed the watchdog write 0xA5000001")
            if not self.field("MR", "WDDIS"):
                self._restart()
            return
        if self._written:
            self.machine.fault(f"WDT_MR = 0x{value:08X}: a second write; the chip accepts a write only once")
        self._written = True
        self.registers["MR"] = value
        if not self.field("MR", "WDDIS") and not self.period_ps:
            self.machine.fault(f"WDT_MR = 0x{value:08X}: WDV = 0 leaves no time to feed the watchdog")
        self._feed()

    def _restart(self) -> None:
        left_ps = self.period_ps - (self._clock_ps() - self._fed_ps)
        window_ps = self.field("MR", "WDD") * DIVIDER * PS_PER_S // SLOW_CLOCK_HZ
        if left_ps > window_ps:
            self._fail(WDERR)
        else:
            self._fed_ps = self._clock_ps()
            # An alarm that is already set is left as it is. It goes off too early now; `_look` then sets it
            # again for the remaining time.
            if not self._alarm.is_set:
                self._wait()

    def _feed(self) -> None:
        self._fed_ps = self._clock_ps()
        self._wait()

    def _wait(self) -> None:
        self._alarm.cancel()
        if not self.field("MR", "WDDIS"):
            self._alarm.set(self.period_ps - (self._clock_ps() - self._fed_ps))

    def _look(self) -> None:
        if self._clock_ps() - self._fed_ps >= self.period_ps:
            self._fail(WDUNF)
        else:
            self._wait()

    def _clock_ps(self) -> int:
        asleep = self.machine.idle_ps if self.field("MR", "WDIDLEHLT") else 0
        return self.machine.now_ps - asleep

    def _fail(self, flag: int) -> None:
        self.registers["SR"] |= flag
        if self.field("MR", "WDFIEN"):
            self.machine.set_irq(IRQ, True)
        if self.field("MR", "WDRSTEN"):
            self._bite()
        else:
            self._feed()
