"""The emulated Cortex-M3 processor. The library Unicorn runs its instructions.

This module adds exceptions and sleep. It also ends the run if the program does what the real chip does not
tolerate.

Unicorn has no NVIC, so exceptions are entered and left by this code (ARMv7-M Architecture Reference Manual,
B1.5). The program runs in slices (`execution`) that end where an exception is entered or left, or the
processor sleeps. Every instruction takes one cycle, and an access to a peripheral takes a few cycles. These
durations give the program a clock. A real processor has another speed.
"""

from collections.abc import Callable
from typing import Any

import unicorn

from tools.due_emulator import system_control
from tools.due_emulator.bus import PERIPHERALS_BASE, PERIPHERALS_BYTES, Bus
from tools.due_emulator.cortex_m3 import BASEPRI, LR, PC, PRIMASK, SP, THUMB, fresh_processor
from tools.due_emulator.exceptions import Exceptions
from tools.due_emulator.execution import NO_INTERRUPT, NOWHERE, REASONS, STOPS, Execution
from tools.due_emulator.machine import Machine
from tools.due_emulator.memory_map import Memory
from tools.due_emulator.nvic import Nvic
from tools.due_emulator.system_control import SystemControl

SLICE_INSTRUCTIONS = 50_000
"""Largest number of instructions between two checks for signals; they take about 1 ms of real time."""

EXCEPTION_EXIT = 8
SPACES = {PERIPHERALS_BASE: PERIPHERALS_BYTES, system_control.BASE: system_control.BYTES}
"""Base address and size of each range of peripherals."""
WFI, WFE, YIELD = b"\x30\xbf", b"\x20\xbf", b"\x10\xbf"


