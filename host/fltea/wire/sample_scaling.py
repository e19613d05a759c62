"""Converts the raw counts of samples to physical units and back, with the scales that HELLO states."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from fltea.records.events import RawBlock
from fltea.records.records import Hello, Sample
from fltea.records.units import STANDARD_GRAVITY_MS2
from fltea.wire.sensors import temperature_counts, temperature_scale


class Scales(NamedTuple):
    """Factors from counts to physical units.

    If a scale in HELLO is null, the samples are already in the physical unit, not in counts.
    """

    gyro_lsb_per_dps: float
    """Sensitivity of the gyroscope [LSB per deg/s]; 1 if the rates are already in deg/s."""
    accel_ms2_per_lsb: float | None
    """Size of one accelerometer count [m/s²]; None if the scale is not known."""
    temperature_lsb_per_c: float
    """Scale of the thermometer [LSB per °C]."""
    temperature_zero_c: float
    """Temperature at 0 counts [°C]."""

    @classmethod
    def of(cls, hello: Hello) -> "Scales":
        """Return the scales in a HELLO."""
        lsb, per_g = hello.gyro_lsb_per_dps, hello.accel_lsb_per_g
        accel = 1.0 if per_g is None else STANDARD_GRAVITY_MS2 / per_g if per_g else None
        return cls(1.0 if lsb is None else lsb, accel, *temperature_scale(hello.who_am_i))


def to_counts(samples: Sequence[Sample], hello: Hello) -> RawBlock:
    """Convert samples in physical units back to counts. All samples must have the same fields."""
    lsb, first = hello.gyro_lsb_per_dps, samples[0]
    gyro = np.array([sample.gyro_dps for sample in samples])
    accel = temperature = None
    if first.accel_ms2 is not None:
        values = np.array([sample.accel_ms2 for sample in samples])
        per_g = hello.accel_lsb_per_g
        accel = np.rint(values * per_g / STANDARD_GRAVITY_MS2) if per_g else values
    if first.temperature_c is not None:
        temperature = np.array(
            [temperature_counts(sample.temperature_c or 0.0, hello.who_am_i) for sample in samples]
        )
    return RawBlock(
        np.array([sample.seq for sample in samples]),
        np.array([sample.device_us for sample in samples]),
        np.array([sample.host_ns for sample in samples]),
        gyro if lsb is None else np.rint(gyro * lsb),
        accel,
        temperature,
        np.array([sample.flags for sample in samples]),
    )
