"""The two flash controllers, EEFC0 and EEFC1 (SAM3X datasheet, chapter 18).

Modelled are the wait states, the chip's unique identifier and the GPNVM bits (settings that survive a loss of
power). Erasing and programming are not modelled. A command for them ends the run.
"""

from collections.abc import Callable

from tools.due_emulator.machine import PS_PER_US, Alarm, Machine
from tools.due_emulator.memory_map import BANK_BYTES, FLASH_BASE, Memory
from tools.due_emulator.peripheral import Peripheral

KEY = 0x5A
GET_DESCRIPTOR, GET_GPNVM, START_ID, STOP_ID = 0x00, 0x0D, 0x0E, 0x0F
FRDY, FCMDE = 1, 2
COMMAND_PS = 10 * PS_PER_US
"""Time that a command of the controller takes in the emulation. It is a round number."""
FASTEST_HZ = (19_000_000, 34_000_000, 53_000_000, 78_000_000, 90_000_000)
"""Highest master clock [Hz] that the flash tolerates with 0, 1, 2, 3 and 4 wait states. Each is the lower
value of two sources.

The SAM3X datasheet, 45.9, at a core voltage of 1.8 V has 19, 50, 64, 80 and 90 MHz for 0 to 4 wait states.
The vendor's header sam3x8e.h (CHIP_FREQ_FWS_0 to 3) has 22.5, 34, 53 and 78 MHz.
"""
BOOT_FROM_FLASH = 0b010
"""GPNVM bit 1. If it is not set, the chip starts the program in ROM (SAM3X datasheet, 11.2)."""
DESCRIPTOR = (0x000F_0950, BANK_BYTES, 256, 1, BANK_BYTES, 16, *[BANK_BYTES // 16] * 16)
"""Words by which the flash describes itself, in this order: its identifier FL_ID (not checked in a document),
its size, size of a page, number of planes, size of the plane, number of lock regions, and for each region its
size. All sizes are in bytes.
"""


class FlashController(Peripheral):
    """One of the two flash controllers with its bank of flash.

    `uid`: the chip's unique identifier of 16 bytes, which replaces the bank's contents between the commands
    STUI (start reading it) and SPUI (stop).
    """

    def __init__(self, machine: Machine, number: int, memory: Memory, uid: bytes) -> None:
        super().__init__(machine, f"EFC{number}")
        self._memory = memory
        self._uid = uid
        self._start = number * BANK_BYTES
        self.pc: Callable[[], int] = lambda: 0
        """Function that returns the address of the present instruction."""
        self._results: list[int] = []
        self._event: Alarm | None = None
        self._hidden: bytes | None = None

    def reset(self) -> None:
        """Reset the controller: there are no wait states, and the flash is readable."""
        if self._event is not None:
            self._event.cancel()
        self._show_flash()
        super().reset()
        self.settle_irq()

    @property
    def shows_id(self) -> bool:
        """Whether reads of the bank of flash return the unique identifier."""
        return self._hidden is not None

    def _holds(self, address: int) -> bool:
        return FLASH_BASE + self._start <= address < FLASH_BASE + self._start + BANK_BYTES

    def check(self, mck_hz: int) -> None:
        """End the run if the flash has too few wait states for this master clock."""
        fws = self.field("FMR", "FWS")
        fastest = FASTEST_HZ[min(fws, len(FASTEST_HZ) - 1)]
        if mck_hz > fastest:
            self.machine.fault(
                f"{self.name}_FMR.FWS is {fws}, good for {fastest / 1e6:g} MHz, but the master clock is "
                f"{mck_hz / 1e6:g} MHz: set the wait states first"
            )

    def on_read(self, register: str) -> int:
        """Read a register.

        A read of the status register FSR clears its error flags. Reads of the result register FRR return the
        words of the result in order.
        """
        value = self.registers[register]
        if register == "FSR":
            self.registers["FSR"] &= FRDY
        elif register == "FRR":
            return self._results.pop(0) if self._results else 0
        return value

    def on_write(self, register: str, value: int) -> None:
        """Set the wait states, or execute a command."""
        if register == "FCR":
            self._command(value)
            return
        self.registers[register] = value
        self.check(self.machine.mck_hz)
        self.settle_irq()

    def _command(self, value: int) -> None:
        command = value & 0xFF
        if value >> 24 != KEY:
            self.machine.fault(
                f"{self.name}_FCR = 0x{value:08X} without its key 0x5A: the command is refused"
            )
        if not self.registers["FSR"] & FRDY and not (self.shows_id and command == STOP_ID):
            self.machine.fault(f"{self.name}: command 0x{command:02X} while FSR.FRDY is 0")
        match command:
            case 0x00:
                self._results = list(DESCRIPTOR)
            case 0x0D:
                self._results = [BOOT_FROM_FLASH]
            case 0x0E:
                self._show_id()
                return
            case 0x0F:
                if not self.shows_id:
                    self.machine.fault(f"{self.name}: SPUI without STUI")
                self._show_flash()
            case _:
                self.machine.fault(
                    f"{self.name}: command 0x{command:02X}: changing the flash is not modelled"
                )
        self._busy_for(COMMAND_PS, FRDY)

    def _show_id(self) -> None:
        if self._holds(self.pc()):
            self.machine.fault(f"{self.name}: this code runs in the flash that STUI hides: run it from RAM")
        if not self.field("FMR", "SCOD"):
            self.machine.fault(
                f"{self.name}: STUI without FMR.SCOD: the erratum says that wrong values are read"
            )
        # The flag FRDY (ready) stays 0 until the command SPUI. The SAM3X datasheet (18.4.3.8) says that FRDY
        # falls at the command STUI, and rises after SPUI.
        self.flag("FSR", FRDY, False)
        end = self._start + BANK_BYTES
        self._hidden = self._memory.flash[self._start : end]
        self._memory.flash[self._start : end] = self._uid * (BANK_BYTES // len(self._uid))

    def _show_flash(self) -> None:
        if self._hidden is not None:
            self._memory.flash[self._start : self._start + BANK_BYTES] = self._hidden
            self._hidden = None

    def _busy_for(self, delay_ps: int, flag: int) -> None:
        self.flag("FSR", FRDY, False)
        self._event = self.machine.schedule(delay_ps, lambda: self.flag("FSR", flag, True))

    def settle_irq(self) -> None:
        """Request the interrupt while the controller is ready and its mode register enables the interrupt."""
        assert self.table.irq is not None
        ready = self.registers["FSR"] & self.registers["FMR"] & FRDY
        self.machine.set_irq(self.table.irq, bool(ready))
