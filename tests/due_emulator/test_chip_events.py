"""Tests of the sensor chip's data-ready flag, INT pin and FIFO, and of arbitrary register accesses.

Register numbers are those of the register map.
"""

import pytest
from fltea.sources.synthetic import NoiseSettings
from hypothesis import given
from hypothesis import strategies as st

from tests.rig.chip_support import MS, Ramp, running, words
from tools.due_emulator.noise import Fractional

# Tests of the data-ready flag and the INT pin (register map RM-MPU-9250A-00, registers 55, 56 and 58)


def test_any_read_clears_the_flag_if_asked_to():
    chip = running(divider=9)
    chip.write_register(0x37, 0x10)
    chip.advance(11 * MS)
    chip.read_block(0x3B, 14)
    assert chip.read_block(0x3A, 1) == b"\x00"


def edges_of(chip, pin_cfg, until_ms, enable=0x01):
    edges = []
    chip.on_int = lambda level, at_ns: edges.append((at_ns, level))
    chip.write_register(0x37, pin_cfg)
    chip.write_register(0x38, enable)
    chip.advance(until_ms * MS)
    return edges


def test_the_part_of_a_period_that_has_passed_stays_when_the_clock_changes():
    chip = running(divider=9)
    edges = edges_of(chip, 0x00, 14)
    chip.clock_ppm = 100_000
    chip.advance(16 * MS)
    chip.clock_ppm = -100_000
    chip.advance(35 * MS)
    rises = [at for at, level in edges if level]
    # By hand: first 0.4 of a period passes, then 2 ms at 1.1 times the rate, which is 0.22 of a period. The
    # remaining 0.38 of a period runs at 0.9 times the rate.
    assert rises[:2] == [10_000_000, pytest.approx(16_000_000 + 3_800_000 / 0.9, abs=2)]
    assert rises[2] - rises[1] == pytest.approx(10_000_000 / 0.9, abs=2)


def test_int_pin_active_low():
    edges = edges_of(running(divider=9), 0x80, 15)
    assert edges == [(0, True), (10_000_000, False), (10_050_000, True)]


def test_int_pin_latches_until_the_flag_is_read():
    chip = running(divider=9)
    edges = edges_of(chip, 0x20, 35)
    assert edges == [(10_000_000, True)]
    chip.read_block(0x3B, 14)
    assert len(edges) == 1
    chip.read_block(0x3A, 1)
    assert edges[1:] == [(35_000_000, False)]
    chip.advance(41 * MS)
    assert edges[2:] == [(40_000_000, True)]


def test_int_pin_is_silent_unless_enabled():
    assert edges_of(running(divider=9), 0x00, 100, enable=0x40) == []


def test_next_event_is_the_next_edge():
    chip = running(divider=9)
    assert chip.next_event_ns() is None
    chip.write_register(0x38, 0x01)
    assert chip.next_event_ns() == 10 * MS
    chip.advance(10 * MS)
    assert chip.next_event_ns() == 10_050_000
    chip.advance(11 * MS)
    assert chip.next_event_ns() == 20 * MS


def test_time_does_not_run_backwards():
    chip = running()
    chip.advance(5)
    with pytest.raises(ValueError, match="back"):
        chip.advance(4)


# Tests of the FIFO (register map RM-MPU-9250A-00, registers 35, 106 and 114 to 116)


def filling(sources, *arguments, **options):
    """Return a chip that puts the values of these sources (bits of the register FIFO_EN) into its FIFO."""
    chip = running(*arguments, **options)
    chip.write_register(0x23, sources)
    chip.write_register(0x6A, 0x40)
    return chip


def fifo_count(chip):
    return int.from_bytes(chip.read_block(0x72, 2), "big")


def test_fifo_holds_every_sample_in_order():
    chip = filling(0xF8, Ramp(), divider=9)
    chip.advance(35 * MS)
    assert fifo_count(chip) == 42
    data = chip.read_block(0x74, 42)
    for k in range(3):
        n = 10 * (k + 1)
        assert words(data[14 * k : 14 * k + 14]) == [n, 0, 16384, 1335, n * 0x0123, -n, n]
    assert fifo_count(chip) == 0
    assert chip.read_block(0x74, 2) == data[-1:] * 2  # The FIFO is empty, so the last byte is repeated.


def test_fifo_count_is_latched_by_its_high_byte():
    chip = filling(0x40, divider=9)
    chip.advance(10 * MS)
    assert chip.read_block(0x73, 1) == b"\x00"
    assert chip.read_block(0x72, 2) == b"\x00\x02"
    chip.advance(20 * MS)
    assert chip.read_block(0x73, 1) == b"\x02"


