"""Writes the tables of ATSAM3X8E registers for emulator and bare-metal firmware, from the vendor's SVD."""

from __future__ import annotations

import json
from pathlib import Path

from tools import registers_cpp
from tools.svd import MEMBER, PACKAGE, Peripheral, Register, obtain, read

SOURCE = f"{MEMBER} of {PACKAGE}"


def table(peripherals: dict[str, Peripheral]) -> str:
    """Return the emulator's table as JSON with one register in each line.

    A field of a register is written as [lowest bit, width].
    """
    return "{\n" + ",\n".join(map(_peripheral, peripherals.values())) + "\n}\n"


def _peripheral(peripheral: Peripheral) -> str:
    irq = peripheral.irqs[0] if peripheral.irqs else None
    head = f'"base": {peripheral.base}, "irq": {json.dumps(irq)}, "irqs": {list(peripheral.irqs)}'
    lines = (f'  "{name}": {_register(register)}' for name, register in peripheral.registers.items())
    return f'"{peripheral.name}": {{{head}, "registers": {{\n' + ",\n".join(lines) + "\n}}"


def _register(register: Register) -> str:
    entry: dict[str, object] = {
        "offset": register.offset,
        "access": register.access,
        "reset": register.reset,
    }
    if register.alternate_of:
        entry["alternate_of"] = register.alternate_of
    return json.dumps(
        {**entry, "fields": {field.name: [field.lsb, field.width] for field in register.fields}}
    )


def outputs(root: Path) -> dict[str, str]:
    """Return paths and texts of two files: the emulator's table of registers, and the firmware's header."""
    peripherals = read(obtain(root))
    return {
        "tools/due_emulator/sam3x_registers.json": table(peripherals),
        "firmware/due/sam3x.h": registers_cpp.header(peripherals),
    }
