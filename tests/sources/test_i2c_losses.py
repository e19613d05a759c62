"""Tests that each sample of an I²C source is delivered with its true number, or counted as lost."""

import errno
import random
from collections.abc import Callable

import pytest
from fltea.sources.i2c.driver import TRIES
from fltea.wire.layout import SampleFlags
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from smbus2 import i2c_msg

from tests.rig.fake_smbus import MS, Pi, S

SETTLED_S = 12.0
"""Time after which the sensor's clock is known well enough to count any loss exactly."""
AT_RANDOM = settings(phases=[Phase.generate])
"""Settings of hypothesis without shrinking of examples, which would take minutes, since an example runs for
seconds.
"""
ERRNOS = [errno.EREMOTEIO, errno.EIO, errno.ETIMEDOUT, errno.ENXIO, errno.EAGAIN]


@pytest.mark.slow
@given(st.floats(0.2, 6), st.floats(0, 0.3), st.integers(0, 10_000))
@settings(AT_RANDOM, max_examples=8)
def test_a_stall_of_300_ms_loses_nothing(at_s: float, for_s: float, ppm: int) -> None:
    pi = Pi(clock_ppm=ppm)
    pi.host.stall(round(at_s * S), round(for_s * S))
    pi.host.stall(round((at_s + 1) * S), round(0.3 * S))
    pi.run_until(at_s + 2)
    pi.check(ppm)
    assert (pi.missing, pi.told) == ([], [])


@pytest.mark.slow
@given(st.floats(SETTLED_S, SETTLED_S + 1), st.floats(0.45, 2.0), st.integers(-9_000, 9_000))
@settings(AT_RANDOM, max_examples=5)
def test_a_stall_of_2_s_is_counted_to_the_sample(at_s: float, for_s: float, ppm: int) -> None:
    pi = Pi(clock_ppm=ppm)
    pi.host.stall(round(at_s * S), round(for_s * S))
    pi.run_until(at_s + for_s + 1)
    pi.check(ppm)
    assert len(pi.missing) == 1
    assert pi.told == ["fifo_overflow"]
    assert f"; {pi.missing[0]} samples are lost." in pi.texts
    assert pi.source.link_stats().bad_frames == {"overflow": 1}
    assert pi.missing[0] <= for_s * 101 + 8


def once(pi: Pi, register: int, do: Callable[[tuple[i2c_msg, ...]], int | None]) -> Pi:
    """Call `do` once, just before a transaction on the bus that begins with this register. The sensor's clock
    has settled by then.
    """

    def inject(messages: tuple[i2c_msg, ...]) -> int | None:
        if pi.host.now_ns < SETTLED_S * S or bytes(messages[0])[0] != register:
            return None
        error = do(messages)
        if error != 0:
            pi.bus.inject = lambda messages: None
        return error or None

    pi.bus.inject = inject
    return pi


@pytest.mark.parametrize("register", [0x72, 0x3A, 0x74, 0x19])
def test_a_stall_between_any_two_transfers_is_counted(register: int) -> None:
    """The program stalls before it reads the FIFO's count, the overflow flag, the samples or the settings.
    All lost samples are counted.

    During the stall, the content of the FIFO changes.
    """
    pi = Pi()
    once(pi, register, lambda messages: pi.host.let_pass(2 * S)).run_until(SETTLED_S + 4)
    pi.check()
    assert pi.told == ["fifo_overflow"]
    # A full FIFO has 36 samples, which are delivered. But if the stall comes after the FIFO's count was read,
    # only the 3 samples of that count are.
    assert sum(pi.missing) == pytest.approx(201 - (36 if register in (0x72, 0x19) else 3), abs=5)


def test_an_overflow_that_may_have_happened_is_asked_for_until_there_is_an_answer() -> None:
    """The program stalls for nearly as long as the FIFO has room. So after it has read the samples, it reads
    from the chip whether the FIFO has overflowed. Only the last of several attempts succeeds. There was no
    overflow, so nothing is lost.
    """
    pi = Pi()
    tries: list[int] = []

    def inject(messages: tuple[i2c_msg, ...]) -> int | None:
        register = bytes(messages[0])[0]
        if pi.host.now_ns > SETTLED_S * S and register == 0x74 and not tries:
            pi.host.let_pass(310 * MS)
            tries.append(0)
        elif tries and len(tries) <= TRIES:
            tries.append(register)
            return errno.EREMOTEIO
        return None

    pi.bus.inject = inject
    pi.run_until(SETTLED_S + 2).check()
    assert tries[1:] == [0x72] * TRIES
    assert (pi.missing, pi.told) == ([], [])


