"""The driver against the chip model: what it writes, what it believes, what it tries again.

Register facts: RM-MPU-9250A-00 and, for the MPU-6050, RM-MPU-6000A-00; numbers typed by hand.
"""

import errno
import re
from pathlib import Path

import pytest
from fake_smbus import MS, FakeBus, FakeHost, TellsTime
from fltea.sources.i2c import mpu9250_registers as reg
from fltea.sources.i2c.driver import TRIES, Driver, SensorFault, TransferFailed, chip_of
from fltea.wire.layout import FaultCode
from fltea.wire.sensors import MPU_FAMILY
from smbus2 import i2c_msg

from tools.due_emulator.mpu9250 import Mpu9250

ROOT = Path(__file__).resolve().parents[2]
HEADER = ROOT / "firmware/core/mpu9250_registers.h"


class Bench:
    """Driver, bus and chip, and nothing else."""

    def __init__(self, **chip: object) -> None:
        self.host = FakeHost()
        self.chip = Mpu9250(TellsTime(), **chip)
        self.bus = FakeBus(self.host, self.chip)
        self.bus.is_open = True
        self.driver = Driver(self.chip.address, self.host.host_ns)
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

    def fail(self, *numbers: int) -> None:
        """Let the next transactions fail with these errnos, 0 for none."""
        left = list(numbers)
        self.bus.inject = lambda messages: (left.pop(0) or None) if left else None

    def registers(self) -> dict[int, int]:
        return {
            register: self.chip.read_block(register, 1)[0] for register in (*range(0x19, 0x24), 0x37, 0x38)
        }


@pytest.fixture
def bench() -> Bench:
    return Bench().set_up()


def constants_of_the_firmware() -> dict[str, int]:
    """`kSmplrtDiv` is SMPLRT_DIV, and so on."""
    found = re.findall(r"constexpr uint8_t k(\w+) = (\w+);", HEADER.read_text(encoding="utf-8"))
    return {re.sub(r"(?<=[a-z])(?=[A-Z0-9])", "_", name).upper(): int(value, 0) for name, value in found}


def test_firmware_and_host_mean_the_same_registers() -> None:
    firmware = constants_of_the_firmware()
    host = {name: value for name, value in vars(reg).items() if name.isupper()}
    theirs_alone = {"ACCEL_XOUT_H", "RAW_READY"}  # they poll the output registers; here the FIFO is read
    assert len(firmware) == 15
    assert {name: host[name] for name in firmware.keys() - theirs_alone} == {
        name: value for name, value in firmware.items() if name not in theirs_alone
    }


def test_the_registers_that_the_firmware_does_not_use() -> None:
    assert (reg.FIFO_EN, reg.INT_STATUS, reg.USER_CTRL, reg.FIFO_COUNT_H, reg.FIFO_R_W) == (
        35,
        58,
        106,
        114,
        116,
    )


def test_what_is_set(bench: Bench) -> None:
    kept = bench.registers()
    assert kept[0x19] == 9  # 1 kHz / (1 + 9)
    assert kept[0x1A] == 0x41  # DLPF_CFG 1: 184 Hz; FIFO_MODE
    assert kept[0x1B] == 0x18  # ±2000 deg/s
    assert kept[0x1C] == 0x00  # ±2 g
    assert kept[0x1D] == 0x01  # 184 Hz
    assert kept[0x23] == 0xF8  # temperature, three axes, acceleration
    assert kept[0x38] == 0x10  # FIFO_OFLOW_EN
    assert bench.chip.read_block(0x6A, 2) == b"\x40\x01"
    assert bench.chip.output_hz == 100


def test_what_is_set_on_an_mpu6050() -> None:
    bench = Bench(who_am_i=0x68).set_up()
    kept = bench.registers()
    assert (kept[0x1A], kept[0x1B], kept[0x1D]) == (0x01, 0x18, 0x00)  # neither FIFO_MODE nor ACCEL_CONFIG_2
    bench.wait(45)
    assert bench.driver.level().bytes == 4 * 14


@pytest.mark.parametrize("who_am_i", MPU_FAMILY)
def test_every_relative_is_set_up_and_read(who_am_i: int) -> None:
    bench = Bench(who_am_i=who_am_i).set_up()
    assert bench.driver.identify() == who_am_i
    bench.wait(35)
    assert len(bench.driver.read_samples(3)) == 3
    bench.driver.check_settings()
    assert bench.driver.i2c_errors == 0


def test_an_unknown_chip_is_refused_by_its_number() -> None:
    with pytest.raises(SensorFault) as refused:
        Bench(who_am_i=0x12).driver.identify()
    assert (refused.value.code, refused.value.detail) == (FaultCode.SENSOR_UNKNOWN, 0x12)


