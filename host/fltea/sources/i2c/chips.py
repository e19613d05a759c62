"""Lists all chips that can be read on an I²C bus.

The driver, `fltea doctor`, messages and pages use this table.

To add a chip, add a row to `wire.sensors.SENSORS`, a module with its registers and its `FAMILY` to this
folder, and the module's name to `CHIPS` below. `tests/sources/test_chip_table.py` reports what is missing.
"""

from collections.abc import Callable, Iterable

from fltea.sources.i2c import icm20948, mpu9250
from fltea.sources.i2c.chip import Chip, Family
from fltea.wire.sensors import SENSORS

CHIPS = {family.name: family for family in (mpu9250.FAMILY, icm20948.FAMILY)}
"""Families of chips by name, in the order in which the driver tries them."""

ADDRESSES = {address: how for family in CHIPS.values() for address, how in family.addresses.items()}
"""All addresses that a chip may have on the bus, each with the wiring that gives a chip this address."""


def chip_of(who_am_i: int) -> Chip:
    """Return the description of the known chip with this WHO_AM_I: its registers and settings."""
    return CHIPS[SENSORS[who_am_i].family].chip(who_am_i)


def is_of(who_am_i: int, family: Family) -> bool:
    """Return whether a chip with this WHO_AM_I is known and belongs to the family."""
    sensor = SENSORS.get(who_am_i)
    return sensor is not None and sensor.family == family.name


def ask_identity(
    ask: Callable[[Family], int], families: Iterable[Family], tries: int = 1
) -> tuple[int, bool]:
    """Return the WHO_AM_I of a chip, and whether it is known.

    If the chip gives no known WHO_AM_I, return its first answer.

    `ask`: function that reads the WHO_AM_I from the register that a family uses for it. `tries`: number of
    reads for each family.
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
    return [name for name, family in CHIPS.items() if family.chip(0).banks is not None]