def test_a_fifo_that_is_emptied_before_it_is_read_gives_no_sample() -> None:
    pi = Pi()
    once(pi, 0x74, lambda messages: [pi.chip.fifo.pop() for _ in range(len(pi.chip.fifo))] and None)  # type: ignore[return-value]
    pi.run_until(SETTLED_S + 2).check()
    assert pi.source.link_stats().bad_frames == {"out_of_step": 1}
    assert 0 < sum(pi.missing) < 8


def test_a_clock_that_is_read_late_turns_no_time_back() -> None:
    """The program reads the time 15 ms after it has read the FIFO's count. The sensor measures further
    samples within these 15 ms. The times of samples still never decrease.
    """
    pi = Pi()
    once(pi, 0x72, lambda messages: pi.host.stall(pi.host.now_ns + 50_000, 15 * MS)).run_until(SETTLED_S + 2)
    pi.check()
    assert (pi.missing, pi.told) == ([], [])


def test_a_whole_sample_that_went_with_a_broken_transfer_is_missed() -> None:
    """A whole sample was lost in a transfer that broke. Afterwards the FIFO begins with a whole sample, as if
    nothing had been lost, but the loss is counted.
    """
    pi = Pi()

    def break_off(messages: tuple[i2c_msg, ...]) -> int:
        if len(messages[1]) < 28:
            return 0
        pi.bus.broken_at = 14.001 / len(messages[1])
        return errno.EIO

    once(pi, 0x74, break_off).run_until(SETTLED_S + 3)
    pi.check()
    assert pi.told == ["fifo_restarted"]
    assert pi.source.link_stats().bad_frames == {"broken_transfer": 1}


