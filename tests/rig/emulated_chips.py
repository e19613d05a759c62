"""List an emulation of every chip that is read on an I²C bus, with facts for checking the driver.

Register facts come from RM-MPU-9250A-00, for the MPU-6050 from RM-MPU-6000A-00, for the ICM-20948 from
DS-000189 (revision 1.3). All numbers are copied from these documents by hand, not from the driver. The
address of a banked register here is its number plus 256 times the bank.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

from fltea.wire.sensors import SENSORS

from tools.due_emulator.chip import Chip
from tools.due_emulator.icm20948 import Icm20948
from tools.due_emulator.mpu9250 import Mpu9250


# Why more than 12 attributes: each is a fact from a chip's data sheet, typed by hand.
class Emulated(NamedTuple):
    """An emulated kind of chip with facts about it.

    The fields of gyroscope and accelerometer that are not listed here are as in `sources.i2c.chip.Chip`.

    `model`: makes the chip, given its surroundings and `options`.
    `period_ms`: sampling period.
    `clock_error`: largest relative error of the sampling rate.
    `banks`: register that selects the bank of registers, and the bit at which the bank's number begins there;
        None if the chip has no banks.
    `reset_ms`: longest time after a reset until the chip takes settings.
    `gyro_start_ms`: time that the gyroscope needs after it was switched on.
    `gyro_ends`: lowest and highest count of the gyroscope.
    `header`: value of the first byte of a sample in the FIFO, and mask of its bits that matter; None if
        samples have no header.
    `holds`: number of samples that fit into the chip's FIFO.
    `keeps_oldest`: whether the oldest samples stay whole when the FIFO overflows.
    `at_25_c`, `counts_a_c`: counts of the chip's thermometer at 25 °C, and counts per °C.
    `kept`: registers that the driver has to set, with the values that they then hold. Registers whose value
        is right after a reset are included.
    `unnoticed`: registers of `kept` whose change the driver need not notice. Such a change does not alter
        the samples, or it stops them.
    `lost_bit`: bit that the tests change in the other registers of `kept`; the driver has to notice this.
    """

    model: type[Any]
    options: Mapping[str, Any]
    name: str
    period_ms: int
    clock_error: float
    banks: tuple[int, int] | None
    reset_ms: float
    gyro_start_ms: float
    gyro_dlpf_hz: float
    gyro_range_dps: float
    gyro_lsb_per_dps: float
    gyro_ends: tuple[int, int]
    accel_range_g: float
    accel_lsb_per_g: float
    header: tuple[int, int] | None
    holds: int
    keeps_oldest: bool
    at_25_c: int
    counts_a_c: float
    kept: Mapping[int, int]
    unnoticed: tuple[int, ...]
    lost_bit: int

    def row(self, what: str, register: int | None = None) -> str:
        """Return the message of a failed check. It names the chip, the fact, and the register if given."""
        return f"sources/i2c, {self.name}: {what}" + ("" if register is None else f" 0x{register:02X}")

    @property
    def lost(self) -> list[int]:
        """The registers in which the driver has to notice a change."""
        return [register for register in self.kept if register not in self.unnoticed]

    def make(self, world: Any, **options: Any) -> Chip:
        """Return a chip of this kind; `world` supplies the values that it measures."""
        chip: Chip = self.model(world, **(dict(self.options) | options))
        return chip


_MPU9250 = Emulated(
    Mpu9250,
    {},
    "MPU-9250",
    period_ms=10,
    clock_error=0.01,  # PS-MPU-9250A-01, section 4.15
    banks=None,
    reset_ms=100,  # PS-MPU-9250A-01, section 3.4.2
    gyro_start_ms=35,  # PS-MPU-9250A-01, section 3.1
    gyro_dlpf_hz=184.0,
    gyro_range_dps=2000.0,
    gyro_lsb_per_dps=16.4,
    gyro_ends=(-32768, 32767),
    accel_range_g=2.0,
    accel_lsb_per_g=16384.0,
    header=None,
    holds=36,
    keeps_oldest=True,
    at_25_c=1335,
    counts_a_c=333.87,
    kept={
        0x19: 9,  # the sampling rate is 1 kHz / (1 + 9)
        0x1A: 0x41,  # DLPF_CFG 1 (the gyroscope's low-pass has 184 Hz), and the bit FIFO_MODE
        0x1B: 0x18,  # the gyroscope's range is ±2000 deg/s
        0x1C: 0x00,  # the accelerometer's range is ±2 g
        0x1D: 0x01,  # the accelerometer's low-pass has 184 Hz
        0x23: 0xF8,  # the FIFO gets temperature, three gyroscope axes and acceleration
        0x37: 0x00,  # the INT pin is push-pull and active high
        0x38: 0x10,  # FIFO_OFLOW_EN: an overflow of the FIFO causes an interrupt
        0x6A: 0x40,  # the FIFO is on
        0x6B: 0x01,  # the chip is awake and selects the best clock
    },
    unnoticed=(0x37, 0x38, 0x6A, 0x6B),
    lost_bit=0x08,
)


def _relative(who_am_i: int, name: str, **others: Any) -> Emulated:
    return _MPU9250._replace(options={"who_am_i": who_am_i}, name=name, **others)


EMULATED = {
    0x71: _MPU9250,
    0x73: _relative(0x73, "MPU-9255"),
    0x70: _relative(0x70, "MPU-6500"),
    0x68: _relative(
        0x68,
        "MPU-6050",
        gyro_dlpf_hz=188.0,
        holds=73,
        keeps_oldest=False,
        at_25_c=-3920,
        counts_a_c=340.0,
        gyro_start_ms=30,  # PS-MPU-6000A-00, section 6.1
        # this chip has neither the bit FIFO_MODE nor the register ACCEL_CONFIG_2
        kept={register: n for register, n in _MPU9250.kept.items() if register != 0x1D} | {0x1A: 0x01},
    ),
    0x75: _relative(0x75, "MPU-9250 clone (0x75)"),
    0x78: _relative(0x78, "MPU-9250 clone (0x78)"),
    0xEA: Emulated(
        Icm20948,
        {},
        "ICM-20948",
        period_ms=8,
        clock_error=0.1,  # TIMEBASE_CORRECTION_PLL: 127 steps of 0.079 %
        banks=(0x7F, 4),
        reset_ms=100,  # section 3.4
        gyro_start_ms=35,  # section 3.1
        gyro_dlpf_hz=196.6,
        gyro_range_dps=2000.0,
        gyro_lsb_per_dps=16.4,
        gyro_ends=(-32768, 32767),
        accel_range_g=2.0,
        accel_lsb_per_g=16384.0,
        header=None,
        holds=42,
        keeps_oldest=True,
        at_25_c=1335,
        counts_a_c=333.87,
        kept={
            0x006: 0x01,  # the chip is awake and selects the best clock
            0x007: 0x00,  # all axes are enabled
            0x200: 8,  # the gyroscope's rate is 1125 Hz / (1 + 8)
            0x201: 0x07,  # GYRO_DLPFCFG 0: the gyroscope's low-pass is on, with 196.6 Hz; range ±2000 deg/s
            0x209: 0x01,
            0x210: 0,
            0x211: 8,
            0x214: 0x01,  # ACCEL_DLPFCFG 0: the accelerometer's low-pass is on, with 246 Hz; range ±2 g
            0x012: 0x01,  # an overflow of the FIFO causes an interrupt
            0x066: 0x00,  # the FIFO gets nothing from the auxiliary bus
            0x067: 0x1E,  # the FIFO gets acceleration and the rates of three axes
            0x069: 0x01,
            0x068: 0x00,  # as long as this reset bit is set, the FIFO stays empty
            0x003: 0x40,
        },
        unnoticed=(0x012, 0x068, 0x003),
        lost_bit=0x01,
    ),
}
"""The emulated chips by WHO_AM_I, with one entry for each chip in `fltea.wire.sensors.SENSORS`."""

FIRST = {one.family: who_am_i for who_am_i, one in reversed(SENSORS.items())}
"""WHO_AM_I of the chip that stands for its family in tests and in the guide, by the family's name."""
