"""Register map of the MPU-9250 family, as far as the chip model needs it.

Sources: the MPU-9250 register map (RM-MPU-9250A-00, revision 1.4, section 3 and the descriptions by register
number) and, for the MPU-6050, the MPU-6000 register map (RM-MPU-6000A-00, revision 4.2). In these documents
register numbers are decimal: 0x19 is register 25.
"""

from typing import NamedTuple

SMPLRT_DIV = 0x19
CONFIG = 0x1A
GYRO_CONFIG = 0x1B
ACCEL_CONFIG = 0x1C
ACCEL_CONFIG_2 = 0x1D
FIFO_EN = 0x23
INT_PIN_CFG = 0x37
INT_ENABLE = 0x38
INT_STATUS = 0x3A
ACCEL_XOUT_H = 0x3B
GYRO_ZOUT_L = 0x48
USER_CTRL = 0x6A
PWR_MGMT_1 = 0x6B
PWR_MGMT_2 = 0x6C
FIFO_COUNTH = 0x72
FIFO_COUNTL = 0x73
FIFO_R_W = 0x74
WHO_AM_I = 0x75

# CONFIG, register 26
FIFO_MODE_STOP = 0x40
# INT_PIN_CFG, register 55
ACTIVE_LOW, LATCH_INT_EN, INT_ANYRD_2CLEAR = 0x80, 0x20, 0x10
# bits of INT_ENABLE (which interrupts are on) and INT_STATUS (which have come), registers 56 and 58
FIFO_OFLOW, RAW_DATA_RDY = 0x10, 0x01
# USER_CTRL, register 106
USER_FIFO_EN, I2C_IF_DIS, FIFO_RST = 0x40, 0x10, 0x04
# PWR_MGMT_1, register 107
H_RESET, SLEEP, CLKSEL, CLKSEL_STOP = 0x80, 0x40, 0x07, 0x07

FIFO_SOURCES = ((0x08, 0, 6), (0x80, 6, 8), (0x40, 8, 10), (0x20, 10, 12), (0x10, 12, 14))
"""For each source of data in the FIFO: its bit in FIFO_EN (register 35), and begin and end of its bytes among
the 14 output bytes, as in a Python slice. The order is that of the register numbers.
"""

# Writable bits of each register. Registers that are absent here are read-only or reserved.
_WRITABLE = {
    **dict.fromkeys([0x00, 0x01, 0x02, 0x0D, 0x0E, 0x0F], 0xFF),  # registers of the self-test
    **dict.fromkeys(range(0x13, 0x19), 0xFF),  # offsets of the gyroscope
    SMPLRT_DIV: 0xFF,
    CONFIG: 0x7F,
    GYRO_CONFIG: 0xFB,
    ACCEL_CONFIG: 0xF8,
    ACCEL_CONFIG_2: 0x0F,
    0x1E: 0x0F,
    0x1F: 0xFF,
    FIFO_EN: 0xFF,
    **dict.fromkeys(range(0x24, 0x35), 0xFF),  # registers of the auxiliary I2C bus
    INT_PIN_CFG: 0xFE,
    INT_ENABLE: 0x59,
    **dict.fromkeys(range(0x63, 0x67), 0xFF),
    0x67: 0x9F,
    0x69: 0xC0,
    USER_CTRL: 0x70,
    PWR_MGMT_1: 0x7F,
    PWR_MGMT_2: 0x3F,
    **dict.fromkeys([0x77, 0x78, 0x7A, 0x7B, 0x7D, 0x7E], 0xFF),  # offsets of the accelerometer
}


class Variant(NamedTuple):
    """Differences between the chips of the family.

    `reset`: registers that are not 0 after a reset. `has_fchoice`: bits of GYRO_CONFIG can select a rate of
    32 kHz. The divider SMPLRT_DIV leaves the rates of 32 kHz and 8 kHz as they are; if `has_fchoice` is
    False, it divides the 8 kHz. `fifo_reset_needs_off`: FIFO_RST works only while FIFO_EN in USER_CTRL is 0.
    `fifo_bytes`: capacity of the FIFO (product specification of the MPU-9250, 4.17, and of the MPU-6000,
    7.17).
    """

    who_am_i: int
    reset: dict[int, int]
    writable: dict[int, int]
    has_fchoice: bool
    fifo_reset_needs_off: bool
    fifo_bytes: int = 512


def variant_of(who_am_i: int) -> Variant:
    """Return the variant with this WHO_AM_I. For an unknown value it is an MPU-9250 with that value."""
    if who_am_i == 0x68:
        # The MPU-6050 lacks the bit FIFO_MODE. When its FIFO is full, the newest bytes always replace the
        # oldest (MPU-6000 register map, 26 and 116).
        writable = _WRITABLE | {CONFIG: 0x3F, GYRO_CONFIG: 0xF8, INT_ENABLE: 0x19, PWR_MGMT_2: 0xFF}
        del writable[ACCEL_CONFIG_2]  # reserved on the MPU-6050
        return Variant(who_am_i, {PWR_MGMT_1: 0x40}, writable, False, True, fifo_bytes=1024)
    return Variant(who_am_i, {PWR_MGMT_1: 0x01}, _WRITABLE, True, False)
