"""Tests of scripted faults: the syntax of their texts, error messages, and the effect of each fault on the
board.
"""

import pytest
from fltea.records.errors import UsageError

from tests.rig.sensor_support import RXRDY, SmallBoard
from tools.due_emulator.faults import parse_fault, schedule_faults
from tools.due_emulator.machine import PS_PER_S


class Board(SmallBoard):
    """A small board with the sensor's bus. It records the calls that faults make to those parts of a board
    that it does not have.
    """

    def __init__(self):
        super().__init__()
        self.asked = []
        self.bridge = self
        self.set_up()

    def __getattr__(self, name):
        if name in ("brown_out", "reopen_port", "starve", "lose_next", "lose_randomly", "stop_reading"):
            return lambda *arguments: self.asked.append((name, *arguments))
        raise AttributeError(name)

    def suffer(self, text):
        schedule_faults(self, [parse_fault(text)])
        return self

    def who(self):
        return self.read_block(0x75, 1)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("sda_stuk at=1", r"--fault sda_stuk at=1: Invalid value .* Kinds: sda_stuck, "),
        ("", "kind"),
        ("sda_stuck at=x", r"Expected `float`.*\.at`"),
        ("sda_stuck 2.0", r"'2\.0' is not KEY=VALUE"),
        ("sda_stuck colour=1", "unknown field `colour`"),
        ("sda_stuck clocks=1 for=1", "'clocks' or 'for', not both"),
        ("sda_stuck at=-1", r"Expected `float` >= 0.0 .*\.at`"),
        ("nack_burst", "either 'count' or 'for'"),
        ("nack_burst count=1 for=1", "either 'count' or 'for'"),
        ("clone", "missing required field `who_am_i`"),
        ("clone who_am_i=0x1FF", r"Expected `int` <= 255 .*\.who_am_i`"),
        ("brown_out part=host", "Invalid enum value 'host'"),
        ("uart_loss count=2 probability=0.1 for=1", "either 'count', or both 'probability' and 'for'"),
        ("uart_loss probability=0.5", "either 'count', or both 'probability' and 'for'"),
        ("unplug at=nan", r"Expected `float` >= 0.0 .*\.at`"),
        ("unplug at=1 at=2", "at is given twice"),
        ("unplug kind=clone", "kind is given twice"),
        ("watchdog_starvation for=0", r"Expected `float` > 0.0 .*\.for`"),
        ("sensor_clock percent=nan", "at most 10 percent"),
        ("sensor_clock percent=1 ppm=1", "'percent' or 'ppm', not both"),
    ],
)
def test_mistakes_are_named(text, message):
    with pytest.raises(UsageError, match=message):
        parse_fault(text)


def test_a_fault_happens_at_its_moment():
    board = Board()
    board.wait_us(500_000)
    board.suffer("port_reopen at=1.5")
    board.wait_us(999_999)
    assert board.asked == []
    board.wait_us(1)
    assert board.asked == [("reopen_port",)]


@pytest.mark.parametrize("wire", ["sda", "scl"])
def test_a_wire_stuck_for_a_time(wire):
    board = Board().suffer(f"{wire}_stuck for=0.1")
    assert not getattr(board.lines, wire).level
    board.wait_us(100_001)
    assert getattr(board.lines, wire).level


def test_sda_stuck_for_clocks():
    board = Board().suffer("sda_stuck clocks=2")
    board.take_pins()
    board.clock()
    assert not board.sda()
    board.clock()
    assert board.sda()


@pytest.mark.parametrize(
    ("fault", "told"),
    [
        ("nack_burst count=2", [(0, None), (0, None), (0, 0x71)]),
        ("nack_burst for=0.01", [(0, None), (10_000, 0x71)]),
        ("unplug for=1 who_am_i=0x73", [(0, None), (900_000, None), (200_000, 0x73)]),
        ("unplug", [(10_000_000, None)]),
        ("clone who_am_i=0x12", [(0, 0x12)]),
        ("clone at=0.1 who_am_i=0x70", [(0, 0x71), (100_000, None), (100_000, 0x70)]),
    ],
)
def test_who_answers(fault, told):
    """`told`: pairs of a time to wait [us], and the WHO_AM_I that is read after the wait."""
    board = Board().suffer(fault)
    for wait_us, who in told:
        board.wait_us(wait_us)
        assert board.who() == (None if who is None else bytes([who]))


def test_stale_byte():
    board = Board().suffer("stale_byte count=2")
    left = []
    for _ in range(3):
        assert board.who() == b"\x71"
        left.append(bool(board.twi.read("SR") & RXRDY))
        board.twi.read("RHR")
    assert left == [True, True, False]


def test_brown_out_of_the_sensor():
    board = Board()
    board.write_register(0x1B, 0x18)
    board.suffer("brown_out")
    assert board.read_block(0x1B, 1) == b"\x00"
    assert board.asked == []


def test_sensor_clock():
    board = Board().suffer("sensor_clock percent=-1")
    assert board.chip.clock_ppm == -10_000
    assert board.suffer("sensor_clock ppm=50").chip.clock_ppm == 50


@pytest.mark.parametrize(
    ("text", "asked"),
    [
        ("brown_out part=board", ("brown_out",)),
        ("uart_loss count=7", ("lose_next", 7)),
        ("uart_loss probability=0.5 for=2", ("lose_randomly", 0.5, 2 * PS_PER_S)),
        ("host_stops_reading for=10", ("stop_reading", 10 * PS_PER_S)),
        ("watchdog_starvation for=2", ("starve", 2.0)),
        ("port_reopen", ("reopen_port",)),
    ],
)
def test_what_the_board_is_asked_for(text, asked):
    assert Board().suffer(text).asked == [asked]
