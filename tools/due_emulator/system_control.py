"""The System Control Space at 0xE000E000: registers of SysTick, NVIC and SCB.

SysTick is the processor's timer, NVIC its interrupt controller, SCB the rest (ARMv7-M Architecture Reference
Manual, B3).
"""

from collections.abc import Callable
from typing import NamedTuple

from tools.due_emulator.machine import Machine
from tools.due_emulator.nvic import FIRST_IRQ, IRQS, PENDSV, PRIORITY_MASK, SYSTICK, Nvic
from tools.due_emulator.systick import CALIB_10MS_AT_84MHZ, SysTick

BASE = 0xE000_E000
BYTES = 0x1000
CPUID_CORTEX_M3_R2P0 = 0x412F_C230
VECTKEY, VECTKEY_READ = 0x05FA, 0xFA05
SYSRESETREQ = 1 << 2
CCR_STKALIGN = 1 << 9
CCR_DIV_0_TRP = 1 << 4
ALLOWED_CCR = CCR_STKALIGN | CCR_DIV_0_TRP
SEVONPEND, SLEEPDEEP, SLEEPONEXIT = 1 << 4, 1 << 2, 1 << 1


class Word(NamedTuple):
    """One register with a function for reads and one for writes; None if that access is not permitted."""

    name: str
    read: Callable[[], int] | None
    write: Callable[[int], None] | None


