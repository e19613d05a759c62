"""Describe a kind of sensor for the driver as plain values; `chips.py` lists all kinds.

A register is given by its number; for a chip with banks, 256 times the bank is added.
"""

from collections.abc import Callable, Mapping
from struct import Struct
from typing import NamedTuple


class Setting(NamedTuple):
    """The value of a register. `meaning`: mask of the bits that matter; others may differ on a clone."""

    register: int
    value: int
    meaning: int

    def kept(self, value: int) -> bool:
        """Return whether a register that reads as `value` has kept its setting."""
        return not (value ^ self.value) & self.meaning


class Chip(NamedTuple):
    """One kind of sensor.

    `rate_hz`: sampling rate that its settings give. `clock_error`: largest relative error of that rate.
    `gyro_lsb_per_dps`, `accel_lsb_per_g`: sensitivities at the ranges that `settings` choose.
    `reset`: register and value. `reset_s`: time after a reset until the registers answer as after power-up.
    `settings`: in the order of writing; the first wakes the chip, the last selects what fills the FIFO.
    `settle_s`: time that the gyroscope needs after the settings.
    `checked`: first register and length of each block that determines the samples' rate, scale and content.
    `restart`: writes that empty the FIFO and let it fill. `running`: setting that the chip then has.
    `sample`: one sample in the FIFO: acceleration, temperature if the FIFO holds it, rate.
    `fifo_bytes`: bytes of the FIFO that are used. `keeps_oldest`: a full FIFO keeps whole samples; otherwise
    an overflow tears a sample apart. `overflow`: register and bits that report an overflow.
    `temperature`: register of the thermometer if the FIFO does not hold it.
    `bank_select`: register that selects the bank, if there are banks.
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
        """Number of whole samples that the FIFO holds."""
        return self.fifo_bytes // self.sample.size

    @property
    def fifo_s(self) -> float:
        """Time that the FIFO's samples span [s]: the program may be delayed this long without a loss."""
        return self.fifo_samples / self.rate_hz


class Family(NamedTuple):
    """Chips that are identified and wired in the same way.

    `name`: as in `&chip=` and in `wire.sensors.SENSORS`. `who_am_i`: register of the identity. `addresses`:
    each address that the chip can have on the bus, and how to wire it for that. `chip`: returns the
    description of the chip with a WHO_AM_I; 0 stands for any chip of the family before its identity is known.
    """

    name: str
    who_am_i: int
    addresses: Mapping[int, str]
    chip: Callable[[int], Chip]


AD0 = {0x68: "AD0 at GND", 0x69: "AD0 at 3.3 V"}
"""Addresses of the chips whose pin AD0 sets the lowest bit of the address."""
