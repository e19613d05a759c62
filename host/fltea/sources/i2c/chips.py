"""Lists all chips that can be read on an I²C bus.

The driver, `fltea doctor`, messages and pages use this table.

A new chip needs a row in `wire.sensors.SENSORS`, a module in this folder with its registers and its `FAMILY`,
and that module's name below. `tests/sources/test_chip_table.py` reports what is missing.
"""

from collections.abc import Callable, Iterable

from fltea.sources.i2c import icm20948, mpu9250
from fltea.sources.i2c.chip import Chip, Family
from fltea.wire.sensors import SENSORS

CHIPS = {family.name: family for family in (mpu9250.FAMILY, icm20948.FAMILY)}
"""Families of chips by name, in the order in which the driver tries them."""

ADDRESSES = {address: how for family in CHIPS.values() for address, how in family.addresses.items()}
"""All possible addresses on the bus, with the wiring that gives a chip this address."""


def chip_of(who_am_i: int) -> Chip:
    """Return the registers and settings of the known chip with this WHO_AM_I."""
    return CHIPS[SENSORS[who_am_i].family].chip(who_am_i)


def is_of(who_am_i: int, family: Family) -> bool:
    """Return whether a chip with this WHO_AM_I is known and belongs to the family."""
    sensor = SENSORS.get(who_am_i)
    return sensor is not None and sensor.family == family.name


def ask_identity(
    ask: Callable[[Family], int], families: Iterable[Family], tries: int = 1
) -> tuple[int, bool]:
    """Return the WHO_AM_I of a chip, and whether it is known. If no answer is known, return the first one.

    `ask`: function that reads the identity from a family's register. `tries`: number of reads for each
    family.
    """
    first = None
    for family in families:
        for _ in range(tries):
            answer = ask(family)
            first = answer if first is None else first
            if is_of(answer, family):
                return answer, True
    return first or 0, False


def with_banks() -> list[str]:
    """Return the names of the families that have banks of registers."""
    return [name for name, family in CHIPS.items() if family.chip(0).bank_select is not None]
