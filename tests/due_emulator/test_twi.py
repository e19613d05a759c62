"""Tests of the I²C controller (TWI) as a master.

Its behaviour is that of the SAM3X datasheet, chapter 33. Expected times are computed by hand from the bits on
the wires.
"""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.rig.sensor_support import (
    MSEN,
    NACK,
    RXRDY,
    START,
    STOP,
    SWRST,
    TWI1_ID,
    TXCOMP,
    TXRDY,
    US,
    SmallBoard,
)
from tools.due_emulator.machine import EmulationFault
from tools.due_emulator.noise import Motion

BIT_PS = 2_500_000


@pytest.fixture
def board():
    return SmallBoard().set_up()


def words(data):
    return [int.from_bytes(data[i : i + 2], "big", signed=True) for i in range(0, len(data), 2)]


def test_reads_and_writes_registers(board):
    assert board.read_block(0x75, 1) == b"\x71"
    assert board.write_register(0x1B, 0x18)
    board.wait_us(2000)
    assert board.read_block(0x1A, 3) == b"\x00\x18\x00"
    assert words(board.read_block(0x43, 6)) == [16, -33, 49]


@pytest.mark.parametrize(
    ("n", "bits"),
    # By hand, in bits: START 1, address 9, register 9, repeated START 1, address 9, each byte that is read 9,
    # STOP 1.
    [(1, 39), (5, 75), (14, 156), (20, 210)],
)
def test_a_read_takes_its_time_on_the_wires(board, n, bits):
    assert len(board.read_block(0x3B, n)) == n
    assert board.twi.busy_ps == bits * 2_500_000  # a read of 14 bytes takes 390 us


@pytest.mark.parametrize(
    ("cwgr", "hz"),
    [
        (101 << 8 | 101, 400_000),  # by hand: 84 MHz / (2 * (101 + 4))
        (2 << 16 | 104 << 8 | 104, 100_000),  # by hand: 84 MHz / (2 * (104 * 4 + 4))
    ],
)
def test_bus_clock(board, cwgr, hz):
    board.twi.write("CWGR", cwgr)
    assert board.twi.scl_hz == pytest.approx(hz)


def test_status_after_reset_and_after_msen(board):
    board.twi.write("CR", SWRST)
    assert board.twi.read("SR") == 0xF009  # the value after reset, from the vendor's description (SVD)
    board.twi.write("CR", MSEN)
    assert board.twi.read("SR") & (TXCOMP | TXRDY) == TXCOMP | TXRDY


def test_nobody_at_the_address(board):
    board.begin_read(0x75, START | STOP, device=0x69)
    assert not board.twi.read("SR") & TXCOMP
    seen = board.wait_for(TXCOMP)
    assert seen & NACK
    assert not seen & RXRDY
    assert not board.twi.read("SR") & NACK  # The last read of the register SR has cleared the flag.
    assert board.twi.busy_ps == (1 + 9 + 1) * 2_500_000
    assert board.read_block(0x75, 1) == b"\x71"


def test_refused_byte_of_a_write(board):
    board.socket.nacks_left = 0
    board.address(0x1B, False)
    board.twi.write("THR", 0x18)
    board.wait_us(60)  # In this time, the chip's address and the register number are sent.
    board.socket.nacks_left = 1
    assert board.wait_for(TXCOMP) & NACK
    assert board.chip.read_block(0x1B, 1) == b"\x00"


@pytest.mark.parametrize("reset", [False, True])
def test_what_a_refused_write_leaves_is_sent_first_by_the_next_one(board, reset):
    board.socket.nacks_left = 1
    board.begin_write(0x1B, 0x18)
    assert board.wait_for(TXCOMP) & NACK
    if reset:
        board.set_up()
    # A read is not affected by the byte that the refused write has left in the controller.
    assert board.read_block(0x75, 1) == b"\x71"
    board.begin_write(0x1B, 0x10)
    assert not board.wait_for(TXCOMP) & NACK
    # If the controller was not reset, it first sends 0x18, which the refused write left, into register 0x1B.
    # The new byte 0x10 then goes into register 0x1C.
    assert board.chip.read_block(0x1B, 2) == (b"\x10\x00" if reset else b"\x18\x10")
    # This second write has used up the byte that the refused write left, so a third write finds none.
    board.begin_write(0x1B, 0x08)
    board.wait_for(TXCOMP)
    assert board.chip.read_block(0x1B, 1) == b"\x08"


def test_several_bytes_of_a_write(board):
    board.address(0x19, False)
    for value in (9, 1, 0x18):
        assert board.wait_for(TXRDY)
        board.twi.write("THR", value)
    board.twi.write("CR", STOP)
    assert board.wait_for(TXCOMP)
    assert board.chip.read_block(0x19, 3) == b"\x09\x01\x18"


