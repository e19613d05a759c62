"""The ICM-20948 on the Raspberry Pi's bus, against its emulated twin.

Register facts: DS-000189, revision 1.3; numbers typed by hand. A register of bank 2 has 0x200 above it.
"""

import errno
import itertools
import random

import pytest
from fake_smbus import MS, FakeBus, FakeHost, Pi, TellsTime, taken_ns
from fltea.records.errors import UsageError
from fltea.sources.i2c.driver import Driver, SensorFault, TransferFailed, chip_of
from fltea.sources.i2c.source import parse_url
from fltea.wire.layout import FaultCode
from fltea.wire.sensors import sensor_name
from smbus2 import i2c_msg

from tools.due_emulator.icm20948 import Icm20948
from tools.due_emulator.mpu9250 import Mpu9250

PERIOD_MS = 8
FITS = 42
"""Samples of 12 bytes in 512."""


class Bench:
    """Driver, bus and chip, and nothing else."""

    def __init__(self, family: str = "", **chip: object) -> None:
        self.host = FakeHost()
        self.chip = Icm20948(TellsTime(), **chip)
        self.bus = FakeBus(self.host, self.chip)
        self.bus.is_open = True
        self.driver = Driver(0x68, self.host.host_ns, family)
        self.driver.bus = self.bus

    def set_up(self) -> "Bench":
        self.driver.start_reset(self.driver.identify())
        self.wait(100)
        self.driver.configure()
        self.wait(50)
        self.driver.restart_fifo()
        return self

    def wait(self, ms: float) -> None:
        self.host.sleep(ms / 1000)
        self.chip.advance(self.host.now_ns)


@pytest.fixture
def bench() -> Bench:
    return Bench().set_up()


def test_what_is_set(bench: Bench) -> None:
    kept = bench.chip.register
    assert kept(0x006) == 0x01  # awake, the best clock
    assert kept(0x007) == 0x00  # all axes
    assert kept(0x200) == 8  # 1125 Hz / (1 + 8)
    assert kept(0x201) == 0x07  # GYRO_DLPFCFG 0: 196.6 Hz; ±2000 deg/s; filter on
    assert kept(0x209) == 0x01
    assert (kept(0x210), kept(0x211)) == (0, 8)
    assert kept(0x214) == 0x01  # ACCEL_DLPFCFG 0: 246 Hz; ±2 g; filter on
    assert kept(0x067) == 0x1E  # acceleration and the rate of three axes
    assert kept(0x069) == 0x01
    assert kept(0x068) == 0x00, "as long as it is set, the FIFO stays empty"
    assert kept(0x003) == 0x40
    assert bench.chip.output_hz == 125
    assert bench.driver.i2c_errors == 0


def test_it_is_known_by_its_identity() -> None:
    bench = Bench()
    assert bench.driver.identify() == 0xEA
    assert bench.chip.bank == 0
    assert sensor_name(0xEA) == "ICM-20948"


def test_nothing_is_written_to_a_chip_that_is_not_known() -> None:
    bench = Bench()
    bench.chip.bank = 2  # as if another program had been ended in its midst: looks like any other chip
    with pytest.raises(SensorFault) as refused:
        bench.driver.identify()
    assert refused.value.code == FaultCode.SENSOR_UNKNOWN
    assert bench.chip.bank == 2


def test_whoever_says_what_it_is_gets_it_from_any_bank() -> None:
    bench = Bench("icm20948")
    bench.chip.bank = 2
    assert bench.set_up().driver.identify() == 0xEA


def test_whoever_says_that_it_is_another_one_is_contradicted() -> None:
    with pytest.raises(SensorFault):
        Bench("mpu9250").driver.identify()


def test_samples_are_whole_and_in_order(bench: Bench) -> None:
    bench.wait(42)
    level = bench.driver.level()
    assert (level.bytes, level.overflowed) == (5 * 12, False)
    times = []
    for row in bench.driver.read_samples(5):
        accel, temperature, rate = bench.driver.counts(row)
        assert temperature == 1335  # (25 - 21) * 333.87 [8.30]
        times.append(taken_ns(tuple(map(float, rate)), accel))
    assert [b - a for a, b in itertools.pairwise(times)] == [PERIOD_MS * MS] * 4


@pytest.mark.parametrize("register", [0x006, 0x007, 0x200, 0x201, 0x210, 0x211, 0x214, 0x067, 0x069])
def test_a_setting_that_got_lost_is_found(bench: Bench, register: int) -> None:
    kept = bench.chip.register(register)
    bench.chip.spoil(register, kept ^ 0x01)
    with pytest.raises(SensorFault) as lost:
        bench.driver.check_settings()
    assert lost.value.detail == register << 16 | kept << 8 | kept ^ 0x01


def test_settings_and_samples_do_not_mix_up_their_banks(bench: Bench) -> None:
    for _ in range(5):
        bench.wait(20)
        bench.driver.check_settings()
        waiting = bench.driver.level().bytes // 12
        assert len(bench.driver.read_samples(waiting)) == waiting
    assert bench.driver.i2c_errors == 0


def test_a_bank_that_could_not_be_selected_is_selected_later(bench: Bench) -> None:
    bank = 0x00

    def refuse(messages: tuple[i2c_msg, ...]) -> int | None:
        return errno.EREMOTEIO if bytes(messages[0]) == bytes([0x7F, bank]) else None

    bench.wait(20)
    bench.bus.inject = refuse
    with pytest.raises(TransferFailed):  # on the way back from bank 2
        bench.driver.check_settings()
    bank = 0x20
    waiting = bench.driver.level().bytes
    assert (waiting >= 2 * 12, waiting % 12) == (True, 0)
    bench.bus.inject = lambda messages: None
    bench.driver.check_settings()


def test_a_full_fifo_keeps_the_oldest(bench: Bench) -> None:
    bench.wait(400)
    level = bench.driver.level()
    assert (level.bytes, level.overflowed) == (512, True)
    rows = [*bench.driver.read_samples(21), *bench.driver.read_samples(21)]
    assert rows[-1][0] - rows[0][0] == (FITS - 1) * PERIOD_MS * 10  # ticks of 0.1 ms
    bench.driver.restart_fifo()
    assert bench.driver.level()[:2] == (0, False)


def test_more_than_the_data_sheet_says_counts_as_overflow() -> None:
    bench = Bench(fifo_bytes=4096).set_up()
    bench.wait(400)
    level = bench.driver.level()
    assert level.bytes > 512
    assert level.overflowed


def test_bits_without_a_meaning_may_be_anything() -> None:
    for setting in chip_of(0xEA).settings:
        assert setting.kept(setting.value | ~setting.meaning & 0xFF)
        assert not setting.kept(setting.value ^ setting.meaning)


def test_the_url_may_name_the_chip() -> None:
    assert parse_url("///dev/i2c-1?addr=0x69&chip=icm20948") == ("/dev/i2c-1", 0x69, "icm20948")
    with pytest.raises(UsageError, match="mpu9250 or icm20948, not 'bmi088'"):
        parse_url("///dev/i2c-1?chip=bmi088")


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


def test_a_chip_that_forgets_is_set_up_again() -> None:
    pi = Pi(model=Icm20948)
    pi.at(2.0, pi.chip.brown_out).run_until(5.0)
    pi.check()
    assert pi.epochs == ["start", "sensor_restart"]
    assert "device_fault" in pi.told
    assert pi.hello.sensor_starts == 2


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
    assert pi.pipeline.stats().samples.before_hello == 0
    assert len(pi.raw) > 2.5 * 125
