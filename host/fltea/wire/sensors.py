"""The MPU-9250 family and the ICM-20948: who answers to which WHO_AM_I, and the scale of its thermometer.

Sources: MPU-9250 register map RM-MPU-9250A-00, registers 65-66 and 117; MPU-6050 register map
RM-MPU-6000A-00, registers 65-66 and 117; ICM-20948 data sheet DS-000189, 8.1 and 8.30.
"""

import numpy as np
from numpy.typing import NDArray

Counts = NDArray[np.int16] | NDArray[np.float64]

MPU_FAMILY = {
    0x71: "MPU-9250",
    0x73: "MPU-9255",
    0x70: "MPU-6500",
    0x68: "MPU-6050",
    0x75: "MPU-9250 clone (0x75)",
    0x78: "MPU-9250 clone (0x78)",
}
"""WHO_AM_I to name, of chips that have the MPU-9250's registers."""

ICM20948 = 0xEA
SENSORS = MPU_FAMILY | {ICM20948: "ICM-20948"}
"""WHO_AM_I to name, of all chips with a known scale."""

NO_SENSOR = 0
"""WHO_AM_I in HELLO while no sensor has answered."""

_CLONE = "a chip sold as MPU-9250: its scales are taken for the same, its noise may be any."
RELATIVES = {
    0x70: "often sold as MPU-9250: the same kind of gyroscope, but no magnetometer.",
    0x68: "an older chip sold in its place: the scales are the same, the noise is not.",
    0x75: _CLONE,
    0x78: _CLONE,
}
"""What the owner of a relative or clone ought to know."""


def sensor_name(who_am_i: int) -> str:
    """Return the name of the chip with this WHO_AM_I: "no sensor" for 0, the number for an unknown one."""
    if who_am_i == NO_SENSOR:
        return "no sensor"
    return SENSORS.get(who_am_i, f"unknown sensor (WHO_AM_I 0x{who_am_i:02X})")


def temperature_counts(celsius: float, who_am_i: int | None) -> int:
    """Return counts of TEMP_OUT from °C: the inverse of `temperature_c`."""
    lsb_per_c, zero_c = temperature_scale(who_am_i)
    return round((celsius - zero_c) * lsb_per_c)


def temperature_c(raw: Counts, who_am_i: int | None) -> NDArray[np.float64]:
    """Return die temperatures in °C from counts of TEMP_OUT."""
    lsb_per_c, zero_c = temperature_scale(who_am_i)
    return raw / lsb_per_c + zero_c


def temperature_scale(who_am_i: int | None) -> tuple[float, float]:
    """Return counts of TEMP_OUT a °C, and the temperature of 0 counts."""
    return (340.0, 36.53) if who_am_i == 0x68 else (333.87, 21.0)