def test_a_flipped_bit_of_the_identity_is_asked_again(bench: Bench) -> None:
    answers = iter([b"\x70\xff"[1:], b"\x71"])
    bench.bus.spoil = lambda register, data: next(answers)
    assert bench.driver.identify() == 0x71


def test_samples_come_in_the_order_of_the_output_registers(bench: Bench) -> None:
    bench.wait(25)
    bench.driver.read_samples(1)
    row = bench.driver.read_samples(1)[0]
    x, y, z, temperature, *rate = row
    assert [x, y, z] == rate
    assert x ^ y == z
    assert temperature == 1335  # (25 - 21) * 333.87


@pytest.mark.parametrize("number", [errno.EREMOTEIO, errno.EIO, errno.ETIMEDOUT, errno.ENXIO, errno.EAGAIN])
def test_a_transfer_that_fails_is_tried_again(bench: Bench, number: int) -> None:
    bench.fail(number, number)
    bench.driver.check_settings()
    assert bench.driver.i2c_errors == 2
    assert bench.driver.retried


def test_tries_are_bounded(bench: Bench) -> None:
    bench.fail(*[errno.EREMOTEIO] * 10)
    before = bench.bus.transactions
    with pytest.raises(TransferFailed) as failed:
        bench.driver.level()
    assert bench.bus.transactions - before == TRIES
    assert not failed.value.acknowledged


@pytest.mark.parametrize("number", [errno.ENODEV, errno.EBADF, errno.EOPNOTSUPP])
def test_a_bus_that_is_gone_is_not_asked_again(bench: Bench, number: int) -> None:
    bench.fail(number)
    before = bench.bus.transactions
    with pytest.raises(OSError, match=r".") as failed:
        bench.driver.level()
    assert failed.value.errno == number
    assert bench.bus.transactions - before == 1


def test_a_refused_read_of_the_fifo_loses_nothing(bench: Bench) -> None:
    bench.wait(35)
    bench.fail(errno.EREMOTEIO, errno.EREMOTEIO)
    first, second, third = bench.driver.read_samples(3)
    assert second[0] - first[0] == third[0] - second[0] == 100


def test_a_broken_read_of_the_fifo_is_never_repeated(bench: Bench) -> None:
    """What it had read is gone: a second try would give the rest as if it were the beginning."""
    bench.wait(35)
    bench.fail(errno.EIO)
    before = bench.bus.transactions
    with pytest.raises(TransferFailed) as failed:
        bench.driver.read_samples(3)
    assert bench.bus.transactions - before == 1
    assert failed.value.acknowledged
    assert bench.driver.level().bytes % 14


def test_level_and_overflow(bench: Bench) -> None:
    bench.wait(352)
    level = bench.driver.level()
    assert (level.bytes, level.overflowed) == (35 * 14, False)
    assert 0 < level.after_ns - level.before_ns < MS
    bench.wait(40)
    level = bench.driver.level()
    assert (level.bytes, level.overflowed) == (512, True)
    bench.driver.read_samples(18)
    assert bench.driver.level().overflowed, "the flag is cleared by reading it, but what it told stays true"
    bench.driver.restart_fifo()
    assert bench.driver.level()[:2] == (0, False)


@pytest.mark.parametrize("register", [0x19, 0x1A, 0x1B, 0x1C, 0x1D, 0x23])
def test_a_setting_that_got_lost_is_found(bench: Bench, register: int) -> None:
    kept = bench.chip.read_block(register, 1)[0]
    bench.chip.write_register(register, kept ^ 0x08)
    with pytest.raises(SensorFault) as lost:
        bench.driver.check_settings()
    assert lost.value.code == FaultCode.READBACK_MISMATCH
    assert lost.value.detail == register << 16 | kept << 8 | kept ^ 0x08


def test_a_flipped_bit_of_a_setting_is_asked_again(bench: Bench) -> None:
    spoilt = iter([True])
    bench.bus.spoil = lambda register, data: bytes([data[0] ^ 1]) + data[1:] if next(spoilt, False) else data
    bench.driver.check_settings()
    assert bench.driver.i2c_errors == 1


def test_bits_without_a_meaning_may_be_anything() -> None:
    for setting in chip_of(0x71).settings:
        assert setting.kept(setting.value | ~setting.meaning & 0xFF)
        assert not setting.kept(setting.value ^ setting.meaning)


def test_the_fake_bus_refuses_what_a_raspberry_pi_refuses(bench: Bench) -> None:
    read = [i2c_msg.write(0x68, [0x75]), i2c_msg.read(0x68, 1)]
    bench.bus.i2c_rdwr(*read)
    with pytest.raises(OSError, match="only one read") as refused:
        bench.bus.i2c_rdwr(*read, *read)
    assert refused.value.errno == errno.EOPNOTSUPP
