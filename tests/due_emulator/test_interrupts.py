"""Exceptions, interrupts and sleep."""

from machine_support import COUNT, TICK_EACH_MS, fault_of, run


def test_a_nested_interrupt_comes_through_and_returns_with_all_registers():
    # Software interrupts 30 (priority 0x80) and 31 (0x40): 31 interrupts the handler of 30.
    bench = run(
        """store 0xE000E41C, 0x40800000
  store 0xE000E100, 0xC0000000
  ldr r0, =0xE000EF00
  movs r1, #30
  ldr r2, =0x12345678
  ldr r3, =0x9ABCDEF0
  mov r12, r2
  str r1, [r0]
  keep r2, 0
  keep r3, 1
  mov r2, r12
  keep r2, 2
  wait_forever
low:
  push {r4, lr}
  trigger 31
  movs r3, #1
  load r2, 0x2007000C
  keep r2, 4
  pop {r4, pc}
high:
  movs r2, #77
  keep r2, 3
  movs r3, #2
  mov r12, r3
  bx lr""",
        handlers={16 + 30: "low", 16 + 31: "high"},
    )
    assert [bench.slot(n) for n in range(5)] == [0x12345678, 0x9ABCDEF0, 0x12345678, 77, 77]


def test_the_stack_is_aligned_for_a_handler_and_comes_back_as_it_was():
    bench = run(
        """store 0xE000E100, 0x80000000
  push {r1}
  mov r4, sp
  keep r4, 0
  trigger 31
  nop
  mov r4, sp
  keep r4, 1
  wait_forever
handler:
  mov r2, sp
  keep r2, 2
  bx lr""",
        handlers={16 + 31: "handler"},
    )
    before, after, inside = (bench.slot(n) for n in range(3))
    assert before == after == 0x20087FFC
    assert inside == before - 4 - 32


def test_a_masked_interrupt_waits_and_a_window_of_two_instructions_lets_it_in():
    bench = run(
        """movs r2, #0
  keep r2, 0
  cpsid i
  store 0xE000E100, 0x80000000
  trigger 31
  .rept 300
  nop
  .endr
  load r3, 0x20070000
  keep r3, 1
1: cpsie i
  cpsid i
  load r3, 0x20070000
  cmp r3, #0
  beq 1b
  keep r3, 2
  wait_forever
handler:
  movs r2, #9
  keep r2, 0
  bx lr""",
        handlers={16 + 31: "handler"},
    )
    assert (bench.slot(1), bench.slot(2)) == (0, 9)


def test_wfi_wakes_on_a_masked_interrupt_which_is_then_taken():
    bench = run(
        f"""movs r2, #0
  keep r2, 0
  keep r2, 1
  {TICK_EACH_MS}
3: cpsid i
  wfi
  load r3, 0x20070000
  cpsie i
  nop
  load r4, 0x20070000
  subs r4, r3
  load r5, 0x20070004
  add r5, r4
  keep r5, 1
  b 3b
{COUNT}""",
        0.0105,
        {15: "count"},
    )
    assert (bench.slot(0), bench.slot(1)) == (10, 10)


def test_side_effects_happen_once_though_unicorn_repeats_a_stopped_access():
    # Writing STIR stops the slice in the middle of the access; the handler must run once a write.
    bench = run(
        """movs r2, #0
  keep r2, 0
  store 0xE000E100, 0x80000000
  ldr r4, =0xE000EF00
  movs r5, #31
  movs r6, #100
1: str r5, [r4]
  nop
  subs r6, #1
  bne 1b
  wait_forever
"""
        + COUNT,
        handlers={16 + 31: "count"},
    )
    assert bench.slot(0) == 100


def test_ipsr_and_the_registers_of_the_nvic_say_what_is_going_on():
    bench = run(
        """store 0xE000E100, 0x80000000
  load r1, 0xE000E100
  keep r1, 0
  trigger 31
  nop
  load r1, 0xE000E300
  keep r1, 3
  store 0xE000E180, 0x80000000
  store 0xE000E200, 0x80000000
  load r1, 0xE000E200
  keep r1, 4
  store 0xE000E280, 0x80000000
  load r1, 0xE000E200
  keep r1, 5
  wait_forever
handler:
  mrs r1, ipsr
  keep r1, 1
  load r1, 0xE000E300
  keep r1, 2
  bx lr""",
        handlers={16 + 31: "handler"},
    )
    bit = 1 << 31
    assert [bench.slot(n) for n in range(6)] == [bit, 47, bit, 0, bit, 0]


def test_a_handler_that_spoils_its_stack_is_found():
    reason = fault_of(
        "store 0xE000ED04, 0x04000000\n nop\n wait_forever\nbad: movs r1, #0x55\n str r1, [sp, #28]\n bx lr",
        handlers={15: "bad"},
    )
    assert "overwritten" in reason


def test_returning_to_an_exception_that_is_not_running_is_found():
    assert "is not possible here" in fault_of(
        "store 0xE000ED04, 0x04000000\n nop\n wait_forever\nbad: ldr r0, =0xFFFFFFF1\n bx r0",
        handlers={15: "bad"},
    )


def test_wfe_sleeps_unless_an_interrupt_came_since_the_last_one():
    bench = run(
        f"""movs r2, #0
  keep r2, 0
  {TICK_EACH_MS}
  ldr r2, =20000
1: subs r2, #1
  bne 1b
  load r3, 0x20070000
  keep r3, 1
  wfe
  load r3, 0x20070000
  keep r3, 2
  wfe
  load r3, 0x20070000
  keep r3, 3
  wait_forever
{COUNT}""",
        0.05,
        {15: "count"},
    )
    assert [bench.slot(n) for n in (1, 2)] == [10, 10], "the event register was set: no sleep"
    assert bench.slot(3) == 11