def test_internal_address_of_two_bytes_goes_out_high_byte_first(board):
    board.twi.write("MMR", 0x68 << 16 | 2 << 8)
    board.twi.write("IADR", 0x1907)
    board.twi.write("THR", 0x03)
    board.twi.write("CR", STOP)
    assert board.wait_for(TXCOMP)
    assert board.chip.read_block(0x19, 2) == b"\x07\x03"


def test_a_write_waits_for_its_stop(board):
    board.address(0x19, False)
    board.twi.write("THR", 9)
    assert board.wait_for(TXCOMP) is None
    board.twi.write("CR", STOP)
    assert board.wait_for(TXCOMP)


def test_scl_waits_until_rhr_is_read(board):
    """The controller holds the clock wire SCL until the program reads the received byte from the register
    RHR. So no overrun occurs: the second byte does not end before the first is read (SAM3X datasheet, section
    33.8.5).
    """
    board.begin_read(0x75, START)
    assert board.wait_for(RXRDY)
    board.wait_us(500)
    board.twi.write("CR", STOP)
    assert board.twi.read("RHR") == 0x71
    assert board.wait_for(TXCOMP)
    assert board.twi.read("RHR") == 0x00


@pytest.mark.parametrize(
    ("fetched", "waits"),
    # While a received byte waits in the register RHR, the controller receives the next byte except for its
    # last half bit. It then holds SCL low, from 7.5 bits after the end of the first byte until RHR is read.
    # `fetched`: time from the end of the first byte to the reading of RHR; `waits`: how long SCL is held low;
    # both in bits.
    [(0.4, 0), (7.4, 0), (7.6, 0.1), (8.2, 0.7), (30, 22.5)],
)
def test_scl_waits_on_the_last_bit_for_as_long_as_rhr_is_full(board, fetched, waits):
    begun_ps = board.machine.now_ps
    board.begin_read(0x75, START)
    board.machine.advance_to(begun_ps + round((38 + fetched) * BIT_PS))
    assert board.twi.read("RHR") == 0x71
    board.twi.write("CR", STOP)
    assert board.wait_for(TXCOMP)
    assert board.twi.busy_ps == round((39 + 9 + waits) * BIT_PS)


def test_a_byte_ends_after_scl_was_let_go(board):
    begun_ps = board.machine.now_ps
    board.begin_read(0x75, START | STOP)
    for bits, act in ((32, board.lines.hold_scl), (50, board.lines.release_scl)):
        board.machine.advance_to(begun_ps + bits * BIT_PS)
        act()
    assert board.wait_for(RXRDY)
    assert board.machine.now_ps - begun_ps == pytest.approx(51.5 * BIT_PS, abs=US)
    assert board.wait_for(TXCOMP)
    assert board.twi.busy_ps == 52.5 * BIT_PS


@pytest.mark.parametrize(("stop", "bits"), [(7.9, 48), (8.1, 57)])
def test_a_byte_is_acknowledged_unless_stop_was_set_before_its_last_bit_ended(board, stop, bits):
    begun_ps = board.machine.now_ps
    board.begin_read(0x75, START)
    board.machine.advance_to(begun_ps + 39 * BIT_PS)
    board.twi.read("RHR")
    board.machine.advance_to(begun_ps + round((38 + stop) * BIT_PS))
    board.twi.write("CR", STOP)
    board.machine.advance_to(begun_ps + 48 * BIT_PS)
    board.twi.read("RHR")
    assert board.wait_for(TXCOMP)
    assert board.twi.busy_ps == bits * BIT_PS


def test_stop_set_too_late_is_a_fault(board):
    """The program sets STOP only after it has read the last byte.

    At that time, a further byte is already on the wires, which the program does not want.
    """
    board.begin_read(0x3B, START)
    for _ in range(14):
        assert board.wait_for(RXRDY)
        board.twi.read("RHR")
    board.twi.write("CR", STOP)
    assert board.wait_for(TXCOMP)
    with pytest.raises(EmulationFault, match="STOP was set too late"):
        board.read_block(0x3B, 14)


def test_a_stale_byte_shifts_the_next_read_that_does_not_drain_it(board):
    """After a complete read, the flag RXRDY may stay set, with a byte too many in the controller.

    TWI controllers older than the SAMA5D2's behave in this way (Linux, i2c-at91-master.c).
    """
    board.wait_us(2000)
    burst = board.read_block(0x3B, 14)
    board.twi.stale_reads = 1
    assert board.read_block(0x3B, 14) == burst
    assert board.twi.read("SR") & RXRDY
    assert board.read_block(0x3B, 14) == b"\xff" + burst[:-1]
    assert not board.twi.read("SR") & RXRDY
    assert board.read_block(0x3B, 14) == burst


