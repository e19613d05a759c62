"""Counts to physical units (pure)."""

from fltea.model import Hello, RawSample, Sample
from fltea.mpu9250 import temperature_c

STANDARD_GRAVITY_MS2 = 9.80665


def to_units(raw: RawSample, hello: Hello, epoch: int, seq: int, device_us: int, host_ns: int) -> Sample:
    """Scale one sample: deg/s, m/s², °C, by the scales that HELLO gives.

    A null scale in HELLO means that the recording holds deg/s already.
    """
    lsb_per_dps = hello.gyro_lsb_per_dps or 1.0
    accel = None
    if raw.accel is not None and hello.accel_lsb_per_g:
        scale = STANDARD_GRAVITY_MS2 / hello.accel_lsb_per_g
        accel = tuple(a * scale for a in raw.accel)
    return Sample(
        seq=seq,
        epoch=epoch,
        device_us=device_us,
        host_ns=host_ns,
        gyro_dps=tuple(g / lsb_per_dps for g in raw.gyro),
        accel_ms2=accel,
        temperature_c=None if raw.temperature is None else temperature_c(raw.temperature, hello.who_am_i),
        flags=raw.flags,
    )


def resolution_dps(hello: Hello) -> float | None:
    """One LSB of the gyroscope in deg/s, or None where the recording does not say."""
    return 1.0 / hello.gyro_lsb_per_dps if hello.gyro_lsb_per_dps else None
