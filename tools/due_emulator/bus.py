"""The peripheral bus: maps an address to a register of a peripheral, or ends the run."""

from typing import NamedTuple, NoReturn

from tools.due_emulator.machine import Machine
from tools.due_emulator.peripheral import Peripheral

PERIPHERALS_BASE = 0x4000_0000
PERIPHERALS_BYTES = 0x000E_2000
WORD = 4


class _Port(NamedTuple):
    peripheral: Peripheral
    register: str
    clock: int
    """Bits of `Machine.clocked` (peripherals with a clock) that have to be set for an access to the register,
    or 0 if none is needed.
    """


class Bus:
    """The peripheral bus: performs the program's reads and writes of registers by absolute address."""

    def __init__(self, machine: Machine) -> None:
        self._machine = machine
        self._peripherals: list[Peripheral] = []
        # Programs often poll registers, so access has to be fast: one lookup in a dict finds the register of
        # a valid access.
        self._readers: dict[int, _Port] = {}
        self._writers: dict[int, _Port] = {}

    def add(self, peripheral: Peripheral) -> None:
        """Map a peripheral's registers to their addresses."""
        self._peripherals.append(peripheral)
        for register in peripheral.table.registers.values():
            if peripheral.register_at(register.offset, WORD, "map") is not register:
                continue
            clock = peripheral.clock_id(register.name)
            port = _Port(peripheral, register.name, 0 if clock is None else 1 << clock)
            address = peripheral.table.base + register.offset
            if register.readable:
                self._readers[address] = port
            if register.writable:
                self._writers[address] = port

    def read(self, address: int, size: int) -> int:
        """Read `size` bytes from a register, and return their value."""
        port = self._readers.get(address)
        if port is None or size != WORD or port.clock & ~self._machine.clocked:
            self._refuse(address, size, "read")
        return port.peripheral.on_read(port.register) & 0xFFFF_FFFF

    def write(self, address: int, size: int, value: int) -> None:
        port = self._writers.get(address)
        if port is None or size != WORD or port.clock & ~self._machine.clocked:
            self._refuse(address, size, "write")
        port.peripheral.on_write(port.register, value)

    def _refuse(self, address: int, size: int, verb: str) -> NoReturn:
        for peripheral in self._peripherals:
            offset = address - peripheral.table.base
            if 0 <= offset <= max(r.offset for r in peripheral.table.registers.values()):
                peripheral.check_access(peripheral.register_at(offset, size, verb), verb)
        self._machine.fault(f"{verb} at 0x{address:08X}: no peripheral there")