def test_a_number_that_cannot_be_known_is_given_with_its_doubt() -> None:
    pi = Pi(clock_ppm=9_000)
    pi.host.stall(S // 2, 3 * S)
    pi.run_until(5)
    assert "±" in pi.texts
    assert pi.missing[0] == pytest.approx(3 * 101 - 36, abs=10)


def test_on_an_mpu6050_an_overflow_leaves_nothing_whole() -> None:
    pi = Pi(who_am_i=0x68)
    pi.host.stall(round(SETTLED_S * S), 2 * S)
    pi.run_until(SETTLED_S + 4).check()
    assert pi.told == ["sensor_relative", "fifo_overflow"]
    assert pi.missing[0] == pytest.approx(202, abs=4)
    assert pi.hello.gyro_dlpf_hz == 188.0


def test_on_an_mpu6050_a_stall_of_650_ms_loses_nothing() -> None:
    pi = Pi(who_am_i=0x68)
    pi.host.stall(3 * S, 65 * S // 100)
    pi.run_until(5).check()
    assert pi.missing == []


def disturbed(pi: Pi, seed: int, share: float, numbers: list[int]) -> Pi:
    chance = random.Random(seed)

    def inject(messages: object) -> int | None:
        pi.bus.broken_at = chance.random()
        return chance.choice(numbers) if chance.random() < share else None

    pi.host.at(round(SETTLED_S * S), lambda: setattr(pi.bus, "inject", inject))
    return pi


@pytest.mark.slow
@given(st.integers(0, 2**32), st.sampled_from([0.005, 0.03]), st.integers(-9_000, 9_000))
@settings(AT_RANDOM, max_examples=5)
def test_errors_at_random_tear_no_sample_and_hide_no_loss(seed: int, share: float, ppm: int) -> None:
    pi = disturbed(Pi(clock_ppm=ppm), seed, share, ERRNOS).run_until(SETTLED_S + 6)
    pi.check(ppm)
    assert pi.epochs == ["start"]
    assert set(pi.told) <= {"fifo_restarted"}
    assert "±" not in pi.texts
    assert pi.status.i2c_errors > 0


@pytest.mark.slow
def test_refusals_alone_lose_nothing() -> None:
    pi = disturbed(Pi(), 1, 0.1, [errno.EREMOTEIO]).run_until(SETTLED_S + 10)
    pi.check()
    assert (pi.missing, pi.told) == ([], [])
    assert pi.status.i2c_errors > 50
    assert any(raw.flags == SampleFlags.RETRIED for raw in pi.raw)


def refuse(pi: Pi, at_s: float, for_s: float, number: int = errno.EREMOTEIO) -> Pi:
    pi.host.at(round(at_s * S), lambda: setattr(pi.bus, "inject", lambda messages: number))
    pi.host.at(round((at_s + for_s) * S), lambda: setattr(pi.bus, "inject", lambda messages: None))
    return pi


def test_a_bus_that_fails_for_200_ms_loses_nothing() -> None:
    pi = refuse(Pi(), SETTLED_S, 0.2).run_until(SETTLED_S + 2)
    pi.check()
    assert (pi.missing, pi.told) == ([], [])


def test_samples_of_a_sensor_that_is_lost_before_their_check_are_counted() -> None:
    """After it has read samples, the program checks that the sensor still has its settings. Here the bus
    fails before this check, until the sensor counts as lost. The samples that were read then count as
    missing, since they may have been measured with wrong settings.
    """
    pi = Pi()

    def begin_to_fail(messages: tuple[i2c_msg, ...]) -> int:
        refuse(pi, pi.host.now_ns / S, 2.0)
        return errno.EREMOTEIO

    once(pi, 0x19, begin_to_fail)
    pi.run_until(SETTLED_S + 4).check()
    assert pi.epochs == ["start", "sensor_restart"]
    assert pi.told == ["device_fault", "device_fault"]
    assert sum(pi.missing) == pytest.approx(2.3 * 100, abs=25)


def test_samples_that_wait_for_their_check_are_delivered_although_the_sensor_stopped() -> None:
    """The FIFO overflows, its samples are read, and the bus fails before the settings are checked.

    Then the FIFO is restarted, but the sensor has fallen asleep. The bus fails again until the sensor counts
    as stopped. The samples are still delivered.
    """
    pi, seen = Pi(), [0]

    def inject(messages: tuple[i2c_msg, ...]) -> int | None:
        register, now_ns = bytes(messages[0])[0], pi.host.now_ns
        match len(seen):
            case 1 if now_ns > SETTLED_S * S and register == 0x72:
                pi.host.let_pass(2 * S)
                seen.append(now_ns)
            case 2 | 3 | 4 if register == 0x19:
                seen.append(now_ns)
                return errno.EREMOTEIO
            case 5 if register == 0x6A:
                pi.chip.spoil(0x6B, 0x41)
                seen.append(now_ns)
            case 6 if register == 0x19 and now_ns < seen[-1] + 150 * MS:
                return errno.EREMOTEIO
        return None

    pi.bus.inject = inject
    pi.run_until(SETTLED_S + 4).check()
    assert "sensor_frozen" in pi.texts
    assert pi.epochs == ["start", "sensor_restart"]


@pytest.mark.parametrize(
    ("number", "second"), [(errno.EREMOTEIO, "no sensor answers"), (errno.EIO, "break off")]
)
def test_a_bus_that_fails_for_2_s_sets_the_sensor_up_again(number: int, second: str) -> None:
    pi = refuse(Pi(), SETTLED_S, 2.0, number).run_until(SETTLED_S + 4)
    pi.check()
    assert pi.epochs == ["start", "sensor_restart"]
    assert pi.told == ["device_fault", "device_fault"]
    assert "sensor_lost: the sensor at 0x68 on /dev/i2c-1 stopped answering" in pi.texts
    assert second in pi.texts
    assert pi.status.sensor_reinits == 1
    assert pi.hello.sensor_starts == 2
    assert sum(pi.missing) == pytest.approx(2.3 * 100, abs=25)


def test_bytes_that_got_lost_in_the_fifo() -> None:
    pi = Pi()
    while not len(pi.chip.fifo):
        pi.run_until(max(SETTLED_S, pi.host.now_ns / S + 0.003))
        pi.chip.advance(pi.host.now_ns)
    for _ in range(5):
        pi.chip.fifo.pop()
    pi.run_until(SETTLED_S + 2).check()
    assert pi.told == ["fifo_restarted"]
    assert "no whole samples" in pi.texts
    assert pi.source.link_stats().bad_frames == {"misaligned": 1}
    assert 0 < sum(pi.missing) < 8


def test_samples_that_somebody_else_took() -> None:
    pi = Pi()

    def steal() -> None:
        if len(pi.chip.fifo) >= 28:  # the loss of a single sample may be noticed a little late
            [pi.chip.fifo.pop() for _ in range(len(pi.chip.fifo) // 14 * 14)]

    for k in range(60):
        pi.at(SETTLED_S + 0.1013 * k, steal)
    pi.run_until(SETTLED_S + 8).check()
    assert "another program that reads the same sensor" in pi.texts
    assert set(pi.source.link_stats().bad_frames) == {"out_of_step"}


def test_a_flipped_bit_of_the_count_is_asked_again() -> None:
    pi = Pi()
    chance = random.Random(1)

    def spoil(register: int, data: bytes) -> bytes:
        if register != 0x72 or chance.random() > 0.1:
            return data
        return (int.from_bytes(data, "big") ^ 1 << chance.randrange(9)).to_bytes(2, "big")

    pi.host.at(round(SETTLED_S * S), lambda: setattr(pi.bus, "spoil", spoil))
    pi.run_until(SETTLED_S + 8).check()
    assert pi.status.i2c_errors > 10
