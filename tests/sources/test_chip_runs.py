"""Tests runs with each family of chips on the Raspberry Pi's I²C bus, with emulated chips."""

import errno
import random
from typing import Any

import pytest
from fltea.sources.i2c.chips import CHIPS, chip_of
from fltea.wire.layout import SampleFlags
from fltea.wire.sensors import SENSORS
from smbus2 import i2c_msg

from tests.rig.emulated_chips import EMULATED, FIRST
from tests.rig.fake_smbus import MS, Pi, S, TellsTime
from tools.due_emulator.noise import Stepped

EACH_FAMILY = pytest.mark.parametrize("who_am_i", FIRST.values(), ids=FIRST)
SETTLED_S = 14


def pi_with(who_am_i: int, **options: Any) -> Pi:
    return Pi(model=EMULATED[who_am_i].model, **EMULATED[who_am_i].options, **options)


@EACH_FAMILY
def test_a_run_without_gaps(who_am_i: int) -> None:
    pi, facts = pi_with(who_am_i).run_until(6.0), EMULATED[who_am_i]
    times = pi.check()
    assert len(times) > 5500 / facts.period_ms
    assert pi.missing == []
    assert pi.told == []
    hello = pi.hello
    assert (hello.sensor, hello.who_am_i, hello.rate_hz) == (facts.name, who_am_i, 1000 / facts.period_ms)
    for name in ("gyro_range_dps", "gyro_dlpf_hz", "gyro_lsb_per_dps", "accel_range_g", "accel_lsb_per_g"):
        assert getattr(hello, name) == getattr(facts, name), facts.row(name)
    assert {raw.temperature for raw in pi.raw} == {facts.at_25_c}, facts.row("temperature, or packet's")


@EACH_FAMILY
@pytest.mark.parametrize("end", [0, 1])
def test_the_end_of_the_range_is_flagged(who_am_i: int, end: int) -> None:
    facts = EMULATED[who_am_i]
    beyond_dps = 1.1 * facts.gyro_range_dps * (-1, 1)[end]

    class Beyond(Stepped):
        def next_rate(self, k: int) -> tuple[float, float, float]:
            return (0.0, beyond_dps, 0.0) if k % 2 else (0.0, 0.0, 0.0)

    pi = pi_with(who_am_i, world=Beyond(1000 / facts.period_ms, 1)).run_until(1)
    flagged = {raw.gyro[1] for raw in pi.raw if raw.flags & SampleFlags.SATURATED}
    assert flagged == {facts.gyro_ends[end]}, facts.row("gyro_ends")


@EACH_FAMILY
def test_a_fifo_that_is_emptied_before_it_is_read_gives_no_sample(who_am_i: int) -> None:
    pi, facts = pi_with(who_am_i), EMULATED[who_am_i]

    def empty(messages: tuple[i2c_msg, ...]) -> None:
        if pi.host.now_ns > SETTLED_S * S and bytes(messages[0]) == bytes([chip_of(who_am_i).fifo_data]):
            pi.bus.inject = lambda messages: None
            for _ in range(len(pi.chip.fifo)):
                pi.chip.fifo.pop()

    pi.bus.inject = empty
    pi.run_until(SETTLED_S + 2).check()
    assert pi.source.link_stats().bad_frames == {"out_of_step": 1}, facts.row("packet.is_sample")
    assert 0 < sum(pi.missing) < 8


@EACH_FAMILY
@pytest.mark.parametrize("share", [-0.6, 0.6])
def test_a_clock_far_from_its_nominal_rate_is_no_gap(who_am_i: int, share: float) -> None:
    """A chip's clock that is far from its nominal rate gives no gaps. The clocks of some chips are wrong by
    up to 10 %.
    """
    ppm = share * chip_of(who_am_i).clock_error * 1e6
    pi = pi_with(who_am_i, clock_ppm=ppm).run_until(6.0)
    pi.check(ppm)
    assert pi.missing == []
    assert pi.told == []


def test_a_clock_that_is_slower_than_the_data_sheet_allows_is_no_gap() -> None:
    """The data sheet of the MPU-9250 allows 1 %. The clocks of clones are known to be worse."""
    pi = pi_with(FIRST["mpu9250"], clock_ppm=-39_000).run_until(30.0)
    pi.check(-39_000)
    assert (pi.missing, pi.told) == ([], [])


def test_a_clock_beyond_all_limits_is_named_as_a_cause() -> None:
    pi = pi_with(FIRST["mpu9250"], clock_ppm=-60_000).run_until(4.0)
    assert pi.told == ["fifo_restarted"]
    assert "a clone whose clock is wrong" in pi.texts


@EACH_FAMILY
def test_a_program_that_is_held_up(who_am_i: int) -> None:
    """While the program pauses, samples wait in the chip's FIFO. A pause that fits into the FIFO loses no
    samples. A longer pause loses some.
    """
    pi, facts = pi_with(who_am_i), EMULATED[who_am_i]
    holds_ms = facts.holds * facts.period_ms
    pi.host.stall(SETTLED_S * S, (holds_ms - 50) * MS)
    pi.host.stall((SETTLED_S + 2) * S, (holds_ms + 800) * MS)
    pi.run_until(SETTLED_S + 4 + holds_ms / 1000).check()
    assert pi.told == ["fifo_overflow"]
    assert f"longer than the {holds_ms / 1000:.2g} s that it holds" in pi.texts
    assert len(pi.missing) == 1
    assert pi.missing[0] == pytest.approx(800 / facts.period_ms, abs=10)


