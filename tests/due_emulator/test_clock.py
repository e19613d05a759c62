"""Clock tree, flash wait states, watchdog, resets and random numbers: what works, and what ends the run."""

import pytest
from machine_support import Bench, fault_of, run

from tools.due_emulator.machine import PS_PER_S, EmulationFault

MS = PS_PER_S // 1000
FAR = 0x0037_0809
"""CKGR_MOR with its key: crystal and RC on, start-up 64 slow cycles (1.95 ms)."""
PLLA_168 = 1 << 29 | 13 << 16 | 0x3F << 8 | 1
MOSCXTS, LOCKA, MCKRDY, LOCKU, MOSCSELS, MOSCRCS = (1 << bit for bit in (0, 1, 3, 6, 16, 17))


@pytest.fixture
def board():
    """A board at its first instruction; the test plays the program."""
    return Bench(b"\xff" * 8).board


def reason(action, *arguments):
    with pytest.raises(EmulationFault) as caught:
        action(*arguments)
    return caught.value.reason


def crystal(board):
    board.pmc.write("CKGR_MOR", FAR)
    board.machine.advance(2 * MS)
    board.pmc.write("CKGR_MOR", FAR | 1 << 24)
    board.machine.advance(MS)


def plla(board, value=PLLA_168):
    crystal(board)
    board.pmc.write("CKGR_PLLAR", value)
    board.machine.advance(2 * MS)


def wait_states(board, fws=4):
    for controller in board.flash_controllers:
        controller.write("FMR", fws << 8)


def full_speed(board):
    wait_states(board)
    plla(board)
    for value in (0x11, 0x12):
        board.pmc.write("MCKR", value)
        board.machine.advance(MS)


def test_the_chip_starts_on_the_rc_oscillator_at_4_mhz(board):
    assert board.machine.mck_hz == 4_000_000
    assert board.pmc.read("SR") & (MCKRDY | MOSCSELS) == MCKRDY | MOSCSELS
    assert board.pmc.read("MCKR") == 1


def test_the_way_to_84_mhz(board):
    full_speed(board)
    assert board.machine.mck_hz == 84_000_000
    assert board.pmc.read("SR") & MCKRDY


def test_oscillator_and_pll_take_their_time(board):
    board.pmc.write("CKGR_MOR", FAR)
    begun_ps = board.machine.now_ps
    for flag, before, after in ((MOSCXTS, 1.94, 1.96),):
        board.machine.advance_to(begun_ps + round(before * MS))
        assert not board.pmc.read("SR") & flag
        board.machine.advance_to(begun_ps + round(after * MS))
        assert board.pmc.read("SR") & flag
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


def test_the_oscillator_is_not_selected_before_it_is_ready(board):
    board.pmc.write("CKGR_MOR", FAR)
    assert "before it is ready" in reason(board.pmc.write, "CKGR_MOR", FAR | 1 << 24)


def test_the_oscillator_register_has_a_key(board):
    assert "without its key" in reason(board.pmc.write, "CKGR_MOR", 0x809)


def test_the_oscillator_that_is_in_use_is_not_stopped(board):
    assert "stops the RC oscillator" in reason(board.pmc.write, "CKGR_MOR", 0x0037_0801)


def test_plla_is_not_selected_before_it_locks(board):
    wait_states(board)
    crystal(board)
    board.pmc.write("CKGR_PLLAR", PLLA_168)
    board.pmc.write("MCKR", 0x11)
    board.machine.advance(round(0.5 * MS))
    assert "not ready" in reason(board.pmc.write, "MCKR", 0x12)


def test_source_and_prescaler_are_not_changed_at_once(board):
    wait_states(board)
    plla(board)
    assert "CSS and PRES at once" in reason(board.pmc.write, "MCKR", 0x12)


def test_the_master_clock_is_not_changed_while_it_changes(board):
    wait_states(board)
    plla(board)
    board.pmc.write("MCKR", 0x11)
    assert "before the change before it is done" in reason(board.pmc.write, "MCKR", 0x12)


def test_plla_needs_its_bit_29_and_a_possible_frequency(board):
    crystal(board)
    assert "bit 29" in reason(board.pmc.write, "CKGR_PLLAR", PLLA_168 & ~(1 << 29))
    assert "204 MHz" in reason(board.pmc.write, "CKGR_PLLAR", 1 << 29 | 16 << 16 | 0x3F00 | 1)


def test_plla_is_not_changed_while_it_is_in_use(board):
    full_speed(board)
    assert "comes from PLLA" in reason(board.pmc.write, "CKGR_PLLAR", PLLA_168)


def test_more_than_84_mhz_end_the_run(board):
    wait_states(board)
    plla(board, 1 << 29 | 14 << 16 | 0x3F00 | 1)
    board.pmc.write("MCKR", 0x11)
    board.machine.advance(MS)
    assert "90 MHz: at most 84" in reason(board.pmc.write, "MCKR", 0x12)


@pytest.mark.parametrize(("first", "second"), [(3, 4), (4, 3), (0, 4), (4, 0)])
def test_both_flash_controllers_need_wait_states_first(board, first, second):
    plla(board)
    for controller, fws in zip(board.flash_controllers, (first, second), strict=True):
        controller.write("FMR", fws << 8)
    board.pmc.write("MCKR", 0x11)
    board.machine.advance(MS)
    slow = 0 if first < 4 else 1
    assert f"EFC{slow}_FMR.FWS is" in reason(board.pmc.write, "MCKR", 0x12)


