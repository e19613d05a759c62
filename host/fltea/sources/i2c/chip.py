"""Describes one kind of sensor by plain values, which the driver uses. `chips.py` lists all kinds of sensors.

A register is given by its number. If the chip has banks of registers, 256 times the number of the register's
bank is added.
"""

from collections.abc import Callable, Mapping
from struct import Struct
from typing import NamedTuple


class Setting(NamedTuple):
    """A register and the value that is written to it.

    `meaning`: mask of the bits that matter when the register is read back. The other bits may differ on a
    clone of the chip.
    """

    register: int
    value: int
    meaning: int

    def kept(self, value: int) -> bool:
        """Return whether `value`, which was read from the register, agrees with this setting."""
        return not (value ^ self.value) & self.meaning


# Over 12 attributes: permitted, since each is one fact of a chip's data sheet that the driver needs.
class Chip(NamedTuple):
    """One kind of sensor.

    `rate_hz`: sampling rate that results from `settings` [Hz]. `clock_error`: largest relative error of that
    rate. `gyro_lsb_per_dps`, `accel_lsb_per_g`: sensitivities at the ranges that `settings` choose. `reset`:
    register and value that reset the chip. `reset_s`: time after which the registers answer again [s].
    `settings`: registers and their values in the order in which they are written; the first wakes the chip,
    and the last selects which data enter the FIFO. `settle_s`: time that the gyroscope needs after the
    settings [s]. `checked`: first register and number of registers of each block that determines the samples'
    rate, scale and content. `restart`: registers and the values to write to them. They empty the FIFO, and
    start to fill it again. `running`: setting of a register from which the driver confirms that the FIFO is
    being filled.
    `sample`: binary layout of one sample in the FIFO: acceleration, temperature if the FIFO holds it, angular
    rate. `fifo_bytes`: number of bytes of the FIFO that are used. `keeps_oldest`: whether a full FIFO keeps
    whole samples; otherwise an overflow destroys a part of a sample. `overflow`: register that reports an
    overflow, and the mask of those of its bits that report it. `temperature`: register of the thermometer if
    the FIFO does not hold the temperature.
    `bank_select`: register that selects the bank, if the chip has banks.
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
        """Number of whole samples that fit into the FIFO."""
        return self.fifo_bytes // self.sample.size

    @property
    def fifo_s(self) -> float:
        """Time that the samples of a full FIFO span [s].

        The program may be delayed for this time without a loss of samples.
        """
        return self.fifo_samples / self.rate_hz


class Family(NamedTuple):
    """A family of chips that are identified and wired in the same way.

    `name`: name of the family in the URL (`&chip=`) and in `wire.sensors.SENSORS`. `who_am_i`: register with
    the chip's identity.
    `addresses`: each possible address of the chip on the bus, with the wiring that sets this address.
    `chip`: function that returns the description of the chip with a given WHO_AM_I. A WHO_AM_I of 0 means
    that it is not known yet.
    """

    name: str
    who_am_i: int
    addresses: Mapping[int, str]
    chip: Callable[[int], Chip]


AD0 = {0x68: "AD0 at GND", 0x69: "AD0 at 3.3 V"}
"""Both addresses of a chip whose pin AD0 sets the lowest bit of its address, each with the wiring of this
pin.
"""
