"""Registers and settings of the ICM-20948, from its data sheet DS-000189 (revision 1.3).

The numbers and bits of the registers were compared with two widely used drivers, with which they agree:
PX4's, and ICM20948_WE by W. Ewald. The chip has banks of registers; register 127 of each bank selects the
bank.

The FIFO is set to hold only acceleration and angular rate. The temperature is read from its register, since
the data sheet does not say where in a FIFO's sample it would stand.
"""

from struct import Struct
from typing import Final

from fltea.sources.i2c.chip import AD0, INT16_ENDS, Banks, Chip, Family, Packet, Setting

BANK_2: Final = 0x200
"""256 times the bank's number, which is added to the number of each register in bank 2 (see chip.py)."""

WHO_AM_I: Final = 0x00
"""ICM-20948 data sheet, section 8.1: Identity of the chip."""
USER_CTRL: Final = 0x03
"""ICM-20948 data sheet, section 8.2: Bit 6, FIFO_EN, switches the FIFO on."""
PWR_MGMT_1: Final = 0x06
"""ICM-20948 data sheet, section 8.4: Reset, sleep, and choice of the clock. After a reset the value is 0x41,
so the chip sleeps.
"""
PWR_MGMT_2: Final = 0x07
"""ICM-20948 data sheet, section 8.5: Switches single axes off."""
INT_ENABLE_2: Final = 0x12
"""ICM-20948 data sheet, section 8.9: Interrupt for an overflow of the FIFO."""
INT_STATUS_2: Final = 0x1B
"""ICM-20948 data sheet, section 8.14: Reports an overflow of the FIFO; reading clears the report."""
TEMP_OUT_H: Final = 0x39
"""ICM-20948 data sheet, section 8.30: First of the two registers of the temperature."""
FIFO_EN_1: Final = 0x66
"""ICM-20948 data sheet, section 8.56: Selects which data of the auxiliary bus enter the FIFO."""
FIFO_EN_2: Final = 0x67
"""ICM-20948 data sheet, section 8.57: Selects what enters the FIFO: bit 4 acceleration, bits 3 to 1 rate
about z, y, x, bit 0 temperature.
"""
FIFO_RST: Final = 0x68
"""ICM-20948 data sheet, section 8.58: Setting and then clearing its bits empties the FIFO; the bits do not
clear themselves.
"""
FIFO_MODE: Final = 0x69
"""ICM-20948 data sheet, section 8.59: Bit 0 means that a full FIFO takes no more data."""
FIFO_COUNT_H: Final = 0x70
"""ICM-20948 data sheet, section 8.60: First of two registers with the number of bytes in the FIFO; reading it
latches both.
"""
FIFO_R_W: Final = 0x72
"""ICM-20948 data sheet, section 8.62: The FIFO's oldest byte; reading removes it. All reads in a transfer use
this address.
"""
BANK_SELECT: Final = 0x7F
"""ICM-20948 data sheet, section 8.65: Bits 5:4 select the bank of registers."""
GYRO_SMPLRT_DIV: Final = BANK_2 | 0x00
"""ICM-20948 data sheet, section 10.1: Output rate of the gyroscope = 1125 Hz / (1 + value), if GYRO_FCHOICE
is 1.
"""
GYRO_CONFIG_1: Final = BANK_2 | 0x01
"""ICM-20948 data sheet, section 10.2: Bits 5:3 GYRO_DLPFCFG, 2:1 GYRO_FS_SEL, 0 GYRO_FCHOICE (1: the filter
is on).
"""
ODR_ALIGN_EN: Final = BANK_2 | 0x09
"""ICM-20948 data sheet, section 10.10: Bit 0 makes gyroscope and accelerometer begin their sampling periods
together.
"""
ACCEL_SMPLRT_DIV_1: Final = BANK_2 | 0x10
"""ICM-20948 data sheet, section 10.11: High bits of the accelerometer's divider."""
ACCEL_SMPLRT_DIV_2: Final = BANK_2 | 0x11
"""ICM-20948 data sheet, section 10.12: Output rate of the accelerometer = 1125 Hz / (1 + value), if
ACCEL_FCHOICE is 1.
"""
ACCEL_CONFIG: Final = BANK_2 | 0x14
"""ICM-20948 data sheet, section 10.15: Bits 5:3 ACCEL_DLPFCFG, 2:1 ACCEL_FS_SEL, 0 ACCEL_FCHOICE."""

