"""Entry to exceptions, and return from them, by the emulated processor (ARMv7-M, B1.5)."""

from struct import Struct

import unicorn

from tools.due_emulator.cortex_m3 import CONTROL, ENTERED, FAULTMASK, SP, STACKED, THUMB, UNSTACKED
from tools.due_emulator.execution import Execution
from tools.due_emulator.machine import Machine
from tools.due_emulator.nvic import Nvic, describe_exception
from tools.due_emulator.system_control import SystemControl

RETURN_TO_HANDLER, RETURN_TO_THREAD = 0xFFFF_FFF0, 0xFFFF_FFF8
"""To return, a handler jumps to one of these addresses (EXC_RETURN; here without bit 0): to another handler,
or to the program on the main stack. The address 0xFFFFFFFD, for a program on the process stack, is not
modelled.
"""
FRAME = Struct("<8I")
XPSR_T, XPSR_ALIGNED = 1 << 24, 1 << 9


class Exceptions:
    """Puts frames of exceptions on the program's stack, and takes them from it.

    It ends the run if the program does what the real chip does not tolerate.
    """

    def __init__(self, machine: Machine, nvic: Nvic, control: SystemControl, execution: Execution) -> None:
        self._machine = machine
        self._nvic = nvic
        self._control = control
        self._execution = execution

    def attach(self, uc: unicorn.Uc) -> None:
        """Use this instance of the processor from now on."""
        self._uc = uc

    def vector(self, exception: int) -> int:
        """Return the address of the exception's handler, from the vector table."""
        address = self._control.vector_table + 4 * exception
        try:
            return int.from_bytes(self._uc.mem_read(address, 4), "little")
        except unicorn.UcError:
            self._machine.fault(f"the vector table at 0x{self._control.vector_table:08X} is not in memory")

    def enter(self, exception: int) -> int:
        """Put the frame of an exception on the stack; return the address of its handler."""
        register = self._execution.register
        if register(CONTROL):
            self._machine.fault("the process stack and unprivileged code are not modelled")
        if register(FAULTMASK):
            self._machine.fault("FAULTMASK, which would hold this exception back, is not modelled")
        values = self._execution.registers(STACKED)
        sp = register(SP)
        frame = (sp - FRAME.size) & ~7
        values[-1] |= XPSR_ALIGNED * bool(sp & 4)
        try:
            self._uc.mem_write(frame, FRAME.pack(*values))
        except unicorn.UcError:
            self._machine.fault(f"no room on the stack for an exception: SP 0x{sp:08X}")
        vector = self.vector(exception)
        if not vector & THUMB:
            self._machine.fault(
                f"{describe_exception(exception)} has no handler: its vector is 0x{vector:08X}"
            )
        nested = bool(self._nvic.active)
        self._nvic.enter(exception)
        back = (RETURN_TO_HANDLER if nested else RETURN_TO_THREAD) | 1
        psr = values[-1] & 0xF800_0000 | XPSR_T | exception
        self._execution.set_registers(ENTERED, (frame, back, psr))
        self._execution.heed_psr()
        return vector & ~THUMB

    def leave(self, pc: int) -> int:
        """Take the frame of an exception from the stack; return the address at which the program goes on.

        `pc`: value of PC, which is one of the values of EXC_RETURN.
        """
        active = self._nvic.active
        expected = RETURN_TO_HANDLER if len(active) > 1 else RETURN_TO_THREAD
        if not active or pc != expected:
            self._machine.fault(f"return from an exception to 0x{pc | 1:08X} is not possible here")
        self._nvic.leave()
        frame = self._execution.register(SP)
        *values, back, xpsr = FRAME.unpack(self._uc.mem_read(frame, FRAME.size))
        if (xpsr & 0x1FF) != (active[-1] if active else 0):
            self._machine.fault("the stack of an exception was overwritten: it holds another PSR")
        if not xpsr & XPSR_T:
            self._machine.fault("the stack of an exception holds a PSR without its T bit: no Thumb code")
        sp = frame + FRAME.size + 4 * bool(xpsr & XPSR_ALIGNED)
        self._execution.set_registers(UNSTACKED, (*values, sp, xpsr & ~XPSR_ALIGNED))
        self._execution.heed_psr()
        return back & ~THUMB
