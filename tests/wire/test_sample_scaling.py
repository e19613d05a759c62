"""Tests of the conversion of counts to units, with values computed by hand."""

import pytest
from fltea.records.events import RawSample
from fltea.records.records import Sample
from fltea.records.sensor_kind import ACCELEROMETER, GYROSCOPE
from fltea.stream.decode import Decoder
from fltea.wire.sample_scaling import to_counts
from hypothesis import given
from hypothesis import strategies as st

from tests.rig.blocks import as_block, raw_samples
from tests.rig.host_support import hello

# MPU-9250 Product Specification PS-MPU-9250A-01 rev. 1.1, tables 1 and 2: full scale and LSB per unit.
GYRO_LSB_PER_DPS = {250: 131.0, 500: 65.5, 1000: 32.8, 2000: 16.4}
ACCEL_LSB_PER_G = {2: 16384.0, 4: 8192.0, 8: 4096.0, 16: 2048.0}


def scaled(*raw: RawSample, **changes: object) -> Sample:
    """Return the last of these samples, converted to units."""
    decoder = Decoder(lambda: 0, 100)
    list(decoder.feed(hello(**changes)))
    ((block, *_),) = decoder.feed(as_block(*raw))
    return list(block.samples())[-1]


def raw(**changes: object) -> RawSample:
    return RawSample(1, 2, 3, (164, -328, 0))._replace(**changes)


@pytest.mark.parametrize(("range_dps", "lsb"), GYRO_LSB_PER_DPS.items())
def test_gyro_at_every_range(range_dps: int, lsb: float) -> None:
    counts = (round(lsb * range_dps / 10), -1, 0)
    sample = scaled(raw(gyro=counts), gyro_lsb_per_dps=lsb)
    assert sample.gyro_dps == pytest.approx((range_dps / 10, -1 / lsb, 0.0))
    assert GYROSCOPE.resolution(hello(gyro_lsb_per_dps=lsb)) == pytest.approx(1 / lsb)


@pytest.mark.parametrize(("range_g", "lsb"), ACCEL_LSB_PER_G.items())
def test_accel_at_every_range(range_g: int, lsb: float) -> None:
    sample = scaled(raw(accel=(int(lsb), -int(lsb) // 2, 0)), accel_lsb_per_g=lsb)
    assert sample.accel_ms2 == pytest.approx((9.80665, -4.903325, 0.0))
    assert ACCELEROMETER.resolution(hello(accel_lsb_per_g=lsb)) == pytest.approx(9.80665 / lsb)


def test_hand_worked_sample() -> None:
    sample = scaled(raw(temperature=-1042, flags=5, accel=(-120, 85, 16390)))
    assert sample.gyro_dps == pytest.approx((10.0, -20.0, 0.0))
    assert sample.accel_ms2 == pytest.approx((-0.0718260, 0.0508768, 9.8102413), abs=1e-6)
    assert sample.temperature_c == pytest.approx(-1042 / 333.87 + 21.0) == pytest.approx(17.879, abs=5e-4)
    assert (sample.seq, sample.epoch, sample.device_us) == (1, 1, 2)
    assert (sample.host_ns, sample.flags) == (3, 5)


def test_temperature_is_by_the_chip() -> None:
    assert scaled(raw(temperature=0), who_am_i=0x68).temperature_c == pytest.approx(36.53)
    assert scaled(raw(temperature=0), who_am_i=0x71).temperature_c == pytest.approx(21.0)


def test_what_is_not_known_stays_none() -> None:
    sample = scaled(raw())
    assert sample.accel_ms2 is None
    assert sample.temperature_c is None
    assert ACCELEROMETER.resolution(hello(accel_lsb_per_g=0.0)) is None
    assert scaled(raw(accel=(1, 2, 3)), accel_lsb_per_g=0.0).accel_ms2 is None


def test_acceleration_without_a_scale_is_in_its_unit_already() -> None:
    assert scaled(raw(accel=(1.5, -2.25, 9.81)), accel_lsb_per_g=None).accel_ms2 == (1.5, -2.25, 9.81)


def test_recording_in_dps_passes_unchanged() -> None:
    sample = scaled(raw(gyro=(0.1, -0.2)), gyro_lsb_per_dps=None)
    assert sample.gyro_dps == (0.1, -0.2)
    assert GYROSCOPE.resolution(hello(gyro_lsb_per_dps=None)) is None


@given(
    raw_samples,
    st.integers(1, 2**16 - 1),
    st.integers(1, 2**16 - 1),
    st.sampled_from([0x68, 0x71, None]),
)
def test_counts_come_back_from_units(raw: RawSample, lsb: int, per_g: int, who_am_i: int | None) -> None:
    changes = {"gyro_lsb_per_dps": lsb / 10, "accel_lsb_per_g": float(per_g), "who_am_i": who_am_i}
    sample = scaled(raw, **changes)
    assert next(to_counts([sample, sample], hello(**changes)).samples()) == raw
