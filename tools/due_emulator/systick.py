"""SysTick, the processor's own timer (ARMv7-M Architecture Reference Manual, B3.3)."""

from collections.abc import Callable

from tools.due_emulator.cycle_counter import CycleCounter
from tools.due_emulator.machine import Alarm, Machine

ENABLE = 1 << 0
TICKINT = 1 << 1
CLKSOURCE = 1 << 2
COUNTFLAG = 1 << 16
SLOW_DIVIDER = 8
CALIB_10MS_AT_84MHZ = 10_500
"""SysTick's calibration value on this chip: the count for 1 ms at 10.5 MHz, an eighth of 84 MHz (SAM3X
datasheet, 10.22; not checked on a board). The architecture's name for it, TENMS, speaks of 10 ms.
"""


class SysTick:
    """Counts down from LOAD to 0, then starts at LOAD again.

    At each 0, `pend` is called if the flag TICKINT enables the interrupt.
    """

    def __init__(self, machine: Machine, pend: Callable[[], None]) -> None:
        self._machine = machine
        self._pend = pend
        self._control = 0
        self._counter = CycleCounter(machine, self._rate_hz)
        machine.on_clock_change.append(self._on_clock_change)
        self._alarm = Alarm(machine, self._zero)
        self.reset()

    def reset(self) -> None:
        """Return to the state after a reset of the chip."""
        self._control = 0
        self._load = 0
        self._stopped_at = 0
        self._seen_wraps = 0
        self._flag = False
        self._alarm.cancel()

    def _rate_hz(self) -> tuple[int, int]:
        divider = 1 if self._control & CLKSOURCE else SLOW_DIVIDER
        return self._machine.mck_hz, divider

    @property
    def _running(self) -> bool:
        return bool(self._control & ENABLE) and self._load > 0

    def read_control(self) -> int:
        """Read SYST_CSR, the control register. The read clears the flag COUNTFLAG (0 has been reached)."""
        self._settle()
        flag, self._flag = self._flag, False
        return self._control | COUNTFLAG * flag

    def write_control(self, value: int) -> None:
        """Write SYST_CSR, the control register."""
        count = self.read_value()
        self._control = value & (ENABLE | TICKINT | CLKSOURCE)
        self._go_on_from(count)

    def read_load(self) -> int:
        """Read SYST_RVR, the value from which the counter starts again."""
        return self._load

    def write_load(self, value: int) -> None:
        """Write SYST_RVR; the present count continues, and the new value takes effect at the next 0."""
        count = self.read_value()
        self._load = value & 0xFF_FFFF
        self._go_on_from(min(count, self._load))

    def read_value(self) -> int:
        """Read SYST_CVR, the present count."""
        if not self._running:
            return self._stopped_at
        return -self._counter.cycles % (self._load + 1)

    def write_value(self, _: int) -> None:
        """Write SYST_CVR: any value sets the count and the flag COUNTFLAG to 0."""
        self._go_on_from(0)
        self._flag = False

    def _go_on_from(self, count: int) -> None:
        self._settle()
        self._stopped_at = count
        # `_counter` counts up. Whenever SysTick's count is 0, `_counter` is at a multiple of the period.
        self._counter.restart(-count)
        self._seen_wraps = 0 if count == 0 else -1
        self._alarm.cancel()
        if self._running:
            self._schedule()

    def _wraps(self) -> int:
        return self._counter.cycles // (self._load + 1)

    def _settle(self) -> None:
        if self._running and self._wraps() > self._seen_wraps:
            self._seen_wraps = self._wraps()
            self._flag = True

    def _schedule(self) -> None:
        next_zero = (self._wraps() + 1) * (self._load + 1)
        self._alarm.set(self._counter.ps_until(next_zero))

    def _zero(self) -> None:
        self._settle()
        if self._control & TICKINT:
            self._pend()
        self._schedule()

    def _on_clock_change(self) -> None:
        self._counter.rate_changed()
        self._alarm.cancel()
        if self._running:
            self._schedule()
