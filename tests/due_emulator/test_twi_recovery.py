"""The TWI when lines are held, pins are lost or the sensor goes away in mid-transfer, and the way back."""

import pytest
from sensor_support import RXRDY, SCL, SDA, START, STOP, SWRST, TXCOMP, SmallBoard

from tools.due_emulator.machine import EmulationFault


@pytest.fixture
def board():
    return SmallBoard().set_up()


@pytest.mark.parametrize("wire", ["sda", "scl"])
def test_a_held_line_lets_no_transfer_begin(board, wire):
    getattr(board.lines, f"hold_{wire}")()
    assert board.read_block(0x75, 1) is None
    assert board.chip.read_block(0x75, 1) == b"\x71"


def test_a_stretched_clock_goes_on_when_it_is_let_go(board):
    board.begin_read(0x75, START | STOP)
    board.wait_us(40)
    board.lines.hold_scl()
    assert board.wait_for(TXCOMP) is None
    board.lines.release_scl()
    assert board.wait_for(TXCOMP)
    assert board.twi.read("RHR") == 0x71


def test_data_held_low_is_over_only_after_a_reset(board):
    board.begin_read(0x75, START | STOP)
    board.wait_us(40)
    board.lines.hold_sda()
    assert board.wait_for(TXCOMP) is None
    board.lines.release_sda()
    board.lines.hold_scl()
    board.lines.release_scl()
    assert board.wait_for(TXCOMP) is None
    board.set_up()
    assert board.read_block(0x75, 1) == b"\x71"


def test_recovery_by_clocks_and_stop(board):
    board.lines.hold_sda(9)
    assert board.read_block(0x75, 1) is None
    board.twi.write("CR", SWRST)
    board.take_pins()
    for _ in range(9):
        assert not board.sda()
        board.clock()
    assert board.sda()
    board.send_stop()
    board.set_up()
    assert board.read_block(0x75, 1) == b"\x71"


@pytest.mark.parametrize("how", ["SWRST", "pins", "reset"])
def test_cut_off_in_mid_byte_leaves_the_sensor_holding_sda(board, how):
    """A register of 0x00 is being read: its zeros hold SDA until eight falling edges have passed."""
    board.begin_read(0x19, START | STOP)
    board.wait_us(29 * 2.5 + 3 * 2.5 + 1)  # the fourth bit of the first byte
    match how:
        case "SWRST":
            board.twi.write("CR", SWRST)
        case "pins":
            board.take_pins()
        case "reset":
            board.twi.reset()
    assert not board.lines.sda.level
    board.take_pins()
    clocks = 0
    while not board.sda():
        board.clock()
        clocks += 1
    assert clocks == 5  # bits 4 to 7 and the acknowledge slot
    board.send_stop()
    board.set_up()
    assert board.read_block(0x75, 1) == b"\x71"


def test_a_controller_that_lost_its_pins_does_not_know_it(board):
    board.begin_read(0x75, START)
    board.take_pins()
    board.send_stop()
    board.pio.write("PDR", SDA | SCL)
    assert board.wait_for(TXCOMP) is None
    with pytest.raises(EmulationFault, match="under way"):
        board.read_block(0x75, 1)


def test_cut_off_while_scl_waits_for_rhr_is_in_the_last_bit(board):
    board.begin_read(0x19, START)
    assert board.wait_for(RXRDY)
    board.wait_us(500)
    board.twi.write("CR", SWRST)
    board.take_pins()
    assert not board.sda()
    board.clock()
    assert board.sda()


def test_unplugged_in_mid_burst(board):
    board.begin_read(0x3B, START)
    assert board.wait_for(RXRDY)
    board.lines.unplug()
    board.twi.read("RHR")
    assert board.wait_for(RXRDY)
    board.twi.read("RHR")  # was on the wires already
    board.twi.write("CR", STOP)
    assert board.wait_for(RXRDY)
    assert board.twi.read("RHR") == 0xFF
    assert board.wait_for(TXCOMP)
    assert board.read_block(0x75, 1) is None