# Why more than 12 attributes: it connects the emulated processor to all parts of the chip that can stop it.
class Cpu:
    """Runs the program in virtual time."""

    def __init__(
        self, machine: Machine, memory: Memory, bus: Bus, nvic: Nvic, control: SystemControl
    ) -> None:
        self._machine = machine
        self._memory = memory
        self._nvic = nvic
        self._control = control
        self._bus = bus
        self.instructions = 0
        """Number of instructions that ran before the present slice (see `execution`)."""
        self._execution = Execution(
            memory.flash,
            machine.quick_reads,
            on_read=self._on_read,
            on_write=self._on_write,
            on_events=self._on_events,
            on_limit=self._on_limit,
        )
        self._exceptions = Exceptions(machine, nvic, control, self._execution)
        self._on_block: Callable[[int, int], None] | None = None
        self._on_breakpoint: Callable[[], None] = lambda: None
        self._has_hung = False
        self._watch_hook: int | None = None
        self._restart = True
        self._halted_until_ps = 0
        self._handed_over: tuple[int, ...] | None = None
        """The machine's state that was last passed to `execution`; None if it must be passed in any case."""
        self._pc = 0
        machine.where = lambda: f"at PC 0x{self._pc:08X}"

    @property
    def pc(self) -> int:
        """Address of the instruction that runs now or next."""
        return self._pc

    @property
    def return_address(self) -> int:
        """Return address of the function that was just called."""
        return self._execution.register(LR) & ~THUMB

    @property
    def active_exceptions(self) -> int:
        """Number of exceptions whose handler has not returned."""
        return len(self._nvic.active)

    def watch(self, on_block: Callable[[int, int], None] | None) -> None:
        """Call `on_block` at each block of code.

        The arguments of `on_block` are the block's address and the number of instructions so far. If
        `on_block` is None, the calls stop.
        """
        self._on_block = on_block
        if not self._restart:
            self._hook_watcher()

    def breakpoint(self, address: int | None, action: Callable[[], None] = lambda: None) -> None:
        """Call `action` whenever the instruction at `address` is about to run.

        The action may let the program hang at this instruction (`hang`), set another breakpoint, or write to
        memory. If `address` is None, the breakpoint is removed.
        """
        self._execution.breakpoint, self._on_breakpoint = address if address is not None else NOWHERE, action
        self._settle_speed()

    def _at_breakpoint(self) -> None:
        """Call the breakpoint's action.

        If the action lets the program hang, the instruction is reached again when the hang ends; the action
        is not called then.
        """
        if not self._has_hung:
            self._on_breakpoint()
        self._has_hung = not self._has_hung and self._halted_until_ps > self._machine.now_ps

    def watch_data(self, address: int, kind: int, on_use: Callable[[int], None]) -> None:
        """Call `on_use` whenever an instruction uses a word of RAM, with that instruction's address.

        `kind`: UC_HOOK_MEM_READ or UC_HOOK_MEM_WRITE of Unicorn. The calls end at the next reset.
        """
        self._uc.hook_add(kind, lambda *_: on_use(self._execution.address), begin=address, end=address + 3)
        # With a breakpoint set, Unicorn runs instruction by instruction (execution.cpp), so that the address
        # is exact.
        self.breakpoint(0)
        self._uc.ctl_flush_tb()

    @property
    def masked(self) -> bool:
        """Whether the register PRIMASK disables interrupts."""
        return bool(self._execution.register(PRIMASK) & 1)

    def restart(self, hold_ps: int = 0) -> None:
        """Hold the processor in reset for `hold_ps`, then start the program from the reset vector."""
        self._restart = True
        self._machine.asleep = False
        self._halted_until_ps = self._machine.now_ps + hold_ps

    def hang(self, for_ps: int) -> None:
        """Run no instruction for a time [ps]. Unlike in sleep, interrupts do not end this state."""
        self._halted_until_ps = self._machine.now_ps + for_ps

    def run_until(self, at_ps: int) -> None:
        """Run the program until a point in virtual time.

        Raises:
            EmulationFault: the program did what the real chip does not tolerate.
            KeyboardInterrupt: the machine was interrupted.
        """
        machine = self._machine
        while machine.now_ps < at_ps:
            machine.check_interrupted()
            if machine.now_ps < self._halted_until_ps:
                machine.advance_to(min(machine.next_event_ps, self._halted_until_ps, at_ps))
                continue
            if self._restart:
                self._begin()
            urgent = self._urgent()
            if machine.asleep and urgent is None:
                machine.advance_to(min(machine.next_event_ps, at_ps))
                continue
            machine.asleep = False
            masked = urgent is not None and self._execution.register(PRIMASK) & 1
            if urgent is not None and not masked:
                self._event_register = True
                self._pc = self._exceptions.enter(urgent)
                self._execution.forget_reads()
            # While the register PRIMASK holds an interrupt back, the program runs in slices of one
            # instruction: it may enable interrupts for as little as two instructions, and this must be
            # noticed.
            self._run_slice(at_ps, 1 if masked else SLICE_INSTRUCTIONS)

    def _urgent(self) -> int | None:
        nvic = self._nvic
        if not nvic.pending & nvic.enabled:
            return None
        return nvic.urgent(self._execution.register(BASEPRI))

    def _begin(self) -> None:
        """Reset the processor: create new Unicorn instances on the same memory."""
        self._restart = False
        self._raised: BaseException | None = None
        self._event_register = False
        self._invalid_address: int | None = None
        uc, fast = fresh_processor(self._memory), fresh_processor(self._memory)
        self._uc = uc
        self._exceptions.attach(uc)
        self._execution.attach(uc, fast, SPACES)
        self._watch_hook = None
        self._hook_watcher()
        uc.hook_add(unicorn.UC_HOOK_MEM_INVALID, self._on_invalid)
        stack, entry = self._exceptions.vector(0), self._exceptions.vector(1)
        self._pc = entry & ~THUMB
        if not entry & THUMB:
            self._machine.fault(
                f"the reset vector 0x{entry:08X} is not that of Thumb code: no image in flash?"
            )
        uc.reg_write(SP, stack & ~3)
        uc.reg_write(LR, 0xFFFF_FFFF)

    def _hook_watcher(self) -> None:
        if self._watch_hook is not None:
            self._uc.hook_del(self._watch_hook)
            self._watch_hook = None
        if (on_block := self._on_block) is not None:
            self._watch_hook = self._uc.hook_add(
                unicorn.UC_HOOK_BLOCK,
                lambda _uc, address, _size, _: on_block(address, self.instructions + self._execution.done),
            )
        self._settle_speed()
        # Discard Unicorn's translated code, because it still calls the hooks that existed when it was
        # translated.
        self._uc.ctl_flush_tb()

    def _settle_speed(self) -> None:
        self._execution.may_be_fast = self._on_block is None and self._execution.breakpoint == NOWHERE

    def _run_slice(self, until_ps: int, longest: int) -> None:
        machine, slice_ = self._machine, self._execution
        slice_.begin(machine.now_ps, machine.mck_hz, until_ps, longest)
        self._handed_over = None
        self._hand_over()
        error = slice_.run(self._pc)
        self._pc = self._execution.register(PC)
        if self._raised is not None:
            raise self._raised
        done = slice_.done - (error != unicorn.UC_ERR_OK and self._pc == slice_.address)
        machine.advance_to(slice_.time_after(done))
        self.instructions += done
        slice_.done = 0
        if slice_.refusal:
            machine.fault(slice_.describe_refusal())
        # Unicorn reports WFE (wait for event) and YIELD as undefined instructions after it has run them.
        if error != unicorn.UC_ERR_OK and not (self._has_just_done(WFE) or self._has_just_done(YIELD)):
            reason = REASONS.get(error, str(unicorn.UcError(error)))
            place = "" if self._invalid_address is None else f": 0x{self._invalid_address:08X}"
            machine.fault(reason + place)
        if slice_.interrupt == EXCEPTION_EXIT:
            self._event_register = True
            self._pc = self._exceptions.leave(self._pc)
        elif slice_.interrupt != NO_INTERRUPT:
            number = slice_.interrupt
            machine.fault(STOPS.get(number, f"exception {number} of the processor: not modelled"))
        elif self._has_just_done(WFI):
            machine.asleep = True
        elif self._has_just_done(WFE):
            machine.asleep, self._event_register = not self._event_register, False

    def _has_just_done(self, instruction: bytes) -> bool:
        """Return whether this instruction was the last one before the run of instructions (slice) ended."""
        last = self._execution.address
        return self._pc == last + 2 and self._memory.read(last, 2) == instruction

    # Callbacks while instructions run. No Python exception may leave them, since native code calls them.

    def _on_invalid(
        self, _uc: unicorn.Uc, _access: int, address: int, _size: int, _value: int, _: Any
    ) -> bool:
        self._invalid_address = address
        return False

    def _on_read(self, now_ps: int, address: int, size: int) -> int:
        try:
            if self._drops_access(now_ps):
                return 0
            return (self._bus if address < system_control.BASE else self._control).read(address, size)
        except BaseException as raised:
            return self._die(raised)
        finally:
            self._hand_over()

    def _on_write(self, now_ps: int, address: int, size: int, value: int) -> None:
        try:
            if not self._drops_access(now_ps):
                (self._bus if address < system_control.BASE else self._control).write(address, size, value)
        except BaseException as raised:
            self._die(raised)
        self._hand_over()

    def _drops_access(self, now_ps: int) -> bool:
        """Advance time to the moment of an access. Return whether a reset came before it."""
        self._pc = self._execution.address
        self._machine.advance_to(now_ps)
        if self._restart:
            self._execution.dropped = True
        return self._restart

    def _on_events(self, now_ps: int) -> None:
        self._pc = self._execution.address
        try:
            self._machine.advance_to(now_ps)
        except BaseException as raised:
            self._die(raised)
        self._hand_over()

    def _on_limit(self, now_ps: int, pc: int) -> None:
        """Process events that are due before the next instruction.

        After the events the program runs on, unless an event ends the present slice.
        """
        machine, slice_ = self._machine, self._execution
        self._pc = pc
        try:
            machine.advance_to(now_ps)
            self.instructions += slice_.done
            slice_.begin_again(now_ps)
            machine.check_interrupted()
            if pc == slice_.breakpoint:
                self._at_breakpoint()
        except KeyboardInterrupt:
            slice_.until_ps = 0
        except BaseException as raised:
            self._die(raised)
        self._hand_over()

    def _die(self, raised: BaseException) -> int:
        self._raised = raised
        self._execution.dead = True
        return 0

    def _hand_over(self) -> None:
        """Pass the machine's state to `execution`, which runs the instructions.

        This method is called after everything that may have changed the machine's state.
        """
        machine, nvic, slice_ = self._machine, self._nvic, self._execution
        slice_.next_event_ps = machine.next_event_ps
        waiting = nvic.pending & nvic.enabled
        traps = self._control.traps_division
        state = (waiting, self._restart, self._halted_until_ps, machine.mck_hz, machine.clocked, traps)
        if waiting or state != self._handed_over:
            self._handed_over = state
            slice_.waiting = waiting != 0
            slice_.halted_until_ps = self._halted_until_ps
            machine.quick_reads.clocked = machine.clocked
            is_urgent = waiting != 0 and self._urgent() is not None
            slice_.traps_division = traps
            slice_.stops = self._restart or machine.mck_hz != slice_.hz or is_urgent