def test_wait_states_are_not_taken_back_at_full_speed(board):
    full_speed(board)
    assert "FWS is 1, good for 34 MHz" in reason(board.flash_controllers[0].write, "FMR", 1 << 8)


def test_peripheral_clocks_are_switched_one_by_one(board):
    board.pmc.write("PCER0", 1 << 8 | 1 << 23)
    board.pmc.write("PCER1", 1 << 9)
    assert [n for n in range(45) if board.machine.clock_on(n)] == [8, 23, 41]
    assert (board.pmc.read("PCSR0"), board.pmc.read("PCSR1")) == (1 << 8 | 1 << 23, 1 << 9)
    board.pmc.write("PCDR0", 1 << 8)
    assert "without its clock" in reason(board.uart.read, "SR")


@pytest.mark.parametrize(("register", "bit"), [("PCER0", 7), ("PCER0", 2), ("PCER1", 13)])
def test_clocks_of_peripherals_that_do_not_exist_end_the_run(board, register, bit):
    assert "do not exist" in reason(board.pmc.write, register, 1 << bit)
    board.pmc.write(register.replace("PCE", "PCD"), 1 << bit)


def test_the_highest_and_the_lowest_clock_exist(board):
    board.pmc.write("PCER0", 1 << 8)
    board.pmc.write("PCER1", 1 << 12)
    assert [n for n in range(45) if board.machine.clock_on(n)] == [8, 44]


def test_write_protection_of_the_pmc_has_a_key(board):
    assert "without its key" in reason(board.pmc.write, "WPMR", 0)
    board.pmc.write("WPMR", 0x504D_4300)


@pytest.mark.parametrize("register", ["CR", "MR"])
def test_the_supply_controller_has_a_key(board, register):
    supply = next(p for p in board.peripherals if p.name == "SUPC")
    assert "without its key" in reason(supply.write, register, 0x4)
    supply.write(register, 0xA500_0008)
    assert supply.registers[register] == 0x8


def test_the_unique_identifier_stands_in_place_of_the_flash_between_stui_and_spui():
    text = """
  ldr r4, =0x20071000
  adr r5, routine
  movs r6, #20
1: ldr r7, [r5], #4
  str r7, [r4], #4
  subs r6, #1
  bne 1b
  ldr r4, =0x20071001
  blx r4
  load r1, 0x00080004
  keep r1, 6
  wait_forever
.align 2
routine:
  ldr r0, base
  ldr r1, start_id
  str r1, [r0, #4]
  ldr r2, [r0, #8]
  ldr r3, flash
  ldmia r3, {r3, r4, r5, r6}
  ldr r1, stop_id
  str r1, [r0, #4]
2: ldr r1, [r0, #8]
  lsls r1, #31
  beq 2b
  ldr r0, result
  stmia r0, {r2, r3, r4, r5, r6}
  bx lr
.align 2
base: .word 0x400E0A00
start_id: .word 0x5A00000E
flash: .word 0x00080000
stop_id: .word 0x5A00000F
result: .word 0x20070004
"""
    boards = [run(text, seed=seed) for seed in (1, 1, 2)]
    ids = [tuple(bench.slot(n) for n in range(2, 6)) for bench in boards]
    assert boards[0].slot(1) == 0, "FRDY is 0 while the identifier is shown"
    assert ids[0] == ids[1] != ids[2]
    assert len(set(ids[0])) == 4
    assert boards[0].slot(6) & ~0xFFF == 0x80000, "the flash is back"


def test_code_in_flash_may_not_hide_the_flash():
    assert "run it from RAM" in fault_of("store 0x400E0A04, 0x5A00000E\n wait_forever")


def test_flash_commands_have_a_key_and_none_of_them_changes_the_flash(board):
    assert "without its key" in reason(board.flash_controllers[0].write, "FCR", 0x0000000E)
    assert "not modelled" in reason(board.flash_controllers[0].write, "FCR", 0x5A000003)


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


def test_a_busy_program_that_never_feeds_is_bitten_even_with_the_reset_value(board):
    board.machine.advance_to(15 * PS_PER_S)
    assert not board.events
    board.machine.advance_to(17 * PS_PER_S)
    assert len(board.events) == 1


def test_feeding_keeps_the_watchdog_quiet_and_needs_its_key(board):
    board.watchdog.write("MR", 256 | 1 << 13 | 0xFFF << 16)  # 1 s
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


def test_a_watchdog_without_time_ends_the_run(board):
    assert "WDV = 0" in reason(board.watchdog.write, "MR", 1 << 13)


def test_a_watchdog_that_is_off_needs_no_time(board):
    board.watchdog.write("MR", 1 << 15)
    board.machine.advance_to(20 * PS_PER_S)
    assert not board.events


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
    trng = next(p for p in board.peripherals if p.name == "TRNG")
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


def test_systick_keeps_its_count_over_a_change_of_the_clock(board):
    tick = board.system_control.systick
    tick.write_load(0xFF_FFFF)
    tick.write_value(0)
    tick.write_control(5)
    board.machine.advance(MS)
    board.machine.set_mck(8_000_000)
    board.machine.advance(MS)
    assert tick.read_value() == 0x100_0000 - 4000 - 8000


def test_systick_can_run_at_an_eighth(board):
    tick = board.system_control.systick
    tick.write_load(0xFF_FFFF)
    tick.write_value(0)
    tick.write_control(1)
    board.machine.advance(MS)
    assert tick.read_value() == 0x100_0000 - 500
