"""What the driver has to know of a kind of sensor, as plain values; `chips.py` lists all kinds.

A register is its number, and for a chip with banks 256 times the bank more.
"""

from collections.abc import Callable, Mapping
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

    rate_hz: what its clock is set to give, right within the part `clock_error` of it. gyro_lsb_per_dps,
    accel_lsb_per_g: sensitivities at the ranges that `settings` choose. reset: register and value; reset_s:
    how long the registers then need until they answer as after power-up. settings: in the order of writing;
    the first wakes the chip, the last selects what fills the FIFO. settle_s: how long the gyroscope
    then needs. checked: first register and length of the blocks that hold what gives a sample its rate, scale
    and shape. restart: writes that empty the FIFO and let it fill; running: how the chip then has to be.
    sample: one sample in the FIFO, first the acceleration, last the rate, and between them the temperature if
    it is there; fifo_bytes: how much of the FIFO is used; keeps_oldest: what a full FIFO holds stays whole,
    where an overflow would otherwise tear it. overflow: register and bits that tell of one. temperature:
    register of the thermometer if the FIFO does not hold it. bank_select: register that selects the bank, if
    there are any.
    """

    rate_hz: float
    clock_error: float
    gyro_range_dps: float
    gyro_lsb_per_dps: float
    gyro_dlpf_hz: float
    accel_range_g: float
    accel_lsb_per_g: float
    reset: tuple[int, int]
    reset_s: float
    settle_s: float
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

    @property
    def fifo_samples(self) -> int:
        """Whole samples that the FIFO holds."""
        return self.fifo_bytes // self.sample.size

    @property
    def fifo_s(self) -> float:
        """Seconds of samples that the FIFO holds: so long may the program be held up without a loss."""
        return self.fifo_samples / self.rate_hz


class Family(NamedTuple):
    """Chips that are asked for their identity, and wired, in the same way.

    name: as in `&chip=` and in `wire.sensors.SENSORS`. who_am_i: register of the identity. addresses: each
    that the chip can have on the bus, and how it gets that one. chip: returns what there is to know of the
    kind with a WHO_AM_I; 0 stands for any of the family, before one was asked.
    """

    name: str
    who_am_i: int
    addresses: Mapping[int, str]
    chip: Callable[[int], Chip]


AD0 = {0x68: "AD0 at GND", 0x69: "AD0 at 3.3 V"}
"""Addresses of the chips whose pin AD0 is the lowest bit."""
