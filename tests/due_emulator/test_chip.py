"""Compare the emulator's model of the sensor chip with its register maps (RM-MPU-9250A-00, RM-MPU-6000A-00)
and its data sheet (PS-MPU-9250A-01).

The expected numbers are typed by hand.
"""

import pytest

from tests.rig.chip_support import MS, Ramp, running, words
from tools.due_emulator.mpu9250 import Mpu9250
from tools.due_emulator.noise import Constant


def test_reset_values():
    chip = Mpu9250(Constant())
    values = [chip.read_block(r, 1)[0] for r in range(128)]
    # All registers except these two are 0 after a reset (MPU-9250 register map RM-MPU-9250A-00, section 3).
    assert values[0x6B] == 0x01
    assert values[0x75] == 0x71
    assert [r for r, v in enumerate(values) if v] == [0x6B, 0x75]


@pytest.mark.parametrize("who", [0x71, 0x73, 0x70, 0x68, 0x75, 0x78, 0x12])
def test_who_am_i_of_every_variant(who):
    chip = Mpu9250(Constant(), who_am_i=who)
    assert chip.read_block(0x75, 1) == bytes([who])
    chip.write_register(0x75, 0xAA)
    assert chip.read_block(0x75, 1) == bytes([who])


def test_mpu6050_sleeps_after_reset_and_lacks_accel_config_2():
    chip = Mpu9250(Constant((1.0, 0.0, 0.0)), who_am_i=0x68)
    assert chip.read_block(0x6B, 1) == b"\x40"
    chip.advance(10 * MS)
    assert chip.read_block(0x3B, 14) == bytes(14)
    chip.write_register(0x6B, 0x00)
    chip.write_register(0x1D, 0x01)
    chip.write_register(0x1B, 0x1B)
    assert chip.read_block(0x1D, 1) == b"\x00"
    assert chip.read_block(0x1B, 1) == b"\x18"  # The MPU-6050 also lacks the bits FCHOICE_B.
    chip.advance(20 * MS)
    assert words(chip.read_block(0x43, 6)) == [0, 0, 0], "the gyroscope is still starting"
    chip.advance(50 * MS)
    # The MPU-6050's counts of temperature at 25 °C are (25 - 36.53) * 340 = -3920.2.
    assert words(chip.read_block(0x3B, 14)) == [0, 0, 16384, -3920, 16, 0, 0]


@pytest.mark.parametrize(
    ("gyro", "accel", "counts", "z"),
    [
        (0x00, 0x00, [1310, -262, 32767], 16384),
        (0x08, 0x08, [655, -131, 32767], 8192),
        (0x10, 0x10, [328, -66, 32767], 4096),
        (0x18, 0x18, [164, -33, 16400], 2048),
    ],
)
def test_counts_follow_the_configured_range(gyro, accel, counts, z):
    chip = running(Constant((10.0, -2.0, 1000.0)), gyro=gyro)
    chip.write_register(0x1C, accel)
    chip.advance(5 * MS)
    accel_x, accel_y, accel_z, temperature, *rate = words(chip.read_block(0x3B, 14))
    assert rate == counts
    assert (accel_x, accel_y, accel_z) == (0, 0, z)
    assert temperature == 1335  # counts of temperature at 25 °C: (25 - 21) * 333.87


def test_saturates_at_both_ends():
    chip = running(Constant((5000.0, -5000.0, 0.0)))
    chip.advance(5 * MS)
    assert words(chip.read_block(0x43, 6)) == [32767, -32768, 0]


@pytest.mark.parametrize(
    ("who", "fchoice", "dlpf", "divider", "hz"),
    [
        # The divider SMPLRT_DIV only divides an internal rate of 1 kHz (register map RM-MPU-9250A-00,
        # register 25).
        (0x71, 0, 0, 9, 8000),
        (0x71, 0, 1, 9, 100),
        (0x71, 0, 1, 0, 1000),
        (0x71, 0, 6, 255, 1000 / 256),
        (0x71, 0, 7, 9, 8000),
        (0x71, 1, 1, 9, 32000),
        (0x71, 2, 1, 9, 32000),
        (0x68, 3, 1, 9, 100),
        (0x68, 0, 0, 7, 1000),
    ],
)
def test_output_rate(who, fchoice, dlpf, divider, hz):
    chip = running(dlpf=dlpf, divider=divider, gyro=0x18 | fchoice, who_am_i=who)
    assert chip.output_hz == pytest.approx(hz, rel=1e-12)


@pytest.mark.parametrize("power", [0x41, 0x07])
def test_stands_still_in_sleep_and_without_clock(power):
    chip = running(Ramp())
    chip.advance(5 * MS)
    before = chip.read_block(0x3B, 14)
    chip.write_register(0x6B, power)
    chip.advance(50 * MS)
    assert chip.read_block(0x3B, 14) == before


