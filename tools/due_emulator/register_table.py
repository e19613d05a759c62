"""Names, offsets, reset values and access modes of all peripherals, from the vendor's SVD."""

import functools
import json
from pathlib import Path
from typing import NamedTuple

TABLE = Path(__file__).with_name("sam3x_registers.json")

READ_AS_ZERO = {("TWI0", "CR"), ("TWI1", "CR")}
"""Write-only registers that may be read all the same: the Arduino core sets STOP by `TWI_CR |= STOP`."""


class Register(NamedTuple):
    """One register of a peripheral; fields: name to (lowest bit, width)."""

    name: str
    offset: int
    readable: bool
    writable: bool
    reset: int | None
    fields: dict[str, tuple[int, int]]


class PeripheralTable(NamedTuple):
    """One peripheral; irq is its identifier in NVIC and PMC alike, None for those without."""

    name: str
    base: int
    irq: int | None
    registers: dict[str, Register]


@functools.cache
def peripherals() -> dict[str, PeripheralTable]:
    """Return all peripherals by their names in the SVD."""
    tables = {}
    for name, entry in json.loads(TABLE.read_text()).items():
        registers = {
            register: Register(
                register,
                r["offset"],
                r["access"] != "write-only" or (name, register) in READ_AS_ZERO,
                r["access"] != "read-only",
                r["reset"],
                {field: (lsb, width) for field, (lsb, width) in r["fields"].items()},
            )
            for register, r in entry["registers"].items()
        }
        tables[name] = PeripheralTable(name, entry["base"], entry["irq"], registers)
    return tables
