"""The Reset Controller: why the chip started, and resets by the program (SAM3X datasheet, chapter 12)."""

from collections.abc import Callable
from enum import IntEnum

from tools.due_emulator.machine import Machine
from tools.due_emulator.peripheral import Peripheral

KEY = 0xA5
PROCRST, PERRST, EXTRST = 1, 4, 8
NRSTL = 1 << 16


class ResetType(IntEnum):
    """Causes of a reset, as the field RSTC_SR.RSTTYP states them."""

    POWER_UP = 0
    BACKUP = 1
    WATCHDOG = 2
    SOFTWARE = 3
    USER = 4


class ResetController(Peripheral):
    """Reports why the chip started; calls `request` when the program asks for a reset."""

    def __init__(self, machine: Machine, request: Callable[[], None]) -> None:
        super().__init__(machine, "RSTC")
        self._request = request
        self.restarted(ResetType.POWER_UP)

    def restarted(self, cause: ResetType) -> None:
        """Store why the chip starts. A reset by the reset pin also sets the flag URSTS (user reset)."""
        self.reset()
        self.registers["SR"] = cause << 8 | NRSTL | (cause is ResetType.USER)

    def on_read(self, register: str) -> int:
        """Read a register; a read of the status register SR clears the flag URSTS (user reset)."""
        value = self.registers[register]
        if register == "SR":
            self.registers["SR"] &= ~1
        return value

    def on_write(self, register: str, value: int) -> None:
        """Write a register. Both writable registers accept only values that contain the chip's key."""
        if value >> 24 != KEY:
            self.machine.fault(f"RSTC_{register} = 0x{value:08X} without its key 0xA5: the chip ignores it")
        if register == "MR":
            self.registers["MR"] = value & 0x00FF_FFFF
        elif value & (PROCRST | PERRST) == PROCRST | PERRST:
            self._request()
        elif value & (PROCRST | PERRST):
            self.machine.fault(f"RSTC_CR = 0x{value:08X}: processor and peripherals are reset together")
