"""Virtual time, and the connections between the parts of the emulated board.

The parts refer only to the machine. The machine refers neither to the processor nor to the board, so tests
can use it without them.
"""

from collections.abc import Callable
from heapq import heappop, heappush
from typing import NoReturn

from tools.due_emulator.quick_reads import QuickReads

PS_PER_S = 1_000_000_000_000
PS_PER_US = 1_000_000
NEVER_PS = 1 << 62

SLOW_CLOCK_HZ = 32_768
"""Frequency of the slow clock SLCK [Hz]; on the real chip, the internal RC oscillator is far from exact."""
MCK_AT_RESET_HZ = 4_000_000
"""Frequency of the fast RC oscillator, with which the chip starts [Hz]."""


class EmulationFault(Exception):
    """The program did what the real chip does not tolerate, or tolerates only by luck."""

    def __init__(self, reason: str) -> None:
        super().__init__(reason)
        self.reason = reason


class Alarm:
    """A timer for one action. After `set`, the action happens once.

    A new call of `set` replaces the earlier one.
    """

    __slots__ = ("_machine", "action", "number")

    def __init__(self, machine: "Machine", action: Callable[[], None]) -> None:
        self._machine, self.action = machine, action
        self.number = 0
        """Serial number of the latest call of `set`; 0 if the action has happened or was cancelled, or `set`
        was not called.
        """

    @property
    def is_set(self) -> bool:
        """Whether the action is still to come."""
        return self.number != 0

    def set(self, delay_ps: int, *, quiet: bool = False) -> None:
        """Let the action happen in `delay_ps`. `quiet`: the program is not stopped for it (see `Machine`)."""
        self.number = self._machine.note(delay_ps, self, quiet)

    def cancel(self) -> None:
        """Cancel the action. A call after the action has happened has no effect."""
        self.number = 0


# Why more than 12 attributes: each is one signal that all parts of the chip share.
class Machine:
    """Virtual time in picoseconds, the master clock, interrupt requests and the clocks of peripherals.

    Events at the same moment happen in the order in which they were scheduled, so two runs are equal.

    The program is not stopped for a quiet event. When the event is processed, the program may already have
    run further: up to its next access to a peripheral, or to the next event that is not quiet. Even so,
    `now_ps` is the event's own time while its action runs.
    """

    def __init__(self) -> None:
        self.mck_hz = MCK_AT_RESET_HZ
        self.clocked = 0
        """Bit i: the clock of the peripheral with identifier i is on (PMC_PCSR0, PMC_PCSR1)."""
        self.quick_reads = QuickReads()
        """Registers that `execution.cpp` can read without calling the peripheral's Python code."""
        self.on_irq: Callable[[int, bool], None] = lambda irq, level: None
        """Function that receives changes of interrupt requests; the board sets it to a function of the NVIC.
        """
        self.on_clock_change: list[Callable[[], None]] = []
        """Functions that are called after the master clock `mck_hz` has changed, so that all parts that count
        its cycles notice.
        """
        self.asleep = False
        """Whether the processor sleeps."""
        self.idle_ps = 0
        """Total time for which the processor has slept [ps]."""
        self.where: Callable[[], str] = lambda: ""
        """Function that returns where the program is, for the text of a fault, such as "at PC 0x00080123"."""
        self.interrupted = False
        """Whether a signal has asked the emulator to end. All code that waits or runs for a long time checks
        this value often.
        """
        self.now_ps = 0
        """Virtual time since power-up [ps]."""
        self._heap: list[tuple[int, int, Alarm]] = []
        self._quiet: list[tuple[int, int, Alarm]] = []
        self._scheduled = 0

    def check_interrupted(self) -> None:
        """Raise KeyboardInterrupt if a signal has asked the emulator to end."""
        if self.interrupted:
            raise KeyboardInterrupt

    def schedule(self, delay_ps: int, action: Callable[[], None]) -> Alarm:
        """Let `action` happen in `delay_ps`; return the alarm, which can be cancelled."""
        alarm = Alarm(self, action)
        alarm.set(delay_ps)
        return alarm

    def note(self, delay_ps: int, alarm: Alarm, quiet: bool) -> int:
        """Schedule an alarm; return a serial number that identifies this scheduling."""
        self._scheduled = number = self._scheduled + 1
        at_ps = self.now_ps + delay_ps if delay_ps > 0 else self.now_ps
        heappush(self._quiet if quiet else self._heap, (at_ps, number, alarm))
        return number

    @property
    def next_event_ps(self) -> int:
        """Time of the next event for which the program must be stopped; NEVER_PS if there is none."""
        heap = self._heap
        while heap:
            at_ps, number, alarm = heap[0]
            if alarm.number == number:
                return at_ps
            heappop(heap)
        return NEVER_PS

    def advance_to(self, to_ps: int) -> None:
        """Advance time to `to_ps`. Each event until then happens at its own time."""
        heap, quiet = self._heap, self._quiet
        while True:
            first = quiet if quiet and not (heap and heap[0] < quiet[0]) else heap
            if not first or first[0][0] > to_ps:
                break
            at_ps, number, alarm = heappop(first)
            if alarm.number == number:
                if at_ps > self.now_ps:
                    self._pass(at_ps)
                alarm.number = 0
                alarm.action()
        if to_ps > self.now_ps:
            self._pass(to_ps)

    def _pass(self, to_ps: int) -> None:
        if self.asleep:
            self.idle_ps += to_ps - self.now_ps
        self.now_ps = to_ps

    def advance(self, by_ps: int) -> None:
        """Advance time by `by_ps`."""
        self.advance_to(self.now_ps + by_ps)

    def set_mck(self, mck_hz: int) -> None:
        """Change the master clock and notify the parts that count its cycles."""
        if mck_hz != self.mck_hz:
            self.mck_hz = mck_hz
            for tell in self.on_clock_change:
                tell()

    def set_irq(self, irq: int, level: bool) -> None:
        """Set or clear the interrupt request of a peripheral.

        The request is level-sensitive, and may be set to the same level again.
        """
        self.on_irq(irq, level)

    def clock_on(self, irq: int) -> bool:
        """Return whether the clock of the peripheral with this identifier (its interrupt number) is on."""
        return bool(self.clocked >> irq & 1)

    def fault(self, reason: str) -> NoReturn:
        """End the run.

        Raises:
            EmulationFault: always; its text has the reason, the address in the program and the virtual time.
        """
        place = self.where()
        raise EmulationFault(f"{reason} ({place + ', ' if place else ''}{self.now_ps / PS_PER_S:.6f} s)")
