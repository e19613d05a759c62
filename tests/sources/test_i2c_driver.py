"""Tests the driver with emulated chips: what it writes, which values it accepts, and what it retries."""

import errno
import itertools
import re

import pytest
from fltea.sources.i2c import mpu9250_registers as reg
from fltea.sources.i2c.chips import chip_of
from fltea.sources.i2c.driver import TRIES, Driver, SensorFault, TransferFailed
from fltea.wire.layout import FaultCode
from fltea.wire.sensors import SENSORS
from smbus2 import i2c_msg

from tests.rig.emulated_chips import EMULATED
from tests.rig.fake_smbus import MS, FakeBus, FakeHost, TellsTime, taken_ns
from tests.rig.host_support import ROOT
from tools.due_emulator.icm20948 import Icm20948
from tools.due_emulator.mpu9250 import Mpu9250

HEADER = ROOT / "firmware/core/mpu9250_registers.h"
EVERY_CHIP = pytest.mark.parametrize("who_am_i", SENSORS, ids=lambda who_am_i: SENSORS[who_am_i].name)


class Bench:
    """A driver with its bus and an emulated chip, without the source that uses the driver."""

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
        """Let the next transactions fail with these error numbers; 0 means success."""
        left = list(numbers)
        self.bus.inject = lambda messages: (left.pop(0) or None) if left else None


def of_chip(who_am_i: int) -> Bench:
    assert who_am_i in EMULATED, f"tests/rig/emulated_chips.py has no {SENSORS[who_am_i].name}"
    return Bench(EMULATED[who_am_i].model, **EMULATED[who_am_i].options)


@pytest.fixture
def bench() -> Bench:
    return Bench().set_up()


@pytest.fixture
def icm() -> Bench:
    return Bench(Icm20948).set_up()


def test_firmware_and_host_mean_the_same_registers() -> None:
    found = re.findall(r"constexpr uint8_t k(\w+) = (\w+);", HEADER.read_text(encoding="utf-8"))
    # In the firmware's header, SMPLRT_DIV is called `kSmplrtDiv`, and so on.
    firmware = {re.sub(r"(?<=[a-z])(?=[A-Z0-9])", "_", name).upper(): int(value, 0) for name, value in found}
    host = {name: value for name, value in vars(reg).items() if name.isupper()}
    # only the firmware reads the output registers, since the host's driver reads the FIFO
    theirs_alone = {"ACCEL_XOUT_H", "RAW_READY"}
    assert len(firmware) == 15
    assert {name: host[name] for name in firmware.keys() - theirs_alone} == {
        name: value for name, value in firmware.items() if name not in theirs_alone
    }
    ours_alone = (reg.FIFO_EN, reg.INT_STATUS, reg.USER_CTRL, reg.FIFO_COUNT_H, reg.FIFO_R_W)
    assert ours_alone == (35, 58, 106, 114, 116)


@EVERY_CHIP
def test_what_is_set(who_am_i: int) -> None:
    bench, facts = of_chip(who_am_i).set_up(), EMULATED[who_am_i]
    assert {register: bench.chip.register(register) for register in facts.kept} == facts.kept
    assert bench.chip.output_hz == 1000 / facts.period_ms
    assert bench.driver.i2c_errors == 0


@EVERY_CHIP
def test_every_known_chip_is_set_up_and_read(who_am_i: int) -> None:
    bench, facts = of_chip(who_am_i).set_up(), EMULATED[who_am_i]
    bench.wait(42)
    size = bench.driver.chip.packet.size
    assert bench.driver.level()[:2] == (42 // facts.period_ms * size, False)
    samples = [bench.driver.counts(row) for row in bench.driver.read_samples(3)]
    times_ms = [taken_ns(tuple(map(float, rate)), accel) / MS for accel, _, rate in samples]
    assert [b - a for a, b in itertools.pairwise(times_ms)] == [facts.period_ms] * 2
    assert {temperature for _, temperature, _ in samples} == {facts.at_25_c}
    assert bench.driver.identify() == who_am_i
    bench.driver.check_settings()
    assert bench.driver.i2c_errors == 0


def test_an_unknown_chip_is_refused_by_its_number_and_nothing_is_written_to_it() -> None:
    with pytest.raises(SensorFault) as refused:
        Bench(who_am_i=0x12).driver.identify()
    assert (refused.value.code, refused.value.detail) == (FaultCode.SENSOR_UNKNOWN, 0x12)
    bench = Bench(Icm20948)
    # another bank of registers is selected, as if another program had been killed halfway, so the chip seems
    # to be of another kind
    bench.chip.bank = 2
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
    """A broken read of the FIFO is not repeated. The bytes that were read are gone, and a second try would
    take the rest for the beginning of a sample.
    """
    bench.wait(35)
    bench.fail(errno.EIO)
    before = bench.bus.transactions
    with pytest.raises(TransferFailed) as failed:
        bench.driver.read_samples(3)
    assert bench.bus.transactions - before == 1
    assert failed.value.acknowledged
    assert bench.driver.level().bytes % 14


@EVERY_CHIP
def test_level_and_overflow(who_am_i: int) -> None:
    bench, facts = of_chip(who_am_i).set_up(), EMULATED[who_am_i]
    size, fits, period_ms = bench.driver.chip.packet.size, facts.holds, facts.period_ms
    assert bench.driver.chip.fifo_s == pytest.approx(fits * period_ms / 1000)
    bench.wait((fits - 1) * period_ms + 2)
    level = bench.driver.level()
    assert (level.bytes, level.overflowed) == ((fits - 1) * size, False)
    assert 0 < level.after_ns - level.before_ns < MS
    bench.wait(40)
    level = bench.driver.level()
    assert (level.bytes, level.overflowed) == (bench.driver.chip.fifo_bytes, True)
    if facts.keeps_oldest:
        rows: list[tuple[int, ...]] = []
        while len(rows) < fits:
            rows += bench.driver.read_samples(min(15, fits - len(rows)))
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


@EVERY_CHIP
def test_a_setting_that_got_lost_is_found(who_am_i: int) -> None:
    facts = EMULATED[who_am_i]
    for register in facts.lost:
        bench = of_chip(who_am_i).set_up()
        kept = bench.chip.register(register)
        bench.chip.spoil(register, kept ^ facts.lost_bit)
        with pytest.raises(SensorFault) as lost:
            bench.driver.check_settings()
        assert lost.value.code == FaultCode.READBACK_MISMATCH
        assert lost.value.detail == register << 16 | kept << 8 | kept ^ facts.lost_bit


def test_a_flipped_bit_of_a_setting_is_asked_again(bench: Bench) -> None:
    spoilt = iter([True])
    bench.bus.spoil = lambda register, data: bytes([data[0] ^ 1]) + data[1:] if next(spoilt, False) else data
    bench.driver.check_settings()
    assert bench.driver.i2c_errors == 1


@EVERY_CHIP
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
    # the transfer that selects the usual register bank again, after bank 2, fails
    with pytest.raises(TransferFailed):
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
