"""The timers TC0 to TC2, with three 32-bit counters each (SAM3X datasheet, chapter 36).

A counter can count up to its largest value or to the register RC; comparison with RC and its interrupt are
modelled. If a program uses another mode, an input, or the registers RA and RB, the run ends.
"""

from collections.abc import Callable
from functools import partial

from tools.due_emulator.cycle_counter import CycleCounter
from tools.due_emulator.machine import SLOW_CLOCK_HZ, Alarm, Machine
from tools.due_emulator.peripheral import Peripheral

CHANNELS = 3
CLKEN, CLKDIS, SWTRG = 1, 2, 4
COVFS, CPCS, CLKSTA = 1 << 0, 1 << 4, 1 << 16
EVENTS = COVFS | CPCS
DIVIDERS = (2, 8, 32, 128)
SLOW_CLOCK = 4
CPCSTOP, CPCDIS, WAVE = 1 << 6, 1 << 7, 1 << 15
CPCTRG = 1 << 14
UP, UP_TO_RC = 0, 2
FULL = 1 << 32


class Channel:
    """One counter of a timer. Its registers belong to the timer.

    The names of these registers end with the counter's number.
    """

    def __init__(self, timer: "Timer", number: int) -> None:
        self._timer = timer
        self._machine = timer.machine
        self._n = number
        assert timer.table.irq is not None
        self.irq = timer.table.irq + number
        self._counter = CycleCounter(timer.machine, self._rate)
        self._alarm = Alarm(timer.machine, self._mark)
        self._running = False
        self._seen = 0
        register = timer.table.registers[f"CV{number}"]
        self._quick_value = timer.machine.quick_reads.add(timer.table.base + register.offset, self.irq)
        timer.machine.on_clock_change.append(self._on_clock_change)

    def reset(self) -> None:
        """Stop the counter, and set it to 0."""
        self._alarm.cancel()
        self._running = False
        self._counter.restart()
        self._seen = 0
        self._lay_out()
        self.settle_irq()

    @property
    def value(self) -> int:
        """Value of the register CV, the present count."""
        cycles = self._counter.cycles if self._running else 0
        return cycles % self._period

    @property
    def _mode(self) -> int:
        return self._timer.registers[f"CMR{self._n}"]

    @property
    def _to_rc(self) -> bool:
        return bool(self._mode >> 13 & 3 == UP_TO_RC if self._mode & WAVE else self._mode & CPCTRG)

    @property
    def _period(self) -> int:
        return self._timer.registers[f"RC{self._n}"] or FULL if self._to_rc else FULL

    def _rate(self) -> tuple[int, int]:
        source = self._mode & 7
        if source == SLOW_CLOCK:
            return SLOW_CLOCK_HZ, 1
        return self._machine.mck_hz, DIVIDERS[source] if source < SLOW_CLOCK else 1

    def command(self, value: int) -> None:
        """Write CCR, which starts and stops the counter."""
        if value & CLKDIS:
            self._running = False
            self._alarm.cancel()
        elif value & CLKEN:
            self._timer.registers[f"SR{self._n}"] |= CLKSTA
        if value & SWTRG and self._timer.registers[f"SR{self._n}"] & CLKSTA and not value & CLKDIS:
            self._running = True
            self._counter.restart()
            self._seen = 0
            self._schedule()
        if value & CLKDIS:
            self._timer.registers[f"SR{self._n}"] &= ~CLKSTA
        self._lay_out()

    def configure(self, value: int) -> None:
        """Write CMR, the counter's mode."""
        unsupported = value & 0x3F & ~7 or value & 7 > SLOW_CLOCK
        if value & WAVE:
            unsupported = unsupported or value & (CPCSTOP | CPCDIS) or value >> 13 & 3 not in (UP, UP_TO_RC)
        if unsupported:
            self._machine.fault(f"{self._timer.name}_CMR{self._n} = 0x{value:X}: this mode is not modelled")
        self._timer.registers[f"CMR{self._n}"] = value
        self.compare_changed()

    def compare_changed(self) -> None:
        """Apply a change of the register RC or of the mode, without resetting the count."""
        # Restarting the count loses the fraction of a cycle that has passed.
        if self._counter.cycles >= self._period:
            self._counter.restart(self._counter.cycles % self._period)
        self._seen = self._counter.cycles
        self._schedule()
        self._lay_out()

    def read_status(self) -> int:
        """Read SR, the status register. The read clears the events in SR."""
        self._settle()
        value = self._timer.registers[f"SR{self._n}"]
        self._timer.registers[f"SR{self._n}"] = value & ~EVENTS
        self.settle_irq()
        return value

    def settle_irq(self) -> None:
        """Update the counter's interrupt request."""
        r = self._timer.registers
        self._machine.set_irq(self.irq, bool(r[f"SR{self._n}"] & r[f"IMR{self._n}"]))

    def _schedule(self) -> None:
        self._alarm.cancel()
        if self._running:
            self._alarm.set(self._counter.ps_until(self._next_mark()))

    def _next_mark(self) -> int:
        """Return the total count at which the counter next reaches the register RC or the end of its period.

        The total count is not reduced modulo the period.
        """
        cycles, period = self._counter.cycles, self._period
        lap = cycles // period * period
        rc = self._timer.registers[f"RC{self._n}"]
        marks = [lap + period]
        if rc and not self._to_rc:
            marks += [lap + rc, lap + period + rc]
        return min(mark for mark in marks if mark > cycles)

    def _mark(self) -> None:
        self._settle()
        self._schedule()
        self.settle_irq()

    def _settle(self) -> None:
        if not self._running:
            return
        cycles, period = self._counter.cycles, self._period
        rc = self._timer.registers[f"RC{self._n}"]
        if cycles // period > self._seen // period:
            self._timer.registers[f"SR{self._n}"] |= CPCS if self._to_rc else COVFS
        if rc and not self._to_rc and (cycles - rc) // period > (self._seen - rc) // period:
            self._timer.registers[f"SR{self._n}"] |= CPCS
        self._seen = cycles

    def _on_clock_change(self) -> None:
        self._counter.rate_changed()
        self._seen = min(self._seen, self._counter.cycles)
        self._schedule()
        self._lay_out()

    def _lay_out(self) -> None:
        """Update the copy of the count that C++ reads, so that it equals `value`."""
        if self._running:
            self._counter.lay_out(self._quick_value, self._period)
        else:
            self._quick_value.hold(0, 0)