@pytest.mark.parametrize(
    ("who", "mode", "samples", "first"),
    [(0x71, 0x01, 256, 5), (0x71, 0x41, 256, 1), (0x68, 0x01, 512, 5), (0x68, 0x41, 512, 5)],
)
def test_fifo_overflow(who, mode, samples, first):
    """Each sample has two bytes, and `samples` samples fit into the FIFO. Four more samples overflow it.

    `first`: the oldest sample that is then in the FIFO. An MPU-6050 always drops its oldest samples. An
    MPU-9250 does so, too, unless the bit FIFO_MODE (0x40 of its register CONFIG) is set: it then drops the
    newest samples.
    """
    chip = filling(0x10, Ramp(), dlpf=mode, who_am_i=who)
    chip.advance(samples * MS)
    assert chip.read_block(0x3A, 1) == b"\x01"
    chip.advance((samples + 4) * MS)
    assert chip.read_block(0x3A, 1) == b"\x11"
    assert fifo_count(chip) == 2 * samples
    assert words(chip.read_block(0x74, 4)) == [first, first + 1]
    assert chip.fifo.lost == 8
    assert chip.read_block(0x1A, 1)[0] == (0x01 if who == 0x68 else mode)


def test_a_reset_empties_the_fifo():
    chip = filling(0xF8, divider=9)
    chip.advance(50 * MS)
    chip.write_register(0x6B, 0x80)
    chip.advance(200 * MS)
    assert fifo_count(chip) == 0


def test_mpu6050_resets_its_fifo_only_while_it_is_off():
    chip = filling(0xF8, divider=9, who_am_i=0x68)
    chip.advance(10 * MS)
    chip.write_register(0x6A, 0x44)
    assert fifo_count(chip) == 14
    chip.write_register(0x6A, 0x04)
    assert fifo_count(chip) == 0


# Tests of arbitrary sequences of register accesses

READ_ONLY = [*range(0x3B, 0x61), 0x75]
SETTINGS = [0x19, 0x1A, 0x1B, 0x23, 0x37, 0x38, 0x6A, 0x6B]
operations = st.one_of(
    st.tuples(st.just("wait"), st.integers(1, 30_000_000)),
    st.tuples(
        st.just("write"),
        st.sampled_from(SETTINGS),
        st.integers(0, 255),
    ),
    st.tuples(st.just("write"), st.sampled_from(READ_ONLY), st.integers(0, 255)),
    st.tuples(st.just("fifo"), st.integers(1, 40)),
)


def at_range(n, lsb):
    values = (n * 0x0123 / 16.4 * lsb, -n / 16.4 * lsb, n / 16.4 * lsb)
    return tuple(max(-32768, min(32767, round(v))) for v in values)


@given(st.lists(operations, max_size=25), st.sampled_from([0x71, 0x68]))
def test_any_sequence_keeps_the_invariants(steps, who):
    chip = running(Ramp(), who_am_i=who, gyro=0x18)
    levels = []
    chip.on_int = lambda level, at_ns: levels.append((at_ns, level))
    now = 0
    for step in steps:
        match step:
            case ("wait", ns):
                now += ns
                chip.advance(now)
            case ("write", register, value):
                if register == 0x6A:
                    value &= ~0x10  # the bit I2C_IF_DIS is never set, because it would end the communication
                if register == 0x1B:
                    value |= 0x18
                try:
                    chip.write_register(register, value)
                except OSError:
                    continue
            case ("fifo", n):
                try:
                    chip.read_block(0x74, n)
                except OSError:
                    continue
        fifo = chip.fifo
        assert len(fifo) <= (1024 if who == 0x68 else 512)
        assert fifo.written == fifo.read_out + fifo.lost + fifo.cleared + len(fifo)
        try:
            assert chip.read_block(0x75, 1)[0] == who
            x, _, z, _, gx, gy, gz = words(chip.read_block(0x3B, 14))
        except OSError:
            continue
        # All values of one read are of the same moment. The range is ±2000 deg/s, or ±250 deg/s after a
        # reset.
        if z:
            assert (gx, gy, gz) in [at_range(x, lsb) for lsb in (16.4, 131.0)]
        else:
            assert (x, gx, gy, gz) == (0, 0, 0, 0)
    # The levels after the pin's edges alternate, and the times of the edges only increase.
    assert [level for _, level in levels] == [i % 2 == 0 for i in range(len(levels))]
    assert [at for at, _ in levels] == sorted(at for at, _ in levels)


@given(st.lists(st.integers(1, 40_000_000), min_size=1, max_size=20))
def test_how_often_time_is_advanced_changes_nothing(steps):
    """However often the time of the chip model is advanced, its registers are the same.

    When the time advances by much at once, the model skips updates of the registers.
    """
    noise = NoiseSettings(window=10)
    often, seldom = (running(Fractional(noise), divider=3) for _ in range(2))
    now = 0
    for step in steps:
        for at in range(now + 700_000, now + step, 700_000):
            often.advance(at)
            often.read_block(0x6B, 1)
        now += step
        often.advance(now)
    seldom.advance(now)
    assert often.read_block(0x3A, 15) == seldom.read_block(0x3A, 15)
