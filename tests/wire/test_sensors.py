"""Constants of the sensor family, typed by hand from the vendors' documents.

MPU-9250: register map RM-MPU-9250A-00 rev. 1.6, register 117; product specification PS-MPU-9250A-01
rev. 1.1, section 3.4.2 (333.87 LSB/°C, 0 LSB at 21 °C). MPU-6050: register map RM-MPU-6000A-00 rev. 4.2,
registers 65 and 66 ("Temperature in degrees C = TEMP_OUT / 340 + 36.53") and 117 (0x68). MPU-9255: register
map RM-MPU-9255A-00, register 117 (0x73). MPU-6500: register map RM-MPU-6500A-00, register 117 (0x70).
ICM-20948: DS-000189, 8.1 (0xEA).
"""

import pytest
from fltea.wire.sensors import sensor_name, temperature_c


@pytest.mark.parametrize(
    ("who_am_i", "name"),
    [
        (0x71, "MPU-9250"),
        (0x73, "MPU-9255"),
        (0x70, "MPU-6500"),
        (0x68, "MPU-6050"),
        (0x75, "MPU-9250 clone (0x75)"),
        (0x78, "MPU-9250 clone (0x78)"),
        (0xEA, "ICM-20948"),
        (0xFF, "unknown sensor (WHO_AM_I 0xFF)"),
        (0x0A, "unknown sensor (WHO_AM_I 0x0A)"),
        (0, "no sensor"),
    ],
)
def test_name_of_a_chip(who_am_i: int, name: str) -> None:
    assert sensor_name(who_am_i) == name


@pytest.mark.parametrize(("counts", "celsius"), [(0, 21.0), (33387, 121.0), (-3339, 10.999), (1336, 25.0016)])
@pytest.mark.parametrize("who_am_i", [0x71, 0x73, 0x70, 0x75, 0x78, None])
def test_thermometer_of_the_9250(who_am_i: int | None, counts: int, celsius: float) -> None:
    assert temperature_c(counts, who_am_i) == pytest.approx(celsius, abs=5e-4)


@pytest.mark.parametrize(("counts", "celsius"), [(0, 36.53), (3400, 46.53), (-12420, 0.0006)])
def test_thermometer_of_the_6050(counts: int, celsius: float) -> None:
    assert temperature_c(counts, 0x68) == pytest.approx(celsius, abs=5e-4)