class SystemControl:
    """The system registers.

    An access to a register that is not listed here, such as one for memory protection, ends the run.
    """

    def __init__(self, machine: Machine, nvic: Nvic, system_reset: Callable[[], None]) -> None:
        self._machine = machine
        self._nvic = nvic
        self._system_reset = system_reset
        self.systick = SysTick(machine, lambda: nvic.pend(SYSTICK))
        self.reset()
        self._words = self._timer() | self._interrupts() | self._control_block()

    def reset(self) -> None:
        """Return to the state after a reset of the chip."""
        self.vector_table = 0
        self._scr = 0
        self._ccr = CCR_STKALIGN
        self.systick.reset()
        self._nvic.reset()

    @property
    def traps_division(self) -> bool:
        """Whether a division by 0 is a fault."""
        return bool(self._ccr & CCR_DIV_0_TRP)

    def read(self, address: int, size: int) -> int:
        """Read `size` bytes as a program does."""
        if (priority := self._priority_bytes(address, size)) is not None:
            return int.from_bytes(priority, "little")
        word = self._find(address, size, "read")
        if word.read is None:
            self._machine.fault(f"read of {word.name}, which cannot be read")
        return word.read()

    def write(self, address: int, size: int, value: int) -> None:
        """Write `size` bytes as a program does."""
        if self._priority_bytes(address, size) is not None:
            first = self._exception_at(address)
            for i in range(size):
                self._nvic.priority[first + i] = value >> 8 * i & PRIORITY_MASK
            return
        word = self._find(address, size, "write")
        if word.write is None:
            self._machine.fault(f"write of 0x{value:X} to {word.name}, which cannot be written")
        word.write(value)

    def _find(self, address: int, size: int, verb: str) -> Word:
        word = self._words.get(address - BASE)
        if word is None or size != 4:
            self._machine.fault(f"{verb} of {size} byte(s) at 0x{address:08X}: not modelled in the processor")
        return word

    def _exception_at(self, address: int) -> int:
        return address - BASE - 0x400 + FIRST_IRQ if address < BASE + 0xD00 else address - BASE - 0xD18 + 4

    def _priority_bytes(self, address: int, size: int) -> bytes | None:
        """Return the interrupt priorities from an address on; None if the address is not one of a priority.

        Only priorities may be accessed by single bytes.
        """
        offset = address - BASE
        if 0xD18 <= offset < 0xD24 or 0x400 <= offset < 0x400 + IRQS // 4 * 4 + 4:
            first = self._exception_at(address)
            return bytes(self._nvic.priority[first : first + size]).ljust(size, b"\0")
        return None

    def _timer(self) -> dict[int, Word]:
        s = self.systick
        return {
            0x010: Word("SYST_CSR", s.read_control, s.write_control),
            0x014: Word("SYST_RVR", s.read_load, s.write_load),
            0x018: Word("SYST_CVR", s.read_value, s.write_value),
            0x01C: Word("SYST_CALIB", lambda: CALIB_10MS_AT_84MHZ, None),
        }

    def _interrupts(self) -> dict[int, Word]:
        n = self._nvic
        words: dict[int, Word] = {0x004: Word("ICTR", lambda: (IRQS - 1) // 32, None)}

        def enable(bits: int) -> None:
            n.enabled |= bits

        def disable(bits: int) -> None:
            n.enabled &= ~bits

        def pend(bits: int) -> None:
            n.pending |= bits

        def unpend(bits: int) -> None:
            for exception in range(FIRST_IRQ, FIRST_IRQ + IRQS):
                if bits >> exception & 1:
                    n.unpend(exception)

        def active() -> int:
            return sum(1 << exception for exception in n.active)

        def word(name: str, i: int, state: Callable[[], int], act: Callable[[int], None] | None) -> Word:
            shift = FIRST_IRQ + 32 * i
            valid = (1 << FIRST_IRQ + IRQS) - 1

            def write(value: int) -> None:
                assert act is not None
                act(value << shift & valid)

            return Word(f"{name}{i}", lambda: state() >> shift & 0xFFFF_FFFF, act and write)

        for i in range((IRQS + 31) // 32):
            words[0x100 + 4 * i] = word("NVIC_ISER", i, lambda: n.enabled, enable)
            words[0x180 + 4 * i] = word("NVIC_ICER", i, lambda: n.enabled, disable)
            words[0x200 + 4 * i] = word("NVIC_ISPR", i, lambda: n.pending, pend)
            words[0x280 + 4 * i] = word("NVIC_ICPR", i, lambda: n.pending, unpend)
            words[0x300 + 4 * i] = word("NVIC_IABR", i, active, None)
        words[0xF00] = Word("NVIC_STIR", None, lambda value: n.pend(FIRST_IRQ + (value & 0x1FF)))
        return words

    def _control_block(self) -> dict[int, Word]:
        return {
            0xD00: Word("CPUID", lambda: CPUID_CORTEX_M3_R2P0, None),
            0xD04: Word("ICSR", self._read_icsr, self._write_icsr),
            0xD08: Word("VTOR", lambda: self.vector_table, self._write_vtor),
            0xD0C: Word("AIRCR", self._read_aircr, self._write_aircr),
            0xD10: Word("SCR", lambda: self._scr, self._write_scr),
            0xD14: Word("CCR", lambda: self._ccr, self._write_ccr),
            0xD24: Word("SHCSR", self._read_shcsr, None),
        }

    def _read_icsr(self) -> int:
        n = self._nvic
        waiting = n.pending & n.enabled
        highest = (waiting & -waiting).bit_length() - 1 if waiting else 0
        value = n.active[-1] if n.active else 0
        value |= highest << 12
        value |= (1 << 22) * bool(n.pending >> FIRST_IRQ)
        value |= (1 << 26) * (n.pending >> SYSTICK & 1) | (1 << 28) * (n.pending >> PENDSV & 1)
        return value | (1 << 11) * (len(n.active) <= 1)

    def _write_icsr(self, value: int) -> None:
        if value >> 31:
            self._machine.fault("the program requested an NMI: not modelled")
        for bit, act, exception in (
            (28, self._nvic.pend, PENDSV),
            (27, self._nvic.unpend, PENDSV),
            (26, self._nvic.pend, SYSTICK),
            (25, self._nvic.unpend, SYSTICK),
        ):
            if value >> bit & 1:
                act(exception)

    def _write_vtor(self, value: int) -> None:
        # The table of exception vectors has 61 entries of 4 bytes. Its alignment is that size, rounded up to
        # a power of two (ARMv7-M Architecture Reference Manual, B3.2.5).
        if value & 0xFF:
            self._machine.fault(f"VTOR 0x{value:08X}: the vector table has to be aligned to 256 bytes")
        self.vector_table = value

    def _read_aircr(self) -> int:
        return VECTKEY_READ << 16 | self._nvic.priority_group << 8

    def _write_aircr(self, value: int) -> None:
        if value >> 16 != VECTKEY:
            self._machine.fault(f"write of 0x{value:08X} to AIRCR without its key")
        self._nvic.priority_group = value >> 8 & 7
        if value & SYSRESETREQ:
            self._system_reset()

    def _write_scr(self, value: int) -> None:
        if value & (SLEEPDEEP | SLEEPONEXIT | SEVONPEND):
            self._machine.fault(f"SCR 0x{value:X}: deep sleep, sleep on exit and SEVONPEND are not modelled")
        self._scr = value

    def _write_ccr(self, value: int) -> None:
        if value & ~ALLOWED_CCR or not value & CCR_STKALIGN:
            self._machine.fault(f"CCR 0x{value:X}: not modelled")
        self._ccr = value

    def _read_shcsr(self) -> int:
        active = self._nvic.active
        return (1 << 11) * (SYSTICK in active) | (1 << 10) * (PENDSV in active)
