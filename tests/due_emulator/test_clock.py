"""Tests of clock tree, flash wait states, watchdog, resets and random numbers: correct use works, and misuse
ends the run.
"""

import pytest

from tests.rig.machine_support import (
    FAR,
    MS,
    PLLA_168,
    Bench,
    crystal,
    fault_of,
    peripheral,
    plla,
    reason,
    run,
    wait_states,
)
from tools.due_emulator.machine import PS_PER_S

MOSCXTS, LOCKA, MCKRDY, LOCKU, MOSCSELS, MOSCRCS = (1 << bit for bit in (0, 1, 3, 6, 16, 17))


@pytest.fixture
def board():
    """Return a board at its first instruction. The test itself makes the accesses of a program."""
    return Bench(b"\xff" * 8).board


def test_oscillator_and_pll_take_their_time(board):
    board.pmc.write("CKGR_MOR", FAR)
    begun_ps = board.machine.now_ps
    for at_ms, is_stable in ((1.94, False), (1.96, True)):
        board.machine.advance_to(begun_ps + round(at_ms * MS))
        assert bool(board.pmc.read("SR") & MOSCXTS) == is_stable
    board.pmc.write("CKGR_MOR", FAR | 1 << 24)
    assert not board.pmc.read("SR") & MOSCSELS
    board.machine.advance(MS)
    assert board.pmc.read("SR") & MOSCSELS
    assert board.machine.mck_hz == 12_000_000
    board.pmc.write("CKGR_PLLAR", PLLA_168)
    board.machine.advance(round(1.92 * MS))
    assert not board.pmc.read("SR") & LOCKA
    board.machine.advance(round(0.01 * MS))
    assert board.pmc.read("SR") & LOCKA


def test_the_master_clock_changes_when_mckrdy_comes_back(board):
    wait_states(board)
    plla(board)
    board.pmc.write("MCKR", 0x11)
    assert not board.pmc.read("SR") & MCKRDY
    assert board.machine.mck_hz == 12_000_000
    board.machine.advance(MS)
    assert board.machine.mck_hz == 6_000_000


def test_the_usb_pll_locks(board):
    crystal(board)
    board.pmc.write("CKGR_UCKR", 3 << 20 | 1 << 16)
    assert not board.pmc.read("SR") & LOCKU
    board.machine.advance(MS)
    assert board.pmc.read("SR") & LOCKU


def test_the_rc_oscillator_changes_its_frequency_by_itself(board):
    board.pmc.write("CKGR_MOR", 0x0037_0008 | 1 << 4)
    assert not board.pmc.read("SR") & MOSCRCS
    assert board.machine.mck_hz == 4_000_000
    board.machine.advance(MS)
    assert board.pmc.read("SR") & MOSCRCS
    assert board.machine.mck_hz == 8_000_000


def test_another_frequency_of_the_rc_oscillator_changes_nothing_under_the_crystal(board):
    crystal(board)
    board.pmc.write("CKGR_MOR", FAR | 1 << 24 | 2 << 4)
    board.machine.advance(MS)
    assert board.machine.mck_hz == 12_000_000, "the crystal rules"


def test_a_reset_while_an_oscillator_starts_lets_it_start_again(board):
    board.pmc.write("CKGR_MOR", FAR)
    board.machine.advance(MS)
    board.reopen_port()
    crystal(board)
    assert board.machine.mck_hz == 12_000_000


def test_peripheral_clocks_are_switched_one_by_one(board):
    board.pmc.write("PCER0", 1 << 8 | 1 << 23)
    board.pmc.write("PCER1", 1 << 12)
    assert [n for n in range(45) if board.machine.clock_on(n)] == [8, 23, 44]
    assert (board.pmc.read("PCSR0"), board.pmc.read("PCSR1")) == (1 << 8 | 1 << 23, 1 << 12)
    board.pmc.write("PCDR0", 1 << 8)
    assert "without its clock" in reason(board.uart.read, "SR")


@pytest.mark.parametrize("register", ["CR", "MR"])
def test_the_supply_controller_has_a_key(board, register):
    supply = next(p for p in board.peripherals if p.name == "SUPC")
    assert "without its key" in reason(supply.write, register, 0x4)
    supply.write(register, 0xA500_0008)
    assert supply.registers[register] == 0x8


def test_code_in_flash_may_not_hide_the_flash():
    assert "run it from RAM" in fault_of("store 0x400E0A04, 0x5A00000E\n wait_forever")


def test_gpnvm_says_that_the_board_boots_from_flash(board):
    board.flash_controllers[0].write("FCR", 0x5A00000D)
    assert not board.flash_controllers[0].read("FSR") & 1
    board.machine.advance(MS)
    assert board.flash_controllers[0].read("FSR") & 1
    assert board.flash_controllers[0].read("FRR") == 2


