"""Virtual time, and the wires between the parts of the emulated board.

Parts know only the machine. It knows neither the processor nor the board: it runs without them, in tests too.
"""

import heapq
from collections.abc import Callable
from typing import NoReturn

from tools.due_emulator.quick_reads import QuickReads

PS_PER_S = 1_000_000_000_000
PS_PER_US = 1_000_000
NEVER_PS = 1 << 100

SLOW_CLOCK_HZ = 32_768
"""SLCK; the internal RC oscillator of the real chip is far from exact [Hz]."""
MCK_AT_RESET_HZ = 4_000_000
"""The fast RC oscillator, which the chip starts with [Hz]."""


class EmulationFault(Exception):
    """The program did what the real chip does not forgive, or would forgive only by luck."""

    def __init__(self, reason: str) -> None:
        super().__init__(reason)
        self.reason = reason


class Event:
    """Something that happens at a moment of virtual time."""

    __slots__ = ("action", "at_ps")

    def __init__(self, at_ps: int, action: Callable[[], None]) -> None:
        self.at_ps = at_ps
        self.action: Callable[[], None] | None = action

    def cancel(self) -> None:
        """Let it not happen; without effect once it has."""
        self.action = None


class Alarm:
    """Something that happens once, in a while; setting it anew takes back what was set before."""

    def __init__(self, machine: "Machine", action: Callable[[], None]) -> None:
        self._machine, self._action = machine, action
        self._event: Event | None = None

    @property
    def is_set(self) -> bool:
        """Whether it is still to come."""
        return self._event is not None

    def set(self, delay_ps: int) -> None:
        """Let it happen in `delay_ps`."""
        self.cancel()
        self._event = self._machine.schedule(delay_ps, self._happen)

    def cancel(self) -> None:
        """Let it not happen."""
        if self._event is not None:
            self._event.cancel()
            self._event = None

    def _happen(self) -> None:
        self._event = None
        self._action()


class Machine:
    """Virtual time in picoseconds, the master clock, interrupt lines and the clocks of peripherals.

    Events of one moment happen in the order in which they were scheduled: two runs are equal.
    """

    def __init__(self) -> None:
        self.mck_hz = MCK_AT_RESET_HZ
        self.clocked = 0
        """Bit i: the clock of the peripheral with identifier i is on (PMC_PCSR0, PMC_PCSR1)."""
        self.quick_reads = QuickReads()
        """Registers that a program reads without their peripheral."""
        self.on_irq: Callable[[int, bool], None] = lambda irq, level: None
        """Where interrupt lines end; the board puts the NVIC here."""
        self.on_clock_change: list[Callable[[], None]] = []
        """Called after `mck_hz` has changed, for what counts its cycles."""
        self.asleep = False
        """Whether the processor sleeps."""
        self.idle_ps = 0
        """Time that the processor has slept, part of `now_ps` [ps]."""
        self.where: Callable[[], str] = lambda: ""
        """Says for a fault what the processor was doing, for example "at PC 0x00080123"."""
        self.interrupted = False
        """Whether a signal asks the program to end; who waits or runs looks at it often."""
        self._now_ps = 0
        self._heap: list[tuple[int, int, Event]] = []
        self._scheduled = 0

    def check_interrupted(self) -> None:
        """Raise KeyboardInterrupt if a signal asks the program to end."""
        if self.interrupted:
            raise KeyboardInterrupt

    @property
    def now_ps(self) -> int:
        """Virtual time since power-up [ps]."""
        return self._now_ps

    def schedule(self, delay_ps: int, action: Callable[[], None]) -> Event:
        """Let `action` happen in `delay_ps`, and return the means to cancel it."""
        at_ps = self._now_ps + delay_ps if delay_ps > 0 else self._now_ps
        event = Event(at_ps, action)
        self._scheduled += 1
        heapq.heappush(self._heap, (at_ps, self._scheduled, event))
        return event

    @property
    def next_event_ps(self) -> int:
        """Moment of the next event; NEVER_PS if there is none."""
        heap = self._heap
        while heap and heap[0][2].action is None:
            heapq.heappop(heap)
        return heap[0][0] if heap else NEVER_PS

    def advance_to(self, to_ps: int) -> None:
        """Let time pass up to `to_ps`; the events on the way happen, each at its own moment."""
        heap = self._heap
        while heap and heap[0][0] <= to_ps:
            at_ps, _, event = heapq.heappop(heap)
            action = event.action
            if action is not None:
                self._pass(at_ps)
                event.action = None
                action()
        self._pass(to_ps)

    def _pass(self, to_ps: int) -> None:
        if to_ps > self._now_ps:
            if self.asleep:
                self.idle_ps += to_ps - self._now_ps
            self._now_ps = to_ps

    def advance(self, by_ps: int) -> None:
        """Let `by_ps` pass."""
        self.advance_to(self.now_ps + by_ps)

    def set_mck(self, mck_hz: int) -> None:
        """Change the master clock and tell whoever counts its cycles."""
        if mck_hz != self.mck_hz:
            self.mck_hz = mck_hz
            for tell in self.on_clock_change:
                tell()

    def set_irq(self, irq: int, level: bool) -> None:
        """Set the interrupt line of a peripheral; it is level-sensitive and may be set again and again."""
        self.on_irq(irq, level)

    def clock_on(self, irq: int) -> bool:
        """Whether PMC feeds the peripheral with this identifier (its interrupt number)."""
        return bool(self.clocked >> irq & 1)

    def fault(self, reason: str) -> NoReturn:
        """End the run.

        Raises:
            EmulationFault: always; with the reason, the place in the program and the moment.
        """
        place = self.where()
        raise EmulationFault(f"{reason} ({place + ', ' if place else ''}{self.now_ps / PS_PER_S:.6f} s)")
