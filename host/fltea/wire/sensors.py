"""Lists the sensors that fltea knows: value of the register WHO_AM_I, name, and scale of the thermometer.

Sources: MPU-9250 register map RM-MPU-9250A-00, registers 65-66 and 117; MPU-6050 register map
RM-MPU-6000A-00, registers 65-66 and 117; ICM-20948 data sheet DS-000189, sections 8.1 and 8.30.

For sensors on a Raspberry Pi's I²C bus, `sources/i2c` holds the registers of each family of chips.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Counts = NDArray[np.int16] | NDArray[np.float64]


class Sensor(NamedTuple):
    """One kind of sensor chip that fltea knows.

    `family`: key of the chip's family in `sources.i2c.chips.CHIPS`. All chips of a family have the same
    registers.
    `lsb_per_c`: scale of the thermometer [LSB per °C].
    `zero_c`: temperature at 0 counts [°C].
    `note`: warning for the owner of a chip that is a relative or a clone of the MPU-9250; empty for other
    chips.
    """

    name: str
    family: str
    lsb_per_c: float
    zero_c: float
    note: str = ""

    @property
    def is_clone(self) -> bool:
        """Whether the chip is a clone, which is sold under the name of another chip."""
        return self.note == _CLONE


_CLONE = "a chip that is sold as an MPU-9250. It is read with an MPU-9250's scales, but its noise may differ."
_SIX_AXES = "often sold as an MPU-9250. It has the same kind of gyroscope, but no magnetometer."
_OLDER = "an older chip that is sold in its place. The scales are the same, but the noise differs."

SENSORS = {
    0x71: Sensor("MPU-9250", "mpu9250", 333.87, 21.0),
    0x73: Sensor("MPU-9255", "mpu9250", 333.87, 21.0),
    0x70: Sensor("MPU-6500", "mpu9250", 333.87, 21.0, _SIX_AXES),
    0x68: Sensor("MPU-6050", "mpu9250", 340.0, 36.53, _OLDER),
    0x75: Sensor("MPU-9250 clone (0x75)", "mpu9250", 333.87, 21.0, _CLONE),
    0x78: Sensor("MPU-9250 clone (0x78)", "mpu9250", 333.87, 21.0, _CLONE),
    0xEA: Sensor("ICM-20948", "icm20948", 333.87, 21.0),
}
"""All known chips by their WHO_AM_I. To add a chip, add a row here and the chip's family in `sources/i2c`."""

NO_SENSOR = 0
"""Value of WHO_AM_I in HELLO while no sensor has answered the device."""

_UNKNOWN = SENSORS[0x71]
"""The chip whose thermometer scale is also used for unknown chips."""


def known_sensors() -> str:
    """Return the names of all known chips except clones as text, such as "A, B or C"."""
    *others, last = (sensor.name for sensor in SENSORS.values() if not sensor.is_clone)
    return f"{', '.join(others)} or {last}"


def relative_text(who_am_i: int) -> str | None:
    """Return a warning for the owner of a relative or a clone of the MPU-9250; None for other chips."""
    sensor = SENSORS.get(who_am_i)
    return f"the sensor is no MPU-9250 but {sensor.name}, {sensor.note}" if sensor and sensor.note else None


def sensor_name(who_am_i: int) -> str:
    """Return the name of the chip with this WHO_AM_I.

    For 0, the name is "no sensor". For an unknown chip, the name is a text that contains the value of
    WHO_AM_I.
    """
    if who_am_i == NO_SENSOR:
        return "no sensor"
    sensor = SENSORS.get(who_am_i)
    return sensor.name if sensor else f"unknown sensor (WHO_AM_I 0x{who_am_i:02X})"


def temperature_counts(celsius: float, who_am_i: int | None) -> int:
    """Return the counts in the register TEMP_OUT for a temperature [°C].

    This is the inverse of `temperature_c`.
    """
    lsb_per_c, zero_c = temperature_scale(who_am_i)
    return round((celsius - zero_c) * lsb_per_c)


def temperature_c(raw: Counts, who_am_i: int | None) -> NDArray[np.float64]:
    """Return die temperatures [°C] from counts of the register TEMP_OUT."""
    lsb_per_c, zero_c = temperature_scale(who_am_i)
    return raw / lsb_per_c + zero_c


def temperature_scale(who_am_i: int | None) -> tuple[float, float]:
    """Return the thermometer's scale [LSB per °C] and the temperature at 0 counts [°C]."""
    sensor = _UNKNOWN if who_am_i is None else SENSORS.get(who_am_i, _UNKNOWN)
    return sensor.lsb_per_c, sensor.zero_c
