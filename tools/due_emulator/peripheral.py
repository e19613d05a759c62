"""A peripheral with its registers.

An access to a register that does not exist, a forbidden access or an access without a clock ends the run.
"""

from tools.due_emulator.machine import Machine
from tools.due_emulator.register_table import Register, bit_registers, peripherals

FIRST_CLOCKED_ID = 8
"""Smallest peripheral identifier with a clock. Lower identifiers belong to the system controller (SAM3X
datasheet, 9.1).
"""


class Peripheral:
    """The registers of a peripheral, as in the vendor's register description (SVD).

    `on_read` and `on_write` define what accesses to the registers do.

    Programs use `read` and `write` with the register's name. The run ends at a register that does not exist,
    an access that its mode forbids, or an access without the peripheral's clock. `status`: name of the
    register whose flags request an interrupt if the mask register IMR enables them; empty if there is no such
    register.
    """

    status = ""

    def __init__(self, machine: Machine, name: str) -> None:
        self.machine = machine
        self.name = name
        self.table = peripherals()[name]
        self.registers: dict[str, int] = {}
        self._bits = bit_registers(name)
        self._by_offset: dict[int, Register] = {}
        for register in self.table.registers.values():
            # If several registers have the same offset, the later ones are other names for the first.
            self._by_offset.setdefault(register.offset, register)
        self._store_reset_values()

    def reset(self) -> None:
        """Set the state after a reset of the chip.

        If a subclass overrides this method, the override calls it and also resets what the subclass adds.
        """
        self._store_reset_values()

    def on_read(self, register: str) -> int:
        """Return the value that the program gets when it reads the register.

        This is the stored value, unless a subclass overrides this method.
        """
        return self.registers[register]

    def on_write(self, register: str, value: int) -> None:
        """Handle a write, in a way that a subclass may override.

        The value is stored, or it sets or clears bits of another register.
        """
        if register in self._bits:
            shown, sets = self._bits[register]
            self.flag(shown, value, sets)
        else:
            self.registers[register] = value

    def flag(self, register: str, mask: int, on: bool) -> None:
        """Set or clear bits of a register, and update the interrupt request."""
        old = self.registers[register]
        self.registers[register] = old | mask if on else old & ~mask
        self.settle_irq()

    def settle_irq(self) -> None:
        """Request the peripheral's interrupt while a status flag is set that the mask register enables."""
        if self.status and self.table.irq is not None:
            flags = self.registers[self.status] & self.registers["IMR"]
            self.machine.set_irq(self.table.irq, bool(flags))

    def clock_id(self, register: str) -> int | None:
        """Return the identifier of the clock that an access to `register` needs.

        None if it needs no clock.
        """
        irq = self.table.irq
        return irq if irq is not None and irq >= FIRST_CLOCKED_ID else None

    def read(self, register: str) -> int:
        """Read a register as a program does, with all checks."""
        self.check_access(self.table.registers[register], "read")
        return self.on_read(register)

    def write(self, register: str, value: int) -> None:
        """Write a register as a program does, with all checks."""
        self.check_access(self.table.registers[register], "write")
        self.on_write(register, value)

    def register_at(self, offset: int, size: int, verb: str) -> Register:
        """Return the register at an offset from the base; ends the run if there is none."""
        register = self._by_offset.get(offset)
        if register is None:
            self.machine.fault(f"{verb} of an unknown register of {self.name}: offset 0x{offset:X}")
        if size != 4:
            self.machine.fault(f"{verb} of {size} byte(s) of {self.name}_{register.name}: words only")
        return register

    def field(self, register: str, field: str) -> int:
        """Return the value of a field in a register's stored value."""
        lsb, width = self.table.registers[register].fields[field]
        return self.registers[register] >> lsb & ((1 << width) - 1)

    def mask(self, register: str, field: str) -> int:
        """Return the mask of a field at the field's position in the register."""
        lsb, width = self.table.registers[register].fields[field]
        return ((1 << width) - 1) << lsb

    def _store_reset_values(self) -> None:
        self.registers = {name: r.reset or 0 for name, r in self.table.registers.items()}

    def check_access(self, register: Register, verb: str) -> None:
        """End the run if the register does not permit this kind of access, or if its clock is off."""
        if not (register.readable if verb == "read" else register.writable):
            mode = "write-only" if verb == "read" else "read-only"
            self.machine.fault(f"{verb} of the {mode} register {self.name}_{register.name}")
        needed = self.clock_id(register.name)
        if needed is not None and not self.machine.clock_on(needed):
            self.machine.fault(
                f"{verb} of {self.name}_{register.name} without its clock: "
                f"bit {needed % 32} of PMC_PCER{needed // 32} was not set"
            )
