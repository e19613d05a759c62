"""The driver against the emulated chips: what it writes, what it believes, what it tries again.

Register facts: RM-MPU-9250A-00, for the MPU-6050 RM-MPU-6000A-00, for the ICM-20948 DS-000189 (revision 1.3);
numbers typed by hand. A register of the ICM-20948's bank 2 has 0x200 above it.
"""

import errno
import itertools
import re

import pytest
from fake_smbus import MS, FakeBus, FakeHost, TellsTime, taken_ns
from fltea.sources.i2c import mpu9250_registers as reg
from fltea.sources.i2c.driver import TRIES, Driver, SensorFault, TransferFailed, chip_of
from fltea.wire.layout import FaultCode
from fltea.wire.sensors import MPU_FAMILY
from host_support import ROOT
from smbus2 import i2c_msg

from tools.due_emulator.icm20948 import Icm20948
from tools.due_emulator.mpu9250 import Mpu9250

HEADER = ROOT / "firmware/core/mpu9250_registers.h"
PERIOD_MS: dict[type, int] = {Mpu9250: 10, Icm20948: 8}


class Bench:
    """Driver, bus and chip, and nothing else."""

    def __init__(self, model: type[Mpu9250 | Icm20948] = Mpu9250, family: str = "", **chip: object) -> None:
        self.host = FakeHost()
        self.chip = model(TellsTime(), **chip)
        self.bus = FakeBus(self.host, self.chip)
        self.bus.is_open = True
        self.driver = Driver(self.chip.address, self.host.host_ns, family)
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

    def kept(self, register: int) -> int:
        if isinstance(self.chip, Icm20948):
            return self.chip.register(register)
        return self.chip.read_block(register, 1)[0]

    def spoil(self, register: int, value: int) -> None:
        """Let a register hold something else, without the driver's doing."""
        if isinstance(self.chip, Icm20948):
            self.chip.spoil(register, value)
        else:
            self.chip.write_register(register, value)


@pytest.fixture
def bench() -> Bench:
    return Bench().set_up()


@pytest.fixture
def icm() -> Bench:
    return Bench(Icm20948).set_up()


def test_firmware_and_host_mean_the_same_registers() -> None:
    found = re.findall(r"constexpr uint8_t k(\w+) = (\w+);", HEADER.read_text(encoding="utf-8"))
    # `kSmplrtDiv` is SMPLRT_DIV, and so on.
    firmware = {re.sub(r"(?<=[a-z])(?=[A-Z0-9])", "_", name).upper(): int(value, 0) for name, value in found}
    host = {name: value for name, value in vars(reg).items() if name.isupper()}
    theirs_alone = {"ACCEL_XOUT_H", "RAW_READY"}  # they poll the output registers; here the FIFO is read
    assert len(firmware) == 15
    assert {name: host[name] for name in firmware.keys() - theirs_alone} == {
        name: value for name, value in firmware.items() if name not in theirs_alone
    }
    ours_alone = (reg.FIFO_EN, reg.INT_STATUS, reg.USER_CTRL, reg.FIFO_COUNT_H, reg.FIFO_R_W)
    assert ours_alone == (35, 58, 106, 114, 116)


@pytest.mark.parametrize(
    ("bench", "expected", "output_hz"),
    [
        (
            Bench(),
            {
                0x19: 9,  # 1 kHz / (1 + 9)
                0x1A: 0x41,  # DLPF_CFG 1: 184 Hz; FIFO_MODE
                0x1B: 0x18,  # ±2000 deg/s
                0x1C: 0x00,  # ±2 g
                0x1D: 0x01,  # 184 Hz
                0x23: 0xF8,  # temperature, three axes, acceleration
                0x38: 0x10,  # FIFO_OFLOW_EN
                0x6A: 0x40,
                0x6B: 0x01,
            },
            100,
        ),
        # Neither FIFO_MODE nor ACCEL_CONFIG_2.
        (Bench(who_am_i=0x68), {0x1A: 0x01, 0x1B: 0x18, 0x1D: 0x00}, 100),
        (
            Bench(Icm20948),
            {
                0x006: 0x01,  # awake, the best clock
                0x007: 0x00,  # all axes
                0x200: 8,  # 1125 Hz / (1 + 8)
                0x201: 0x07,  # GYRO_DLPFCFG 0: 196.6 Hz; ±2000 deg/s; filter on
                0x209: 0x01,
                0x210: 0,
                0x211: 8,
                0x214: 0x01,  # ACCEL_DLPFCFG 0: 246 Hz; ±2 g; filter on
                0x067: 0x1E,  # acceleration and the rate of three axes
                0x069: 0x01,
                0x068: 0x00,  # as long as it is set, the FIFO stays empty
                0x003: 0x40,
            },
            125,
        ),
    ],
    ids=["MPU-9250", "MPU-6050", "ICM-20948"],
)
def test_what_is_set(bench: Bench, expected: dict[int, int], output_hz: int) -> None:
    bench.set_up()
    assert {register: bench.kept(register) for register in expected} == expected
    assert bench.chip.output_hz == output_hz
    assert bench.driver.i2c_errors == 0


