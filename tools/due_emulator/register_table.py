"""Names, offsets, reset values and access modes of all peripherals, from the vendor's SVD."""

import functools
import json
import re
from pathlib import Path
from typing import NamedTuple

TABLE = Path(__file__).with_name("sam3x_registers.json")

READ_AS_ZERO = {("TWI0", "CR"), ("TWI1", "CR")}
"""Write-only registers that may be read nevertheless: the Arduino core sets STOP by `TWI_CR |= STOP`, which
reads the register first.
"""

TRIPLES = (
    *(("IER", "IDR", "IMR"), ("CHER", "CHDR", "CHSR"), ("ENA", "DIS", "SR"), ("SCER", "SCDR", "SCSR")),
    *(("PER", "PDR", "PSR"), ("OER", "ODR", "OSR"), ("IFER", "IFDR", "IFSR"), ("SODR", "CODR", "ODSR")),
    *(
        ("MDER", "MDDR", "MDSR"),
        ("OWER", "OWDR", "OWSR"),
        ("AIMER", "AIMDR", "AIMMR"),
        ("LSR", "ESR", "ELSR"),
    ),
    *(("REHLSR", "FELLSR", "FRLHSR"), ("DIFSR", "SCIFSR", "IFDGSR")),
    ("PUDR", "PUER", "PUSR"),  # PUSR: a 1 means that the pin's pull-up is off
)
"""Triples of registers: the first sets bits, the second clears them, the third shows them."""


class Register(NamedTuple):
    """One register of a peripheral. `fields`: (lowest bit, width) of each field, by name."""

    name: str
    offset: int
    readable: bool
    writable: bool
    reset: int | None
    fields: dict[str, tuple[int, int]]


class PeripheralTable(NamedTuple):
    """One peripheral. `irq`: the peripheral's number for interrupts and clocks, or None."""

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


@functools.cache
def bit_registers(name: str) -> dict[str, tuple[str, bool]]:
    """Return the registers of a peripheral that set or clear bits of another register.

    The value for each such register is the name of the other register, and whether a write sets the bits
    (True) or clears them (False).
    """
    registers = peripherals()[name].registers
    found: dict[str, tuple[str, bool]] = {}
    for names in TRIPLES:
        for register in registers:
            if (parts := re.fullmatch(rf"(.*){names[0]}(\d*)", register)) is not None:
                setter, clearer, shown = (f"{parts[1]}{part}{parts[2]}" for part in names)
                if clearer in registers and shown in registers:
                    found |= {setter: (shown, True), clearer: (shown, False)}
    return found
