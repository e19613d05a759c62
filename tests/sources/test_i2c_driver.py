"""Tests the driver with emulated chips: what it writes, which values it accepts, and what it retries."""

import errno
import itertools
import re
from collections.abc import Callable

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
from tools.due_emulator.chip import Chip
from tools.due_emulator.icm20948 import Icm20948
from tools.due_emulator.mpu9250 import Mpu9250
from tools.due_emulator.noise import Constant, World

HEADER = ROOT / "firmware/core/mpu9250_registers.h"
EVERY_CHIP = pytest.mark.parametrize("who_am_i", SENSORS, ids=lambda who_am_i: SENSORS[who_am_i].name)


class Bench:
    """A driver with its bus and an emulated chip, without the source that uses the driver."""

    def __init__(self, model: Callable[..., Chip] = Mpu9250, family: str = "", **chip: object) -> None:
        self.host = FakeHost()
        self.chip = model(TellsTime(), **chip)
        self.bus = FakeBus(self.host, self.chip)
        self.bus.is_open = True
        self.driver = Driver(self.chip.address, self.host.host_ns, family)
        self.driver.bus = self.bus

    def set_up(self) -> "Bench":
        self.driver.start_reset(self.driver.identify())
        self.wait(1000 * self.driver.chip.reset_s)
        self.driver.configure()
        self.wait(1000 * self.driver.chip.settle_s)
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
    assert who_am_i in EMULATED, f"tests/rig/emulated_chips.py: EMULATED has no {SENSORS[who_am_i].name}"
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


def set_up(who_am_i: int, world: World | None = None) -> Bench:
    """Set up an emulated chip, and return its `Bench`. Fail if a register does not keep its setting."""
    bench, facts = of_chip(who_am_i), EMULATED[who_am_i]
    bench.chip.world = world or bench.chip.world
    try:
        return bench.set_up()
    except SensorFault as fault:
        what = "reset_s is too short, or the order of settings, or restart: its value is not kept by register"
        raise AssertionError(facts.row(what, fault.detail >> 16)) from fault


@EVERY_CHIP
def test_what_is_set(who_am_i: int) -> None:
    bench, facts = set_up(who_am_i), EMULATED[who_am_i]
    for register, value in facts.kept.items():
        found = bench.chip.register(register)
        assert found == value, f"{facts.row('register', register)} is 0x{found:02X}, not 0x{value:02X}"
    assert bench.chip.output_hz == 1000 / facts.period_ms, facts.row("the rate that the settings give")
    assert bench.driver.i2c_errors == 0


@EVERY_CHIP
def test_every_register_that_matters_is_written(who_am_i: int) -> None:
    """A setting is written although a chip has the same value after a reset, since a clone may differ."""
    chip, facts = chip_of(who_am_i), EMULATED[who_am_i]
    written = {setting.register for setting in chip.settings} | {register for register, _ in chip.restart}
    for register in facts.kept:
        assert register in written, facts.row("settings leave out register", register)
    for register in sorted({setting.register for setting in chip.settings} - facts.kept.keys()):
        raise AssertionError(
            f"tests/rig/emulated_chips.py: EMULATED, {facts.name}: kept has no register 0x{register:02X}"
        )