@pytest.mark.parametrize("who_am_i", [*MPU_FAMILY, 0xEA])
def test_every_known_chip_is_set_up_and_read(who_am_i: int) -> None:
    bench = Bench(Icm20948) if who_am_i == 0xEA else Bench(who_am_i=who_am_i)
    bench.set_up().wait(42)
    size, period_ms = bench.driver.chip.sample.size, PERIOD_MS[type(bench.chip)]
    assert bench.driver.level()[:2] == (42 // period_ms * size, False)
    samples = [bench.driver.counts(row) for row in bench.driver.read_samples(3)]
    times_ms = [taken_ns(tuple(map(float, rate)), accel) / MS for accel, _, rate in samples]
    assert [b - a for a, b in itertools.pairwise(times_ms)] == [period_ms] * 2
    old = who_am_i == 0x68
    assert {temperature for _, temperature, _ in samples} == {-3920 if old else 1335}  # 25 °C
    assert bench.driver.identify() == who_am_i
    bench.driver.check_settings()
    assert bench.driver.i2c_errors == 0


def test_an_unknown_chip_is_refused_by_its_number_and_nothing_is_written_to_it() -> None:
    with pytest.raises(SensorFault) as refused:
        Bench(who_am_i=0x12).driver.identify()
    assert (refused.value.code, refused.value.detail) == (FaultCode.SENSOR_UNKNOWN, 0x12)
    bench = Bench(Icm20948)
    bench.chip.bank = 2  # as if another program had been ended in its midst: looks like any other chip
    with pytest.raises(SensorFault) as refused:
        bench.driver.identify()
    assert refused.value.code == FaultCode.SENSOR_UNKNOWN
    assert bench.chip.bank == 2


def test_whoever_says_what_it_is_gets_it_from_any_bank_or_is_contradicted() -> None:
    bench = Bench(Icm20948, "icm20948")
    bench.chip.bank = 2
    assert bench.set_up().driver.identify() == 0xEA
    with pytest.raises(SensorFault):
        Bench(Icm20948, "mpu9250").driver.identify()


def test_a_flipped_bit_of_the_identity_is_asked_again(bench: Bench) -> None:
    answers = iter([b"\x70\xff"[1:], b"\x71"])
    bench.bus.spoil = lambda register, data: next(answers)
    assert bench.driver.identify() == 0x71


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


@pytest.mark.parametrize(("model", "fits"), [(Mpu9250, 36), (Icm20948, 42)])
def test_level_and_overflow(model: type[Mpu9250 | Icm20948], fits: int) -> None:
    bench, period_ms = Bench(model).set_up(), PERIOD_MS[model]
    size = bench.driver.chip.sample.size
    bench.wait((fits - 1) * period_ms + 2)
    level = bench.driver.level()
    assert (level.bytes, level.overflowed) == ((fits - 1) * size, False)
    assert 0 < level.after_ns - level.before_ns < MS
    bench.wait(40)
    level = bench.driver.level()
    assert (level.bytes, level.overflowed) == (512, True)
    rows = [row for _ in range(2) for row in bench.driver.read_samples(fits // 2)]
    assert rows[-1][0] - rows[0][0] == (fits - 1) * period_ms * 10, "the oldest are kept; ticks of 0.1 ms"
    assert bench.driver.level().overflowed, "the flag is cleared by reading it, but what it told stays true"
    bench.driver.restart_fifo()
    assert bench.driver.level()[:2] == (0, False)


def test_more_than_the_data_sheet_says_counts_as_overflow() -> None:
    bench = Bench(Icm20948, fifo_bytes=4096).set_up()
    bench.wait(400)
    level = bench.driver.level()
    assert level.bytes > 512
    assert level.overflowed


@pytest.mark.parametrize(
    ("model", "register", "bit"),
    [
        *((Mpu9250, register, 0x08) for register in (0x19, 0x1A, 0x1B, 0x1C, 0x1D, 0x23)),
        *(
            (Icm20948, register, 0x01)
            for register in (0x006, 0x007, 0x200, 0x201, 0x210, 0x211, 0x214, 0x067, 0x069)
        ),
    ],
)
def test_a_setting_that_got_lost_is_found(model: type[Mpu9250 | Icm20948], register: int, bit: int) -> None:
    bench = Bench(model).set_up()
    kept = bench.kept(register)
    bench.spoil(register, kept ^ bit)
    with pytest.raises(SensorFault) as lost:
        bench.driver.check_settings()
    assert lost.value.code == FaultCode.READBACK_MISMATCH
    assert lost.value.detail == register << 16 | kept << 8 | kept ^ bit


def test_a_flipped_bit_of_a_setting_is_asked_again(bench: Bench) -> None:
    spoilt = iter([True])
    bench.bus.spoil = lambda register, data: bytes([data[0] ^ 1]) + data[1:] if next(spoilt, False) else data
    bench.driver.check_settings()
    assert bench.driver.i2c_errors == 1


@pytest.mark.parametrize("who_am_i", [0x71, 0xEA])
def test_bits_without_a_meaning_may_be_anything(who_am_i: int) -> None:
    for setting in chip_of(who_am_i).settings:
        assert setting.kept(setting.value | ~setting.meaning & 0xFF)
        assert not setting.kept(setting.value ^ setting.meaning)


def test_a_bank_that_could_not_be_selected_is_selected_later(icm: Bench) -> None:
    bank = 0x00

    def refuse(messages: tuple[i2c_msg, ...]) -> int | None:
        return errno.EREMOTEIO if bytes(messages[0]) == bytes([0x7F, bank]) else None

    icm.wait(20)
    icm.bus.inject = refuse
    with pytest.raises(TransferFailed):  # on the way back from bank 2
        icm.driver.check_settings()
    bank = 0x20
    waiting = icm.driver.level().bytes
    assert (waiting >= 2 * 12, waiting % 12) == (True, 0)
    icm.bus.inject = lambda messages: None
    icm.driver.check_settings()


def test_the_fake_bus_refuses_what_a_raspberry_pi_refuses(bench: Bench) -> None:
    read = [i2c_msg.write(0x68, [0x75]), i2c_msg.read(0x68, 1)]
    bench.bus.i2c_rdwr(*read)
    with pytest.raises(OSError, match="only one read") as refused:
        bench.bus.i2c_rdwr(*read, *read)
    assert refused.value.errno == errno.EOPNOTSUPP
