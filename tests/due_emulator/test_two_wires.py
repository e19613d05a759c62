"""Tests of the two wires of the I²C bus, edge by edge, and of the I²C controller (TWI) in unusual cases: a
wire is held, the pins are assigned to something else, or the sensor vanishes.
"""

import pytest

from tests.rig.sensor_support import RXRDY, SCL, SDA, START, STOP, SWRST, TXCOMP, SmallBoard
from tools.due_emulator.machine import EmulationFault, Machine
from tools.due_emulator.wire import Wire


def test_wire_levels():
    wire = Wire(Machine(), "W")
    changes: list[object] = []
    wire.listen(changes.append)
    assert not wire.level
    wire.pull_up("board", True)
    wire.drive("a", False)
    wire.drive("b", False)
    wire.drive("a", None)
    assert not wire.level
    wire.drive("b", None)
    wire.drive("a", True)
    assert wire.level
    assert changes == [True, False, True]


@pytest.mark.parametrize("first", [True, False])
def test_driving_high_what_is_held_low_is_a_short_circuit(first):
    wire = Wire(Machine(), "W")
    wire.drive("a", first)
    high, low = ("a", "b") if first else ("b", "a")
    with pytest.raises(EmulationFault, match=f"W: {high} drives it high while {low} holds it low"):
        wire.drive("b", not first)


def start(board):
    board.line(SDA, False)


def test_bit_banged_read_of_who_am_i():
    board = SmallBoard()
    board.take_pins()
    start(board)
    assert board.send_byte(0xD0)
    assert board.send_byte(0x75)
    board.line(SCL, False)
    board.line(SDA, True)
    board.line(SCL, True)
    start(board)
    assert board.send_byte(0xD1)
    assert board.receive_byte(ack=True) == 0x71
    assert board.receive_byte(ack=False) == 0x00
    board.send_stop()
    assert board.lines.clocks_without_stop == 0


def clocks_until_free(board, limit=20):
    for clocks in range(limit):
        if board.sda():
            return clocks
        board.clock()
    return None


@pytest.mark.parametrize("n", [1, 5, 9])
def test_stuck_sensor_lets_go_after_n_clocks(n):
    board = SmallBoard()
    board.lines.hold_sda(n)
    board.take_pins()
    assert clocks_until_free(board) == n


def test_stuck_for_good():
    board = SmallBoard()
    board.lines.hold_sda()
    board.take_pins()
    assert clocks_until_free(board) is None
    board.lines.release_sda()
    assert board.sda()


@pytest.mark.parametrize(
    ("byte", "bits", "clocks"),
    [
        (0x00, 0, 8),  # The whole byte is 0, so SDA is released only in the acknowledge bit.
        (0x00, 7, 1),
        (0x80, 1, 7),
        (0x01, 3, 4),
        (0xFF, 0, 0),
        (0xF0, 2, 0),  # The bit at which the sensor was cut off is a 1, so the sensor does not hold SDA low.
    ],
)
def test_sensor_cut_off_in_a_byte_holds_sda_by_its_bits(byte, bits, clocks):
    board = SmallBoard()
    board.lines.cut_off(sending=True, byte=byte, bits=bits)
    board.take_pins()
    assert clocks_until_free(board) == clocks


def test_unplugged_sensor_holds_nothing():
    board = SmallBoard()
    board.lines.hold_sda()
    board.lines.hold_scl()
    board.lines.unplug()
    assert board.lines.sda.level
    assert board.lines.scl.level
    board.lines.cut_off(sending=True, byte=0, bits=0)
    assert board.lines.sda.level


@pytest.mark.parametrize("stop", [True, False])
def test_a_stop_is_asked_for_after_clocks(stop):
    board = SmallBoard().set_up()
    board.take_pins()
    for _ in range(9):
        board.clock()
    if stop:
        board.send_stop()
        assert board.lines.recovery_clocks == 10
    board.pio.write("PDR", SDA | SCL)
    if stop:
        assert board.read_block(0x75, 1) == b"\x71"
    else:
        with pytest.raises(EmulationFault, match="9 clocks by PIO that no STOP ended"):
            board.read_block(0x75, 1)


def test_what_a_fault_does_to_the_wires_is_no_clock():
    board = SmallBoard().set_up()
    board.lines.hold_scl()
    board.lines.release_scl()
    assert board.read_block(0x75, 1) == b"\x71"


@pytest.mark.parametrize(("half_us", "too_fast"), [(1.25, False), (1.2, True), (0.5, True)])
def test_clocks_above_400_khz_are_a_fault(half_us, too_fast):
    board = SmallBoard()
    board.take_pins()
    if too_fast:
        board.clock(half_us)
        with pytest.raises(EmulationFault, match="400 kHz"):
            board.clock(half_us)
    else:
        for _ in range(9):
            board.clock(half_us)


def test_driving_scl_high_against_a_stretching_sensor_is_a_fault():
    board = SmallBoard()
    board.lines.hold_scl()
    board.pio.write("SODR", SCL)
    with pytest.raises(EmulationFault, match="SCL: PB13 drives it high while a stuck sensor holds it low"):
        board.pio.write("OER", SCL)


@pytest.fixture
def board():
    return SmallBoard().set_up()


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
    assert clocks_until_free(board) == 9
    board.send_stop()
    board.set_up()
    assert board.read_block(0x75, 1) == b"\x71"


@pytest.mark.parametrize("how", ["SWRST", "pins", "reset"])
def test_cut_off_in_mid_byte_leaves_the_sensor_holding_sda(board, how):
    """The controller is cut off while it reads a register whose value is 0x00.

    The zero bits of the value hold SDA low until eight falling edges of SCL have passed.
    """
    board.begin_read(0x19, START | STOP)
    board.wait_us(29 * 2.5 + 3 * 2.5 + 1)  # until the fourth bit of the first byte that the controller reads
    match how:
        case "SWRST":
            board.twi.write("CR", SWRST)
        case "pins":
            board.take_pins()
        case "reset":
            board.twi.reset()
    assert not board.lines.sda.level
    board.take_pins()
    assert clocks_until_free(board) == 5  # the byte's last four bits and its acknowledge need a clock each
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
    board.twi.read("RHR")  # This byte was on the wires before the sensor vanished.
    board.twi.write("CR", STOP)
    assert board.wait_for(RXRDY)
    assert board.twi.read("RHR") == 0xFF
    assert board.wait_for(TXCOMP)
    assert board.read_block(0x75, 1) is None