def test_an_unfed_watchdog_resets_the_board_after_16_s(board):
    board.watchdog.write("MR", 0x0FFF_2FFF)
    board.machine.advance_to(15 * PS_PER_S)
    assert not board.events
    board.machine.advance_to(17 * PS_PER_S)
    assert "watchdog" in board.events[0]
    assert board.reset_controller.read("SR") >> 8 & 7 == 2


def test_a_sleeping_processor_does_not_wake_the_watchdog_unless_it_is_told_so():
    asleep = run("wait_forever", 20)
    assert not asleep.board.events, "WDIDLEHLT is set after reset"
    watched = run("store 0x400E1A54, 0x0FFF2FFF\n wait_forever", 20)
    assert len(watched.board.events) == 1


def test_feeding_keeps_the_watchdog_quiet_and_needs_its_key(board):
    board.watchdog.write("MR", 256 | 1 << 13 | 0xFFF << 16)  # a time-out of 1 s
    for _ in range(5):
        board.machine.advance(PS_PER_S * 9 // 10)
        board.watchdog.write("CR", 0xA500_0001)
    assert not board.events
    assert "0xA5000001" in reason(board.watchdog.write, "CR", 1)


def test_feeding_too_early_for_the_window_bites(board):
    board.watchdog.write("MR", 256 | 1 << 13 | 128 << 16)
    board.machine.advance(PS_PER_S // 4)
    board.watchdog.write("CR", 0xA500_0001)
    assert len(board.events) == 1


def test_a_watchdog_that_is_off_stays_off(board):
    board.watchdog.write("MR", 1 << 15)
    board.machine.advance_to(40 * PS_PER_S)
    assert not board.events


def test_the_watchdog_mode_is_written_once_a_reset(board):
    board.watchdog.write("MR", 1 << 15)
    assert "only once" in reason(board.watchdog.write, "MR", 1 << 15)
    board.reopen_port()
    board.watchdog.write("MR", 1 << 15)


def test_the_program_can_reset_the_chip_with_the_key_only():
    text = "load r1, 0x400E1A04\n keep r1, 1\n cmp r1, #0x300\n ldr r2, =0x10300\n cmp r1, r2\n beq 3f\n"
    text += " store 0x400E1A00, 0xA5000005\n nop\n nop\n3: wait_forever"
    bench = run(text)
    assert bench.slot(1) == 0x10300
    assert bench.board.resets == 1
    assert "without its key" in reason(bench.board.reset_controller.write, "CR", 5)


def test_sysresetreq_resets_the_chip():
    text = (
        "load r1, 0x400E1A04\n ldr r2, =0x10300\n cmp r1, r2\n beq 3f\n store 0xE000ED0C, 0x05FA0004\n nop\n"
    )
    assert run(text + "3: wait_forever").board.resets == 1


def test_random_words_need_the_key_and_time_and_differ(board):
    board.pmc.write("PCER1", 1 << 9)
    trng = peripheral(board, "TRNG")
    assert "without its key" in reason(trng.write, "CR", 1)
    trng.write("CR", 0x524E4701)
    assert not trng.read("ISR")
    words = []
    for _ in range(4):
        board.machine.advance(MS)
        assert trng.read("ISR") == 1
        assert trng.read("ISR") == 0
        words.append(trng.read("ODATA"))
    assert len(set(words)) == 4
    assert "no new word" in reason(trng.read, "ODATA")


def test_systick_counts_down_wraps_and_pends(board):
    tick, machine = board.system_control.systick, board.machine
    tick.write_load(3999)
    tick.write_value(0)
    tick.write_control(7)
    machine.advance(MS // 4)
    assert tick.read_value() == 3000
    assert tick.read_control() == 7
    machine.advance(MS * 3 // 4)
    assert tick.read_value() == 0
    assert tick.read_control() == 7 | 1 << 16
    assert tick.read_control() == 7, "reading clears COUNTFLAG"
    machine.advance(PS_PER_S // 4_000_000)
    assert tick.read_value() == 3999
    assert board.system_control.read(0xE000ED04, 4) & 1 << 26


@pytest.mark.parametrize(
    ("control", "counted"), [(5, 4000 + 8000), (1, 500 + 1000)], ids=["all", "an eighth"]
)
def test_systick_keeps_its_count_over_a_change_of_the_clock(board, control, counted):
    tick = board.system_control.systick
    tick.write_load(0xFF_FFFF)
    tick.write_value(0)
    tick.write_control(control)
    board.machine.advance(MS)
    board.machine.set_mck(8_000_000)
    board.machine.advance(MS)
    assert tick.read_value() == 0x100_0000 - counted
