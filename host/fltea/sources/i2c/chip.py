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


class Banks(NamedTuple):
    """How a bank of registers is selected.

    `select`: register to which the number of the bank is written, shifted to the left by `shift` bits. This
    register is in every bank.
    """

    select: int
    shift: int


class Header(NamedTuple):
    """First byte of each sample in the FIFO of some chips. `mask`: mask of the bits that matter."""

    value: int
    mask: int


Row = tuple[int, ...]
"""The values that `Packet.layout` finds in one sample in the FIFO."""


class Packet(NamedTuple):
    """One sample in the FIFO.

    `layout`: binary layout of the sample. `accel`, `gyro`, `temperature`: place of the first value of each of
    them among the values of `layout`, counted from 0; `temperature` is None if it is not taken from the FIFO.
    `header`: the header, if samples have one; then it is the first value of `layout`.
    """

    layout: Struct
    accel: int
    gyro: int
    temperature: int | None = None
    header: Header | None = None

    @property
    def size(self) -> int:
        """Number of bytes of a sample."""
        return self.layout.size

    def is_sample(self, row: Row) -> bool:
        """Return whether a row is a sample, and was not read from an empty FIFO.

        If samples have a header, every sample begins with it. If they have none, an empty FIFO repeats its
        last byte (MPU-9250 register map, section 4.37), so a row of equal bytes is no sample.
        """
        if self.header is not None:
            return not (row[0] ^ self.header.value) & self.header.mask
        return len(set(row)) > 1 or row[0] & 0xFF != row[0] >> 8 & 0xFF


# Why more than 12 attributes: each is one fact of a chip's data sheet that the driver needs.
class Chip(NamedTuple):
    """One kind of sensor.

    `rate_hz`: sampling rate that results from `settings` [Hz]. `clock_error`: largest relative error of that
    rate. `gyro_lsb_per_dps`, `accel_lsb_per_g`: sensitivities at the ranges that `settings` choose.
    `gyro_ends`: lowest and highest count of an axis of the gyroscope, at which it clips. `reset`: register
    and value that reset the chip. `reset_s`: time after which the registers answer again [s].
    `settings`: registers and their values in the order in which they are written; one of them wakes the chip.
    `settle_s`: time that the gyroscope needs after the settings [s]. `checked`: first register and number of
    registers of each block that determines the samples' rate, scale and content. `restart`: registers and the
    values to write to them. They empty the FIFO, and start to fill it again. `running`: setting of a register
    from which the driver confirms that the FIFO is being filled.
    `fifo_bytes`: number of bytes of the FIFO that are used. `keeps_oldest`: whether a full FIFO keeps whole
    samples; otherwise an overflow destroys a part of a sample. `overflow`: register that reports an overflow,
    and the mask of those of its bits that report it. `temperature`: register of the thermometer if the
    temperature is not taken from the FIFO. `banks`: how a bank is selected, if the chip has banks.
    """

    rate_hz: float
    clock_error: float
    gyro_range_dps: float
    gyro_lsb_per_dps: float
    gyro_ends: tuple[int, int]
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
    packet: Packet
    fifo_bytes: int
    keeps_oldest: bool
    fifo_count: int
    fifo_data: int
    overflow: tuple[int, int]
    temperature: int | None = None
    banks: Banks | None = None

    @property
    def fifo_samples(self) -> int:
        """Number of whole samples that fit into the FIFO."""
        return self.fifo_bytes // self.packet.size

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


INT16_ENDS = (-32768, 32767)
"""`Chip.gyro_ends` of a chip whose counts have 16 bits and use all of them."""

AD0 = {0x68: "AD0 at GND", 0x69: "AD0 at 3.3 V"}
"""Both addresses of a chip whose pin AD0 sets the lowest bit of its address, each with the wiring of this
pin.
"""