DIVIDER: Final = 8
"""Divider that gives 125 Hz. Among those rates of the chip whose period is a whole number of milliseconds,
125 Hz is the nearest to 100 Hz.
"""
FIFO_EN: Final = 0x40
ALL_FIFOS: Final = 0x1F

SETTINGS = (
    Setting(PWR_MGMT_1, 0x01, 0x6F),  # wakes the chip, and lets it use its best clock
    Setting(PWR_MGMT_2, 0x00, 0x3F),  # switches all axes on
    Setting(GYRO_SMPLRT_DIV, DIVIDER, 0xFF),
    # selects the low-pass filter of 196.6 Hz and the range ±2000 deg/s
    Setting(GYRO_CONFIG_1, 0 << 3 | 3 << 1 | 1, 0x3F),
    Setting(ODR_ALIGN_EN, 0x01, 0x01),
    Setting(ACCEL_SMPLRT_DIV_1, 0, 0x0F),
    Setting(ACCEL_SMPLRT_DIV_2, DIVIDER, 0xFF),
    # selects the low-pass filter of 246 Hz and the range ±2 g
    Setting(ACCEL_CONFIG, 0 << 3 | 0 << 1 | 1, 0x3F),
    Setting(INT_ENABLE_2, 0x01, 0x01),
    Setting(FIFO_MODE, 0x01, 0x01),
    Setting(FIFO_EN_1, 0x00, 0x0F),
    Setting(FIFO_EN_2, 0x1E, 0x1F),
)

ICM20948 = Chip(
    rate_hz=1125 / (1 + DIVIDER),
    # the largest error of the PLL's frequency that the register TIMEBASE_CORRECTION_PLL can state (ICM-20948
    # data sheet, section 4.14)
    clock_error=0.1,
    gyro_range_dps=2000.0,  # ranges and sensitivities: ICM-20948 data sheet, sections 3.1, 3.2
    gyro_lsb_per_dps=16.4,
    gyro_ends=INT16_ENDS,
    gyro_dlpf_hz=196.6,
    accel_range_g=2.0,
    accel_lsb_per_g=16384.0,
    reset=(PWR_MGMT_1, 0x80),
    reset_s=0.1,
    # a chip sleeps after a reset, and its gyroscope needs 35 ms to start from sleep (ICM-20948 data sheet,
    # section 3.1)
    settle_s=0.05,
    settings=SETTINGS,
    checked=(
        (PWR_MGMT_1, 2),
        (GYRO_SMPLRT_DIV, ACCEL_CONFIG + 1 - GYRO_SMPLRT_DIV),
        (FIFO_EN_1, FIFO_MODE + 1 - FIFO_EN_1),
    ),
    restart=((USER_CTRL, 0), (FIFO_RST, ALL_FIFOS), (FIFO_RST, 0), (USER_CTRL, FIFO_EN)),
    running=Setting(USER_CTRL, FIFO_EN, 0xF0),
    packet=Packet(Struct(">6h"), accel=0, gyro=3),
    # size of the FIFO by the ICM-20948 data sheet, section 4.16; some chips have a FIFO of 4,096 bytes, of
    # which only 512 are used
    fifo_bytes=512,
    keeps_oldest=True,
    fifo_count=FIFO_COUNT_H,
    fifo_data=FIFO_R_W,
    overflow=(INT_STATUS_2, ALL_FIFOS),
    temperature=TEMP_OUT_H,
    banks=Banks(BANK_SELECT, shift=4),
)

FAMILY = Family("icm20948", WHO_AM_I, AD0, lambda who_am_i: ICM20948)
