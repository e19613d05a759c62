"""Tests of the timer counters: how they count, when they reach the compare value, which uses are refused."""

import pytest

from tests.rig.machine_support import Bench, peripheral, reason
from tools.due_emulator.machine import PS_PER_S, PS_PER_US

US = PS_PER_US
CPCS, COVFS, CLKSTA = 1 << 4, 1 << 0, 1 << 16
WAVE, UP_TO_RC, CPCTRG = 1 << 15, 2 << 13, 1 << 14
START = 5


@pytest.fixture
def board():
    board = Bench(b"\xff" * 8).board
    board.machine.set_mck(84_000_000)
    board.machine.clocked = 0b111 << 27
    board.watchdog.write("MR", 1 << 15)
    board.irqs = {}
    board.machine.on_irq = board.irqs.__setitem__
    return board


@pytest.fixture
def tc(board):
    return peripheral(board, "TC0")


def begin(tc, mode, channel=0, **registers):
    """Set up one counter (channel) of a timer, and start it."""
    for name, value in {"CMR": mode, **registers, "CCR": START}.items():
        tc.write(f"{name}{channel}", value)


@pytest.mark.parametrize(("source", "count"), [(0, 42_000), (1, 10_500), (2, 2625), (3, 656), (4, 32)])
def test_each_clock_counts_at_its_rate(board, tc, source, count):
    begin(tc, WAVE | source)
    board.machine.advance(1000 * US)
    assert tc.read("CV0") == count
    assert tc.read("SR0") & CLKSTA


def test_up_to_rc_repeats_without_drift_and_asks_for_an_interrupt(board, tc):
    begin(tc, WAVE | UP_TO_RC, RC=420_000, IER=CPCS)
    begun_ps = board.machine.now_ps
    for n in range(1, 6):
        board.machine.advance_to(begun_ps + n * 10_000 * US - 1)
        assert not board.irqs[27]
        assert tc.read("CV0") == 419_999
        board.machine.advance_to(begun_ps + n * 10_000 * US)
        assert board.irqs[27]
        assert tc.read("CV0") == 0
        assert tc.read("SR0") & CPCS
        assert not board.irqs[27], "reading SR ends the request"
        assert not tc.read("SR0") & CPCS


def test_counting_up_to_the_end_compares_with_rc_on_the_way(board, tc):
    begin(tc, WAVE, RC=1000, IER=CPCS)
    board.machine.advance(24 * US)
    assert board.irqs[27]
    assert tc.read("SR0") & CPCS
    assert tc.read("CV0") == 1008
    tc.write("RC0", 2000)
    board.machine.advance(20 * US)
    assert not board.irqs[27]
    board.machine.advance(4 * US)
    assert board.irqs[27]
    assert tc.read("CV0") == 2016


def test_a_compare_behind_the_count_waits_for_the_next_lap_and_setting_it_costs_no_time(board, tc):
    begin(tc, WAVE)
    board.machine.advance(100 * US)
    tc.write("RC0", 100)
    board.machine.advance(US)
    assert not tc.read("SR0") & CPCS
    for _ in range(100):
        board.machine.advance(PS_PER_S // 84_000_000)  # half the time that one count of the timer takes
        tc.write("RC0", 100)
    assert tc.read("CV0") == 4242 + 49
    board.machine.advance(103 * PS_PER_S)
    assert tc.read("SR0") & CPCS


def test_the_end_of_32_bits_is_an_overflow(board, tc):
    begin(tc, WAVE, IER=COVFS)
    board.machine.advance(102 * PS_PER_S)
    assert not board.irqs[27]
    board.machine.advance(PS_PER_S)
    assert board.irqs[27]
    assert tc.read("CV0") == 103 * 42_000_000 - (1 << 32)


def test_capture_mode_can_start_over_at_rc(board, tc):
    begin(tc, CPCTRG, RC=100)
    board.machine.advance(3 * US)
    assert tc.read("CV0") == 26
    assert tc.read("SR0") & CPCS


def test_a_trigger_starts_over_and_disabling_stops(board, tc):
    begin(tc, WAVE)
    board.machine.advance(US)
    assert tc.read("CV0") == 42
    tc.write("CCR0", 4)
    assert tc.read("CV0") == 0
    tc.write("CCR0", 2)
    board.machine.advance(US)
    assert not tc.read("SR0") & CLKSTA
    tc.write("CCR0", 4)
    board.machine.advance(US)
    assert tc.read("CV0") == 0, "a trigger without a clock starts nothing"


def test_the_count_survives_a_change_of_the_master_clock(board, tc):
    begin(tc, WAVE)
    board.machine.advance(10 * US)
    board.machine.set_mck(42_000_000)
    board.machine.advance(10 * US)
    assert tc.read("CV0") == 420 + 210


def test_channels_are_apart(board, tc):
    begin(tc, WAVE | UP_TO_RC, 1, RC=42, IER=CPCS)
    board.machine.advance(US)
    assert board.irqs[28]
    assert not board.irqs.get(27)
    assert tc.read("CV0") == tc.read("SR0") == 0


def test_each_channel_needs_its_own_clock(board, tc):
    board.machine.clocked = 1 << 27
    tc.read("CV0")
    assert "TC0_CV1 without its clock: bit 28 of PMC_PCER0" in reason(tc.read, "CV1")


def test_a_reset_stops_everything(board, tc):
    begin(tc, WAVE | UP_TO_RC, RC=42, IER=CPCS)
    tc.reset()
    board.machine.advance(10 * US)
    assert not board.irqs[27]
    assert tc.read("CV0") == tc.read("RC0") == tc.read("IMR0") == 0
