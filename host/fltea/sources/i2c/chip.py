"""The registers, settings and FIFO of a kind of sensor, as plain values for the driver.

A register is its number, and for a chip with banks 256 times the bank more.
"""

from struct import Struct
from typing import NamedTuple


class Setting(NamedTuple):
    """The value that a register is set to. Bits without a meaning may read as anything on a clone."""

    register: int
    value: int
    meaning: int

    def kept(self, value: int) -> bool:
        """Return whether a register that reads as `value` has kept its setting."""
        return not (value ^ self.value) & self.meaning


class Chip(NamedTuple):
    """One kind of sensor.

    rate_hz: what its clock is set to give, right within the part `clock_error` of it. reset: register and
    value. settings: in the order of writing; the first wakes the chip, the last selects what fills the FIFO.
    checked: first register and length of the blocks that hold what gives a sample its rate, scale and shape.
    restart: writes that empty the FIFO and let it fill; running: how the chip then has to be.
    sample: one sample in the FIFO; keeps_oldest: what a full FIFO holds stays whole, where an overflow would
    otherwise tear it. overflow: register and bits that tell of one. temperature: register of the
    thermometer if the FIFO does not hold it. bank_select: register that selects the bank, if there are any.
    """

    rate_hz: float
    clock_error: float
    gyro_dlpf_hz: float
    reset: tuple[int, int]
    settings: tuple[Setting, ...]
    checked: tuple[tuple[int, int], ...]
    restart: tuple[tuple[int, int], ...]
    running: Setting
    sample: Struct
    fifo_bytes: int
    keeps_oldest: bool
    fifo_count: int
    fifo_data: int
    overflow: tuple[int, int]
    temperature: int | None = None
    bank_select: int | None = None