class Timer(Peripheral):
    """A timer of three counters (channels). Each has an identifier and a clock of its own."""

    def __init__(self, machine: Machine, name: str) -> None:
        super().__init__(machine, name)
        self.channels = [Channel(self, n) for n in range(CHANNELS)]
        self._actions: dict[str, Callable[[int], None]] = {}
        for n, channel in enumerate(self.channels):
            self._actions |= {
                f"CCR{n}": channel.command,
                f"CMR{n}": channel.configure,
                f"RC{n}": partial(self._set_compare, channel, f"RC{n}"),
                f"IER{n}": partial(self._enable, channel, n, True),
                f"IDR{n}": partial(self._enable, channel, n, False),
                f"SMMR{n}": partial(self._refuse_unless_zero, f"SMMR{n}"),
            }

    def reset(self) -> None:
        """Stop all counters, and set them to 0."""
        super().reset()
        for channel in self.channels:
            channel.reset()

    def clock_id(self, register: str) -> int | None:
        """Return the identifier of the clock that a register needs.

        A register of a channel needs the channel's clock. A register of the whole timer needs the first
        channel's clock.
        """
        assert self.table.irq is not None
        return self.table.irq + (int(register[-1]) if register[-1].isdigit() else 0)

    def on_read(self, register: str) -> int:
        """Read a register. A read of CV returns the present count; a read of SR clears its events."""
        channel = self.channels[int(register[-1])] if register[-1].isdigit() else None
        if channel is not None and register.startswith("CV"):
            return channel.value
        if channel is not None and register.startswith("SR"):
            return channel.read_status()
        return self.registers[register]

    def on_write(self, register: str, value: int) -> None:
        """Write a register: a command, a mode or the compare value."""
        action = self._actions.get(register)
        if action is not None:
            action(value)
        elif register in ("BCR", "BMR", "QIER", "FMR", "WPMR") and value:
            self.machine.fault(f"{self.name}_{register} = 0x{value:X}: not modelled")
        else:
            self.registers[register] = value

    def _set_compare(self, channel: Channel, register: str, value: int) -> None:
        self.registers[register] = value
        channel.compare_changed()

    def _enable(self, channel: Channel, n: int, on: bool, value: int) -> None:
        if on and value & ~EVENTS:
            self.machine.fault(f"{self.name}_IER{n} = 0x{value:X}: only COVFS and CPCS are modelled")
        mask = self.registers[f"IMR{n}"]
        self.registers[f"IMR{n}"] = mask | value if on else mask & ~value
        channel.settle_irq()

    def _refuse_unless_zero(self, register: str, value: int) -> None:
        if value:
            self.machine.fault(f"{self.name}_{register} = 0x{value:X}: not modelled")
