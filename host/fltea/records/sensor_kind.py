"""Declare what the axes, units and fields of gyroscopes and of accelerometers are called.

Code that loops over `SENSOR_KINDS` treats gyroscope and accelerometer in the same way. Chips, such as the
MPU-9250, are listed in `wire/sensors.py`.
"""

from typing import NamedTuple, Protocol

from fltea.records.units import STANDARD_GRAVITY_MS2


class WithScales(Protocol):
    """An object, such as `Hello`, that states the scales of both sensors.

    A scale is None if the sensor's samples are no counts.
    """

    @property
    def gyro_lsb_per_dps(self) -> float | None:
        """Counts in 1 deg/s."""

    @property
    def accel_lsb_per_g(self) -> float | None:
        """Counts in 1 g."""


class SensorKind(NamedTuple):
    """Names and units of a gyroscope or an accelerometer."""

    name: str
    """The sensor's name in records, saved states and arrays."""
    axes: tuple[str, str, str]
    """Names of the axes, in the order of every tuple of samples."""
    unit: str
    """Unit of the samples in records."""
    text_unit: str
    """The unit of the samples in texts for people, and in figures of `fltea identify`."""
    column_unit: str
    """The unit of the samples as it is spelled in names of columns and fields, such as gyro_dps."""
    quantity: str
    """What the sensor measures, in a word."""
    settings: str
    """Name of the settings of the sensor's filters, in the configuration."""
    scale_field: str
    """Field of `Hello` that states the sensor's scale, the number of counts in 1 deg/s or in 1 g."""
    scale_size: float
    """The quantity whose counts `scale_field` states, in `unit`: 1 for 1 deg/s in deg/s, 9.80665 for 1 g in
    m/s².
    """

    def resolution(self, hello: WithScales) -> float | None:
        """Return the size of one count in `unit`; None if it is not known, or the samples are not counts."""
        scale: float | None = getattr(hello, self.scale_field)
        return self.scale_size / scale if scale else None

    @property
    def samples_field(self) -> str:
        """Name of the field in which records and blocks hold this sensor's samples: gyro_dps or accel_ms2."""
        return f"{self.name}_{self.column_unit}"


GYROSCOPE = SensorKind(
    name="gyro",
    axes=("gyro_x", "gyro_y", "gyro_z"),
    unit="deg/s",
    text_unit="deg/s",
    column_unit="dps",
    quantity="rate",
    settings="estimator",
    scale_field="gyro_lsb_per_dps",
    scale_size=1.0,
)
ACCELEROMETER = SensorKind(
    name="accel",
    axes=("accel_x", "accel_y", "accel_z"),
    unit="m/s^2",
    text_unit="m/s²",
    column_unit="ms2",
    quantity="acceleration",
    settings="accel",
    scale_field="accel_lsb_per_g",
    scale_size=STANDARD_GRAVITY_MS2,
)
SENSOR_KINDS = (GYROSCOPE, ACCELEROMETER)
"""Both kinds, in the order in which their axes are listed."""


def kind_of(axis: str) -> SensorKind:
    """Return the kind of sensor to which an axis belongs.

    An axis with an unknown name counts as a gyroscope's.
    """
    return ACCELEROMETER if axis in ACCELEROMETER.axes else GYROSCOPE
