"""Counts to physical units (pure)."""

from fltea.records.events import RawSample
from fltea.records.records import Hello, Sample
from fltea.wire.sensors import temperature_c, temperature_counts

STANDARD_GRAVITY_MS2 = 9.80665


def to_units(
    raw: RawSample,
    hello: Hello,
    epoch: int,
    seq: int,
    device_us: int,
    host_ns: int,
    device: str | None = None,
) -> Sample:
    """Scale one sample: deg/s, m/s², °C, by the scales that HELLO gives.

    A null scale in HELLO means that the recording holds deg/s already.
    """
    lsb_per_dps = 1.0 if hello.gyro_lsb_per_dps is None else hello.gyro_lsb_per_dps
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
        device=device,
    )


def to_counts(sample: Sample, hello: Hello) -> RawSample:
    """Undo `to_units`, to the last bit: counts are whole numbers, so rounding restores them."""
    lsb, accel = hello.gyro_lsb_per_dps, None
    if sample.accel_ms2 is not None and hello.accel_lsb_per_g:
        accel = tuple(round(a * hello.accel_lsb_per_g / STANDARD_GRAVITY_MS2) for a in sample.accel_ms2)
    celsius = sample.temperature_c
    return RawSample(
        sample.seq,
        sample.device_us,
        sample.host_ns,
        sample.gyro_dps if lsb is None else tuple(round(g * lsb) for g in sample.gyro_dps),
        accel,
        None if celsius is None else temperature_counts(celsius, hello.who_am_i),
        sample.flags,
    )


def resolution_dps(hello: Hello) -> float | None:
    """One LSB of the gyroscope in deg/s, or None where the recording does not say."""
    return None if hello.gyro_lsb_per_dps is None else 1.0 / hello.gyro_lsb_per_dps


def accel_resolution_ms2(hello: Hello) -> float | None:
    """One LSB of the accelerometer in m/s², or None where its scale is not known."""
    return STANDARD_GRAVITY_MS2 / hello.accel_lsb_per_g if hello.accel_lsb_per_g else None
