"""A run with an ICM-20948 on the Raspberry Pi's bus, against its emulated twin."""

import errno
import random

import pytest
from fake_smbus import MS, Pi, TellsTime

from tools.due_emulator.icm20948 import Icm20948
from tools.due_emulator.mpu9250 import Mpu9250


def test_a_run_without_gaps() -> None:
    pi = Pi(model=Icm20948).run_until(6.0)
    times = pi.check()
    assert len(times) > 5.5 * 125
    assert pi.missing == []
    assert pi.told == []
    hello = pi.hello
    assert (hello.sensor, hello.who_am_i, hello.rate_hz) == ("ICM-20948", 0xEA, 125.0)
    assert (hello.gyro_dlpf_hz, hello.gyro_lsb_per_dps, hello.accel_lsb_per_g) == (196.6, 16.4, 16384.0)
    assert {raw.temperature for raw in pi.raw} == {1335}


@pytest.mark.parametrize("ppm", [-60_000.0, 60_000.0])
def test_a_clock_far_from_its_nominal_rate_is_no_gap(ppm: float) -> None:
    """The chip's PLL differs from part to part, by more than that of an MPU-9250."""
    pi = Pi(model=Icm20948, clock_ppm=ppm).run_until(6.0)
    pi.check(ppm)
    assert pi.missing == []
    assert pi.told == []


def test_a_program_that_is_held_up() -> None:
    pi = Pi(model=Icm20948)
    pi.host.stall(14_000 * MS, 300 * MS)
    pi.host.stall(15_000 * MS, 1_000 * MS)
    pi.run_until(17.0).check()
    assert pi.told == ["fifo_overflow"]
    assert len(pi.missing) == 1
    assert 75 <= pi.missing[0] <= 90  # 1 s less the 42 samples that the FIFO held


def test_errors_on_the_bus_mix_up_no_banks() -> None:
    """Also those of the transfer that selects one: what is read then would be another register."""
    pi, chance = Pi(model=Icm20948), random.Random(5)

    def inject(messages: object) -> int | None:
        pi.bus.broken_at = chance.random()
        return chance.choice([errno.EREMOTEIO, errno.EIO]) if chance.random() < 0.03 else None

    pi.host.at(12_000 * MS, lambda: setattr(pi.bus, "inject", inject))
    pi.run_until(15.0).check()
    assert pi.epochs == ["start"]
    assert pi.status.i2c_errors > 10
    assert set(pi.told) <= {"fifo_restarted"}


def test_a_chip_in_the_place_of_another() -> None:
    """An MPU-9250 is taken out, and an ICM-20948 put in: another rate, another epoch."""
    pi = Pi(model=Mpu9250)
    pi.at(2.0, pi.chip.power_off)

    def exchange() -> None:
        pi.chip = pi.bus.chip = Icm20948(TellsTime())
        pi.chip.advance(pi.host.now_ns)

    pi.host.at(3_000 * MS, exchange)
    pi.run_until(6.0)
    assert [h.sensor for h in pi.of(type(pi.hello))] == ["MPU-9250", "ICM-20948"]
    assert pi.hello.rate_hz == 125.0
    assert pi.epochs == ["start", "sensor_restart"]
    assert pi.pipeline.stats().sample_counts.before_hello == 0
    assert len(pi.raw) > 2.5 * 125