@EACH_FAMILY
def test_a_bus_that_fails_for_less_than_the_fifo_holds_sets_no_sensor_up_again(who_am_i: int) -> None:
    pi, facts = pi_with(who_am_i), EMULATED[who_am_i]
    fails_s = 0.8 * facts.holds * facts.period_ms / 1000
    for at_s, error in ((SETTLED_S, errno.EREMOTEIO), (SETTLED_S + fails_s, None)):
        pi.host.at(round(at_s * S), lambda error=error: setattr(pi.bus, "inject", lambda messages: error))
    pi.run_until(SETTLED_S + fails_s + 1).check()
    assert pi.epochs == ["start"]
    assert (pi.missing, pi.told) == ([], [])


def beginnings_of_transfers(who_am_i: int) -> list[bytes]:
    """Return the bytes with which each transfer of a usual poll begins: a register's number, or a bank."""
    chip = chip_of(who_am_i)
    registers = [chip.fifo_count, chip.overflow[0], chip.temperature, chip.fifo_data]
    known = [one for one in (*registers, *(first for first, _ in chip.checked)) if one is not None]
    banks = sorted({register >> 8 for register in known})
    select, shift = chip.banks or (0, 0)
    selected = [] if len(banks) == 1 else [bytes([select, bank << shift]) for bank in banks]
    return [bytes([register & 0xFF]) for register in known] + selected


EACH_TRANSFER = pytest.mark.parametrize(
    ("who_am_i", "beginning"),
    [
        (who_am_i, one)
        for family, who_am_i in FIRST.items()
        if family in CHIPS  # test_chip_table.py names a family that is missing there
        for one in beginnings_of_transfers(who_am_i)
    ],
    ids=lambda one: one.hex() if isinstance(one, bytes) else SENSORS[one].name,
)


@EACH_FAMILY
def test_a_poll_has_no_other_transfers(who_am_i: int) -> None:
    """`beginnings_of_transfers` lists all transfers of a poll. The next test lets the bus fail at each."""
    pi, seen = pi_with(who_am_i).run_until(2.0), set()
    pi.bus.inject = lambda messages: seen.add(bytes(messages[0]))
    pi.run_until(2.2)
    assert seen == set(beginnings_of_transfers(who_am_i))


@EACH_TRANSFER
def test_a_bus_that_begins_to_fail_within_a_poll_loses_nothing(who_am_i: int, beginning: bytes) -> None:
    """Wherever in a poll the bus stops to acknowledge, samples that were read before are delivered."""
    pi, facts = pi_with(who_am_i), EMULATED[who_am_i]
    end_ns = 0

    def inject(messages: tuple[i2c_msg, ...]) -> int | None:
        nonlocal end_ns
        now_ns = pi.host.now_ns
        if not end_ns and now_ns > 2 * S and bytes(messages[0]) == beginning:
            end_ns = now_ns + round(0.6 * facts.holds * facts.period_ms) * MS
        return errno.EREMOTEIO if now_ns < end_ns else None

    pi.bus.inject = inject
    pi.run_until(3.0).check()
    assert end_ns, "the bus never failed"
    assert pi.epochs == ["start"]
    assert (pi.missing, pi.told) == ([], [])
    assert pi.status.overruns == 0


@EACH_FAMILY
def test_errors_on_the_bus_mix_up_no_registers(who_am_i: int) -> None:
    """Errors on the bus also concern the transfer that selects a bank of registers.

    If this transfer failed unnoticed, the register of another bank would be read.
    """
    pi, chance = pi_with(who_am_i), random.Random(5)

    def inject(messages: object) -> int | None:
        pi.bus.broken_at = chance.random()
        return chance.choice([errno.EREMOTEIO, errno.EIO]) if chance.random() < 0.03 else None

    pi.host.at(12_000 * MS, lambda: setattr(pi.bus, "inject", inject))
    pi.run_until(15.0).check()
    assert pi.epochs == ["start"]
    assert pi.status.i2c_errors > 10
    assert set(pi.told) <= {"fifo_restarted"}


@pytest.mark.parametrize("who_am_i", [who for family, who in FIRST.items() if family != "mpu9250"])
def test_a_chip_in_the_place_of_another(who_am_i: int) -> None:
    """An MPU-9250 is replaced by a chip of another family, so the rate changes, and a new numbering of
    samples (an epoch) begins.
    """
    pi, facts = pi_with(FIRST["mpu9250"]), EMULATED[who_am_i]
    pi.at(2.0, pi.chip.power_off)

    def exchange() -> None:
        pi.chip = pi.bus.chip = facts.make(TellsTime())
        pi.chip.advance(pi.host.now_ns)

    pi.host.at(3_000 * MS, exchange)
    pi.run_until(6.0)
    assert [h.sensor for h in pi.of(type(pi.hello))] == ["MPU-9250", facts.name]
    assert pi.hello.rate_hz == 1000 / facts.period_ms
    assert pi.epochs == ["start", "sensor_restart"]
    assert pi.pipeline.stats().sample_counts.before_hello == 0
    assert len(pi.raw) > 2500 / facts.period_ms
