"""Registers of the MPU-9250 that the driver uses, named as in firmware/core/mpu9250_registers.h.

The register map is RM-MPU-9250A-00. The MPU-6050 (RM-MPU-6000A-00) has all these registers except
ACCEL_CONFIG_2 and FIFO_MODE. A test compares the values here with those in the firmware's file.
"""

from typing import Final

SMPLRT_DIV: Final = 0x19
"""MPU-9250 register map, section 4.4: Output rate = internal rate / (1 + value)."""
CONFIG: Final = 0x1A
"""MPU-9250 register map, section 4.5: FIFO_MODE, and DLPF_CFG, the gyroscope's low-pass filter."""
GYRO_CONFIG: Final = 0x1B
"""MPU-9250 register map, section 4.6: Range of the gyroscope, and FCHOICE_B, which bypasses its filters."""
ACCEL_CONFIG: Final = 0x1C
"""MPU-9250 register map, section 4.7: Range of the accelerometer."""
ACCEL_CONFIG_2: Final = 0x1D
"""MPU-9250 register map, section 4.8: A_DLPF_CFG, the accelerometer's low-pass filter, and ACCEL_FCHOICE_B,
which bypasses it.
"""
FIFO_EN: Final = 0x23
"""MPU-9250 register map, section 4.11: Selects which data enter the FIFO."""
INT_PIN_CFG: Final = 0x37
"""MPU-9250 register map, section 4.19: Behaviour of the INT pin."""
INT_ENABLE: Final = 0x38
"""MPU-9250 register map, section 4.20: Switches the interrupts on."""
INT_STATUS: Final = 0x3A
"""MPU-9250 register map, section 4.21: Interrupt status; reading clears it."""
USER_CTRL: Final = 0x6A
"""MPU-9250 register map, section 4.33: Switches the FIFO on or off, and resets it."""
PWR_MGMT_1: Final = 0x6B
"""MPU-9250 register map, section 4.34: Reset, sleep, and choice of the clock."""
FIFO_COUNT_H: Final = 0x72
"""MPU-9250 register map, section 4.36: First of two registers with the number of bytes in the FIFO; reading
it latches both.
"""
FIFO_R_W: Final = 0x74
"""MPU-9250 register map, section 4.37: The FIFO's oldest byte; reading removes it. All reads in a transfer
use this address.
"""
WHO_AM_I: Final = 0x75
"""MPU-9250 register map, section 4.38: Identity of the chip."""

RESET: Final = 0x80
"""Bit of PWR_MGMT_1: H_RESET, which resets the chip."""
PLL_CLOCK: Final = 0x01
"""Value of PWR_MGMT_1: the chip is awake, and uses the PLL as its clock once the PLL is ready."""
PULSE_HIGH: Final = 0x00
"""Value of INT_PIN_CFG: the pin is push-pull and active high, and gives a pulse of 50 us."""
FIFO_OVERFLOW: Final = 0x10
"""Bit of INT_ENABLE and INT_STATUS: the FIFO's overflow (FIFO_OFLOW_EN, FIFO_OFLOW_INT)."""
FIFO_MODE_STOP: Final = 0x40
"""Bit of CONFIG: FIFO_MODE, with which a full FIFO accepts no more data."""
FIFO_ALL: Final = 0xF8
"""Value of FIFO_EN: temperature, rate and acceleration, which enter the FIFO in the order of their
registers.
"""
USER_FIFO_EN: Final = 0x40
"""Bit of USER_CTRL: FIFO_EN, which switches the FIFO on."""
USER_FIFO_RST: Final = 0x04
"""Bit of USER_CTRL: FIFO_RST, which empties the FIFO and then clears itself."""
RANGE_SHIFT: Final = 3
"""Bits 4:3 of GYRO_CONFIG and ACCEL_CONFIG select the range, so a range is shifted to the left by this number
of bits. FCHOICE_B, in the bits below, is left 0, so that the filters are not bypassed.
"""
