"""Tests of the emulated processor: time, memory, instruction counts, and the errors that end a run."""

from itertools import pairwise

import pytest
from fltea.records.errors import UsageError

from tests.rig.machine_support import COUNT, TICK_EACH_MS, Bench, program, run
from tools.due_emulator import execution
from tools.due_emulator.__main__ import IMAGE
from tools.due_emulator.memory_map import RAM_BASE


def test_instructions_take_a_cycle_each_and_sleep_takes_until_the_next_event():
    bench = run(f"movs r1, #0\n keep r1, 0\n{TICK_EACH_MS} wait_forever\n{COUNT}", 0.1005, {15: "count"})
    assert bench.slot(0) == 100
    assert bench.board.cpu.instructions < 2000
    assert bench.board.machine.idle_ps > 0.99 * bench.board.machine.now_ps - 1_000_000_000


FORBIDDEN = [
    ("udf #0", "undefined instruction"),
    ("svc #0", "SVC instruction"),
    ("bkpt #0", "BKPT instruction"),
    ("load r1, 0x30000000", "read of an address where nothing is: 0x30000000"),
    ("store 0x30000000, 1", "write to an address where nothing is: 0x30000000"),
    ("store 0x000C0000, 1", "write to flash: 0x000C0000"),
    ("ldr r0, =0x60000001\n bx r0", "jump to an address where nothing is: 0x60000000"),
    ("movs r0, #1\n bx r0", "null pointer"),
    ("load r1, 0x00100000", "read of an address where nothing is: 0x00100000"),
    ("load r1, 0x400FF000", "read of an address where nothing is"),
    ("load r1, 0x40001000", "no peripheral there"),
    ("load r1, 0x400E0690", "unknown register of PMC: offset 0x90"),
    ("load r1, 0xE000ED94", "not modelled in the processor"),
    ("load r1, 0xE0001004", "read of an address where nothing is"),
    ("load r1, 0x400E0610", "read of the write-only register PMC_PCER0"),
    ("store 0x400E0618, 1", "write of the read-only register PMC_PCSR0"),
    ("ldr r0, =0x400E0618\n ldrb r1, [r0]", "1 byte(s) of PMC_PCSR0"),
    ("ldr r0, =0x400E0E00\n movs r1, #0\n strb r1, [r0]", "write of 1 byte(s) of PIOA_PER"),
    ("ldr r0, =0x400E0E00\n movs r1, #0\n strh r1, [r0]", "write of 2 byte(s) of PIOA_PER"),
    ("ldr r0, =0x40000001\n bx r0", "jump to an address where there must be no code"),
    ("load r1, 0x400E0814", "read of UART_SR without its clock: bit 8 of PMC_PCER0"),
    ("store 0xE000ED08, 0x00080004", "aligned to 256"),
    ("store 0xE000ED14, 0x208", "CCR 0x208: not modelled"),
    ("ldr r0, =0xE0000001\n bx r0", "jump to"),
    ("store 0xE000ED10, 4", "deep sleep"),
    ("ldr r0, =0x20070010\n msr msp, r0\n store 0xE000ED04, 0x04000000\n nop", "no room on the stack"),
    ("store 0xE000ED04, 0x04000000\n nop", "exception 15 has no handler"),
    ("movs r0, #2\n msr control, r0\n store 0xE000ED04, 0x04000000\n nop", "process stack"),
]
"""Pairs of a program's code and the reason with which its run ends."""


def test_an_empty_flash_is_said_to_be_one():
    bench = Bench(b"\0" * 8)
    assert "no image in flash" in bench.fault()


def test_ram_begins_as_rubbish_that_the_seed_decides():
    image = program("wait_forever")
    contents = [Bench(image, seed=seed).board.memory.read(RAM_BASE, 4096) for seed in (1, 1, 2)]
    assert contents[0] == contents[1] != contents[2]
    assert len(set(contents[0])) == 256


def test_sram0_is_seen_at_both_of_its_addresses():
    bench = run("store 0x20000010, 0x11223344\n load r1, 0x20070010\n keep r1, 0\n wait_forever")
    assert bench.slot(0) == 0x11223344


def test_ram_that_the_program_wrote_is_counted():
    bench = run(
        """ldr r2, =0x20071000
  ldr r3, =0x20071800
  movs r1, #0
1: stmia r2!, {r1}
  cmp r2, r3
  bne 1b
  wait_forever"""
    )
    assert bench.board.memory.ram_touched_bytes() == 0x800


def test_polling_a_timer_goes_on_in_time():
    # This program waits for SysTick's COUNTFLAG without using an interrupt.
    bench = run(
        """systick 3999, 5
  movs r4, #0
1: wait 0xE000E010, 0x10000
  adds r4, #1
  keep r4, 0
  b 1b""",
        0.0505,
    )
    assert bench.slot(0) == 50
    assert bench.board.cpu.instructions < 100_000, "waiting is not played out turn by turn"


def test_a_loop_that_counts_its_turns_takes_the_time_of_its_instructions():
    # A loop with 20,000 iterations that waits for a flag that is never set, as Arduino's library Wire does.
    waiting = """ldr r2, =0xE000E010
  ldr r3, =20000
1: ldr r1, [r2]
  lsls r1, r1, #15
  bmi 2f
  subs r3, #1
  bne 1b
2: movs r4, #1
  keep r4, 0
  wait_forever"""
    bench = run(waiting, 0.06)
    assert bench.slot(0) == 1, "20,000 turns of 9 cycles are 45 ms at 4 MHz, not 200 ms"
    early = run(waiting, 0.03)
    assert early.slot(0) != 1


