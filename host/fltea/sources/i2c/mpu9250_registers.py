"""Registers of the MPU-9250 that the driver uses, with the names of firmware/core/mpu9250_registers.h.

Numbers in brackets are sections of the register map RM-MPU-9250A-00. The MPU-6050 (RM-MPU-6000A-00) has all
these registers except ACCEL_CONFIG_2 and FIFO_MODE. A test compares the values in both files.
"""

from typing import Final

SMPLRT_DIV: Final = 0x19
"""[4.4] Output rate = internal rate / (1 + value)."""
CONFIG: Final = 0x1A
"""[4.5] FIFO_MODE, DLPF_CFG of the gyroscope."""
GYRO_CONFIG: Final = 0x1B
"""[4.6] Range, FCHOICE_B."""
ACCEL_CONFIG: Final = 0x1C
"""[4.7] Range."""
ACCEL_CONFIG_2: Final = 0x1D
"""[4.8] A_DLPF_CFG, ACCEL_FCHOICE_B."""
FIFO_EN: Final = 0x23
"""[4.11] Selects the data for the FIFO."""
INT_PIN_CFG: Final = 0x37
"""[4.19] Behaviour of the INT pin."""
INT_ENABLE: Final = 0x38
"""[4.20]"""
INT_STATUS: Final = 0x3A
"""[4.21] Interrupt status; reading clears it."""
USER_CTRL: Final = 0x6A
"""[4.33] Switches the FIFO on or off, and resets it."""
PWR_MGMT_1: Final = 0x6B
"""[4.34] Reset, sleep, clock."""
FIFO_COUNT_H: Final = 0x72
"""[4.36] First of two registers with the number of bytes in the FIFO; reading this register latches both."""
FIFO_R_W: Final = 0x74
"""[4.37] The oldest byte in the FIFO; reading removes the byte. All reads in a transfer use this address."""
WHO_AM_I: Final = 0x75
"""[4.38]"""

RESET: Final = 0x80
"""PWR_MGMT_1: H_RESET."""
PLL_CLOCK: Final = 0x01
"""PWR_MGMT_1: awake, with the PLL as clock once it is ready."""
PULSE_HIGH: Final = 0x00
"""INT_PIN_CFG: push-pull, active high, a pulse of 50 us."""
FIFO_OVERFLOW: Final = 0x10
"""INT_ENABLE and INT_STATUS: FIFO_OFLOW_EN and FIFO_OFLOW_INT."""
FIFO_MODE_STOP: Final = 0x40
"""CONFIG: FIFO_MODE; a full FIFO then accepts no more data."""
FIFO_ALL: Final = 0xF8
"""FIFO_EN: temperature, rate, acceleration; the chip writes them in the order of its output registers."""
USER_FIFO_EN: Final = 0x40
"""USER_CTRL: FIFO_EN."""
USER_FIFO_RST: Final = 0x04
"""USER_CTRL: FIFO_RST, which clears itself."""
RANGE_SHIFT: Final = 3
"""Shift of FS_SEL and ACCEL_FS_SEL, bits 4:3; with FCHOICE_B = 0 in the bits below, the filters are on."""