@pytest.mark.parametrize("fifo", [0x00, 0x40])
def test_a_burst_is_of_one_instant_and_single_reads_may_tear(fifo):
    chip = running(Ramp())
    chip.write_register(0x23, 0xF8)
    chip.write_register(0x6A, fifo)  # 0x40 turns the FIFO on, so that conversions continue during the burst
    chip.advance(7 * MS)
    assert chip.start(0x68, False)
    chip.advance(7_900_000)
    assert chip.write(0x3B)
    chip.advance(8 * MS)
    # The read continues after a repeated START without a STOP between, so the registers keep their values.
    assert chip.start(0x68, True)
    data = b""
    for i in range(14):
        data += bytes([chip.read(ack=i < 13)])
        chip.advance((9 + i) * MS)  # On this very slow bus, the chip measures anew during the read.
    chip.stop()
    x, _, _, _, gx, gy, gz = words(data)
    assert (x, gx, gy, gz) == (7, 7 * 0x0123, -7, 7)
    chip.advance(28 * MS)
    high = chip.read_block(0x43, 1)
    chip.advance(29 * MS)
    low = chip.read_block(0x44, 1)
    assert words(high + low)[0] == (28 * 0x0123) & ~0xFF | (29 * 0x0123) & 0xFF
    assert words(high + low)[0] not in (28 * 0x0123, 29 * 0x0123)


def test_a_range_written_by_a_slow_bus_leaves_what_was_measured_before_it():
    chip = running(Constant((10.0, 0.0, 0.0)), divider=9)
    chip.start(0x68, False)
    chip.advance(12 * MS)
    chip.write(0x1B)
    chip.write(0x00)
    chip.stop()
    assert words(chip.read_block(0x43, 2)) == [164]


def test_nothing_comes_after_a_refused_byte():
    chip = running()
    chip.start(0x68, False)
    chip.write(0x75)
    chip.start(0x68, True)
    assert [chip.read(ack=False), chip.read(ack=True)] == [0x71, 0xFF]


@pytest.mark.parametrize(
    ("register", "written", "kept"),
    [(0x1A, 0xFF, 0x7F), (0x1B, 0xFC, 0xF8), (0x1C, 0xFF, 0xF8), (0x1D, 0xFF, 0x0F), (0x37, 0xFF, 0xFE)],
)
def test_reserved_bits_stay_0(register, written, kept):
    chip = Mpu9250(Constant())
    chip.write_register(register, written)
    assert chip.read_block(register, 1)[0] == kept


def test_reset_takes_its_time():
    chip = running(at_ms=1000)
    chip.write_register(0x6B, 0x80)
    assert chip.read_block(0x75, 1) == b"\x71"  # the chip answers during its reset
    chip.advance(1012 * MS)
    assert chip.read_block(0x6B, 1) == b"\x81"  # the bit H_RESET is still set
    chip.write_register(0x1B, 0x18)  # written during the reset, so it will be lost
    chip.advance(1094 * MS)
    assert chip.read_block(0x1B, 1) == b"\x18"
    chip.advance(1096 * MS)
    assert chip.read_block(0x6B, 1) == b"\x01"
    assert chip.read_block(0x19, 5) == bytes(5)


def test_power_up_takes_its_time():
    chip = running(at_ms=1000)
    chip.power_off()
    chip.power_on()
    chip.advance(1010 * MS)
    with pytest.raises(OSError, match="Remote"):
        chip.read_block(0x75, 1)
    chip.advance(1012 * MS)
    assert chip.read_block(0x6B, 1) == b"\x01"  # no reset was requested
    chip.write_register(0x1B, 0x18)  # written before the chip is ready, so it will be lost
    chip.advance(1096 * MS)
    assert chip.read_block(0x19, 5) == bytes(5)


def test_power_cycle_and_brown_out():
    chip = running()
    chip.advance(5 * MS)
    chip.brown_out()
    # After a brown-out, the chip answers at once, with the default range of ±250 deg/s.
    assert chip.read_block(0x19, 5) == bytes(5)
    chip.advance(6 * MS)
    assert words(chip.read_block(0x43, 6)) == [131, -262, 393]
    chip.power_off()
    assert not chip.start(0x68, True)
    assert chip.read(ack=True) == 0xFF
    chip.advance(1000 * MS)
    chip.power_on(0x75)
    assert not chip.start(0x68, True)
    chip.advance(1100 * MS)
    assert chip.read_block(0x75, 1) == b"\x75"


def test_axis_switched_off_keeps_its_value():
    chip = running(Ramp())
    chip.advance(3 * MS)
    chip.write_register(0x6C, 0x04)  # sets the bit DIS_XG, which switches off the gyroscope's x axis
    chip.advance(9 * MS)
    assert words(chip.read_block(0x43, 6)) == [3 * 0x0123, -9, 9]