@pytest.mark.parametrize("drained", [True, False])
def test_a_late_stop_is_a_fault_although_a_byte_was_stale(board, drained):
    board.twi.stale_reads = 1
    board.read_block(0x3B, 14)
    if drained:
        board.twi.read("RHR")
    board.read_block(0x3B, 14)
    test_stop_set_too_late_is_a_fault(board)


@pytest.mark.parametrize("how", ["RHR", "SWRST"])
def test_a_stale_byte_is_drained(board, how):
    board.twi.stale_reads = 1
    assert board.read_block(0x75, 1) == b"\x71"
    if how == "RHR":
        assert board.twi.read("RHR") == 0xFF
    else:
        board.set_up()
    assert board.read_block(0x75, 1) == b"\x71"
    assert not board.twi.read("SR") & RXRDY


def test_a_stale_byte_waits_for_the_last_byte_to_be_fetched(board):
    board.twi.stale_reads = 1
    board.begin_read(0x75, START | STOP)
    board.wait_us(500)
    assert not board.twi.read("SR") & TXCOMP
    assert board.twi.read("RHR") == 0x71
    assert board.wait_for(TXCOMP) & RXRDY


def test_stop_set_while_the_last_byte_arrives_is_in_time(board):
    """The Arduino core sets STOP after it has read the last byte but one, as this test does."""
    board.begin_read(0x3B, START)
    for i in range(14):
        if i == 13:
            board.twi.write("CR", STOP)
        assert board.wait_for(RXRDY)
        board.twi.read("RHR")
    assert board.wait_for(TXCOMP)
    assert board.read_block(0x75, 1) == b"\x71"


@pytest.mark.parametrize("off", [0x20, SWRST])
def test_slave_mode_may_have_been_on(board, off):
    """The Arduino core switches slave mode on and off again before it sets up the master."""
    board.twi.write("CR", 0x10)
    board.twi.write("CR", off)
    board.twi.write("CWGR", 101 << 8 | 101)
    board.twi.write("CR", MSEN)
    assert board.read_block(0x75, 1) == b"\x71"


def test_master_can_be_switched_off_in_mid_transfer(board):
    board.begin_read(0x75, START)
    board.twi.write("CR", 0x08)
    board.twi.write("CR", MSEN)
    assert board.read_block(0x75, 1) == b"\x71"


def test_interrupt_follows_the_enabled_flags(board):
    board.twi.write("IER", RXRDY | NACK)
    assert board.twi.read("IMR") == RXRDY | NACK
    board.begin_read(0x75, START | STOP)
    assert not board.irqs[TWI1_ID]
    board.wait_us(150)
    assert board.irqs[TWI1_ID]
    board.twi.read("RHR")
    assert not board.irqs[TWI1_ID]
    board.twi.write("IER", TXCOMP)
    assert board.irqs[TWI1_ID]
    board.twi.write("IDR", TXCOMP)
    assert not board.irqs[TWI1_ID]


def test_bus_load_counts_a_transfer_that_hangs(board):
    board.address(0x75, True)
    board.lines.hold_sda()
    board.twi.write("CR", START)
    board.wait_us(1000)
    assert board.twi.load_ps == 1000 * US
    board.twi.write("CR", SWRST)
    assert (board.twi.load_ps, board.twi.transfers) == (1000 * US, 1)


def test_a_burst_on_the_wires_is_of_one_instant(board):
    """The read takes 390 us. At an output rate of 8 kHz, the chip updates its registers three times in that
    time.
    """

    class Counting:
        def at(self, now_ns):
            n = float(now_ns // 125_000)
            return Motion((n, n, n), (n / 16384, n / 16384, n / 16384), 25.0)

    board.chip.world = Counting()
    for _ in range(20):
        ax, ay, az, _, gx, gy, gz = words(board.read_block(0x3B, 14))
        assert ax == ay == az
        assert (gx, gy, gz) == (ax * 131,) * 3


settings = st.tuples(st.sampled_from([0x19, 0x1A, 0x1C, 0x23]), st.integers(0, 255))


@given(st.lists(settings, max_size=8), st.data())
def test_the_bus_and_the_chip_agree(writes, data):
    board = SmallBoard().set_up()
    for register, value in writes:
        assert board.write_register(register, value)
        n = data.draw(st.integers(1, 6))
        assert board.read_block(0x19, n) == board.chip.read_block(0x19, n)