def test_a_signal_ends_a_run_though_the_exception_was_lost():
    bench = Bench(program("1: nop\n b 1b"))
    bench.board.machine.schedule(10_000_000, lambda: setattr(bench.board.machine, "interrupted", True))
    with pytest.raises(KeyboardInterrupt):
        bench.board.run_until(0.01)
    assert bench.board.now_s < 0.001


SKIPPING = """subs r2, r2, r2
  itet ne
  movne r3, #1
  moveq.w r3, #2
  addne.w r3, r3, r4
  it ne
  movne r3, #4
"""
"""Seven instructions of 16 and 32 bits, without a branch. Conditions disable three of them."""


def test_an_instruction_that_its_condition_switches_off_takes_its_cycle():
    bench = run(
        f"""systick 0xFFFFFF, 5
  ldr r0, =0xE000E018
  ldr r1, [r0]
  {SKIPPING}
  ldr r2, [r0]
  subs r1, r2
  keep r1, 0
  {SKIPPING}
  wait_forever"""
    )
    assert bench.slot(0) == 7 + 5
    assert bench.board.cpu.instructions == 9 + 2 + 7 + 1 + 1 + 2 + 7 + 1


@pytest.mark.parametrize("every", [37, 38, 41])
def test_no_instruction_is_lost_or_counted_twice_where_interrupts_come(every):
    bench = run(
        f"""movs r1, #0
  keep r1, 0
  store 0xE000E014, {every - 1}
  store 0xE000E018, 0
  ldr r6, =2000
  store 0xE000E010, 7
1: {SKIPPING}
  subs r6, #1
  bne 1b
  store 0xE000E010, 0
  wait_forever
{COUNT}""",
        0.1,
        {15: "count"},
    )
    assert bench.slot(0) > 100
    assert bench.board.cpu.instructions == 3 + 6 + 1 + 3 + 2000 * 9 + 3 + 1 + 5 * bench.slot(0)


def test_a_waiting_interrupt_comes_soon_after_its_priority_lets_it():
    # Interrupt 31, which the program makes pending, has priority 0x80, and BASEPRI holds it back.
    bench = run(
        """movs r4, #0
  movs r5, #0x40
  msr basepri, r5
  store 0xE000E41C, 0x80000000
  store 0xE000E100, 0x80000000
  trigger 31
  ldr r2, =300
1: subs r2, #1
  bne 1b
  movs r5, #0
  msr basepri, r5
2: adds r4, #1
  b 2b
handler:
  keep r4, 0
3: wfi
  b 3b""",
        handlers={16 + 31: "handler"},
    )
    assert 0 < bench.slot(0) <= 100


def test_code_runs_at_the_new_clock_as_soon_as_it_changes():
    def busy_ps(turns):
        machine = run(
            f"full_speed\n ldr r6, ={turns}\n1: subs r6, #1\n bne 1b\n wait_forever", 0.05
        ).board.machine
        return machine.now_ps - machine.idle_ps

    # 840,000 more iterations of two instructions, at 84 MHz, take 20 ms.
    assert busy_ps(840_001) - busy_ps(1) == pytest.approx(20_000_000_000, abs=20_000)
    assert busy_ps(1) < 4_000_000_000, "the sources' start-up, and no more"


def test_a_program_without_events_is_left_often_enough_to_hear_a_signal():
    bench = Bench(program("1: nop\n b 1b"))
    looks = []
    bench.board.machine.check_interrupted = lambda: looks.append(bench.board.cpu.instructions)  # type: ignore[method-assign]
    bench.run(0.25)
    steps = [after - before for before, after in pairwise(looks)]
    assert 0 < max(steps) <= 50_000


@pytest.mark.parametrize(
    ("command", "reason"), [("no-such-compiler", "Debian: g\\+\\+"), ("false", "cannot be compiled")]
)
def test_without_a_compiler_it_says_what_is_missing(command, reason, tmp_path, monkeypatch):
    monkeypatch.setattr(execution, "FOLDER", tmp_path)
    monkeypatch.setattr(execution, "COMMAND", (command,))
    with pytest.raises(UsageError, match=reason):
        execution._library.__wrapped__()


COMPUTE = " ldr r6, =300\n1: subs r6, #1\n bne 1b\n"
"""A loop that accesses no peripheral for so long that the emulator changes to its fast processor."""


@pytest.mark.parametrize(("text", "reason"), FORBIDDEN)
@pytest.mark.parametrize("before", ["", f"{COMPUTE}adds r4, #1\n "], ids=["at once", "by the second"])
def test_what_neither_processor_forgives_ends_the_run(before, text, reason):
    first, alone = (Bench(program(f"{before}{text}\n wait_forever")) for _ in range(2))
    alone.board.cpu.watch(lambda *_: None)
    message = first.fault(0.1)
    assert reason in message
    assert "at PC 0x0008" in message or "jump" in message
    assert message == alone.fault(0.1), "the same instruction at the same moment"


@pytest.mark.parametrize("seed", [1, 2])
def test_the_firmware_does_the_same_without_the_second_processor_and_the_quick_reads(seed):
    image = IMAGE.read_bytes()
    quick, plain = (Bench(image, seed=seed) for _ in range(2))
    plain.board.cpu.watch(lambda *_: None)
    plain.board.cpu._execution.may_be_quick = 0
    for bench in (quick, plain):
        bench.run(0.7)
    assert len(quick.received) > 200
    assert quick.received == plain.received
    assert quick.board.memory.ram[:] == plain.board.memory.ram[:]
    assert quick.board.cpu.instructions == plain.board.cpu.instructions
    assert quick.board.machine.idle_ps == plain.board.machine.idle_ps