@EVERY_CHIP
def test_every_known_chip_is_set_up_and_read(who_am_i: int) -> None:
    bench, facts = set_up(who_am_i), EMULATED[who_am_i]
    bench.wait(42)
    size = bench.driver.chip.packet.size
    level = bench.driver.level()[:2]
    assert level == (42 // facts.period_ms * size, False), facts.row("level of the FIFO after 42 ms, packet")
    samples = [bench.driver.counts(row) for row in bench.driver.read_samples(3)]
    for accel, _, rate in samples:
        assert rate == accel, facts.row("packet, or settle_s is too short for the gyroscope to start")
    times_ms = [taken_ns(tuple(map(float, rate)), accel) / MS for accel, _, rate in samples]
    assert [b - a for a, b in itertools.pairwise(times_ms)] == [facts.period_ms] * 2
    assert bench.driver.identify() == who_am_i
    bench.driver.check_settings()
    assert bench.driver.i2c_errors == 0


@EVERY_CHIP
@pytest.mark.parametrize("celsius", [25.0, 35.0])
def test_the_temperature_is_that_of_the_thermometer(who_am_i: int, celsius: float) -> None:
    bench, facts = set_up(who_am_i, Constant(celsius=celsius)), EMULATED[who_am_i]
    bench.wait(42)
    bench.driver.level()
    (row,) = bench.driver.read_samples(1)
    found, counts = bench.driver.counts(row)[1], facts.at_25_c + round((celsius - 25) * facts.counts_a_c)
    assert found == counts, facts.row(f"temperature, or packet's: {found} at {celsius} °C, not {counts}")


@EVERY_CHIP
def test_each_value_is_that_of_its_axis(who_am_i: int) -> None:
    facts, rate_dps, accel_g = EMULATED[who_am_i], (10.0, -20.0, 30.0), (0.25, -0.5, 1.0)
    bench = set_up(who_am_i, Constant(rate_dps, accel_g))
    bench.wait(42)
    (row,) = bench.driver.read_samples(1)
    accel, _, gyro = bench.driver.counts(row)
    assert gyro == tuple(round(one * facts.gyro_lsb_per_dps) for one in rate_dps), facts.row("packet.gyro")
    assert accel == tuple(round(one * facts.accel_lsb_per_g) for one in accel_g), facts.row("packet.accel")


@EVERY_CHIP
def test_what_an_empty_fifo_gives_is_no_sample(who_am_i: int) -> None:
    bench, facts = set_up(who_am_i), EMULATED[who_am_i]
    bench.wait(42)
    packet = bench.driver.chip.packet
    n = bench.driver.level().bytes // packet.size
    are_samples = [packet.is_sample(row) for row in bench.driver.read_samples(n + 2)]
    # while the FIFO is read, one more sample may come
    assert are_samples in ([True] * n + [False] * 2, [True] * (n + 1) + [False]), facts.row(
        "packet.is_sample"
    )


@EVERY_CHIP
def test_a_row_that_does_not_begin_with_a_sample_is_told_by_its_header(who_am_i: int) -> None:
    packet, facts = chip_of(who_am_i).packet, EMULATED[who_am_i]
    assert packet.header == facts.header, facts.row("packet.header")
    if packet.header is not None:
        bench = set_up(who_am_i)
        bench.wait(42)
        bench.chip.fifo.pop()
        (row,) = bench.driver.read_samples(1)
        assert not packet.is_sample(row), facts.row("packet.header")


@EVERY_CHIP
def test_a_reset_forgets_the_settings(who_am_i: int) -> None:
    bench, facts = set_up(who_am_i), EMULATED[who_am_i]
    bench.driver.start_reset(bench.driver.identify())
    bench.wait(1000 * bench.driver.chip.reset_s)
    kept = [register for register, value in facts.kept.items() if bench.chip.register(register) == value]
    assert len(kept) < len(facts.kept), facts.row("reset has no effect, register", bench.driver.chip.reset[0])


@EVERY_CHIP
def test_the_fifo_is_emptied_and_runs_after_a_restart(who_am_i: int) -> None:
    bench, facts = set_up(who_am_i), EMULATED[who_am_i]
    bench.wait(5.5 * facts.period_ms)
    size = bench.driver.chip.packet.size
    # the chip measures at the same times whenever its FIFO was restarted: 5 or 6 times in 5.5 periods
    assert bench.driver.level().bytes in (5 * size, 6 * size), facts.row("restart does not start the FIFO")
    bench.driver.restart_fifo()
    assert bench.driver.level().bytes in (0, size), facts.row("restart does not empty the FIFO")
    bench.wait(2.5 * facts.period_ms)
    assert bench.driver.level().bytes > size, facts.row("restart does not start the FIFO")


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
    bench, facts = set_up(who_am_i), EMULATED[who_am_i]
    size, fits, period_ms = bench.driver.chip.packet.size, facts.holds, facts.period_ms
    found = bench.driver.chip.fifo_samples
    assert found == fits, facts.row(f"fifo_bytes hold {found} samples, not {fits}")
    bench.wait((fits - 1) * period_ms + 2)
    level = bench.driver.level()
    assert (level.bytes, level.overflowed) == ((fits - 1) * size, False)
    assert 0 < level.after_ns - level.before_ns < MS
    bench.wait(40)
    level = bench.driver.level()
    assert level.overflowed, facts.row("overflow, register", bench.driver.chip.overflow[0])
    assert level.bytes == bench.driver.chip.fifo_bytes, facts.row("fifo_bytes")
    assert bench.driver.chip.keeps_oldest == facts.keeps_oldest, facts.row("keeps_oldest")
    if facts.keeps_oldest:
        rows: list[tuple[int, ...]] = []
        while len(rows) < fits:
            rows += bench.driver.read_samples(min(15, fits - len(rows)))
        first, last = (bench.driver.counts(row)[0][0] for row in (rows[0], rows[-1]))
        # the oldest samples are kept; the emulated values are times in units of 0.1 ms
        assert last - first == (fits - 1) * period_ms * 10, facts.row("keeps_oldest, or packet")
    # reading the chip's flag clears it, but the driver remembers the overflow
    assert bench.driver.level().overflowed, facts.row("overflow, register", bench.driver.chip.overflow[0])
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
        bench = set_up(who_am_i)
        kept = bench.chip.register(register)
        bench.chip.spoil(register, kept ^ facts.lost_bit)
        found = None
        try:
            bench.driver.check_settings()
        except SensorFault as fault:
            found = fault
        assert found is not None, facts.row("checked or settings leave out register", register)
        assert found.code == FaultCode.READBACK_MISMATCH
        assert found.detail == register << 16 | kept << 8 | kept ^ facts.lost_bit


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
