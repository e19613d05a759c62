"""Tests of instructions that a Cortex-M3 refuses and the emulation library Unicorn executes. The emulator
executes a program with two processors, an exact and a fast one. On both of them, such an instruction ends the
run.
"""

import pytest

from tests.rig.machine_support import Bench, fault_of, program, run

COMPUTE = " ldr r7, =300\n1: subs r7, #1\n bne 1b\n"
"""A loop of 600 instructions that does not use a peripheral. After 100 such instructions, the emulator
changes from its exact to its fast processor (`tools/due_emulator/README.md`).
"""
ODD = "ldr r0, =0x20080001\n ldr r4, =0x20080001\n"
WORDS, HALFWORD = "holds 0x20080001, no multiple of 4", "holds 0x20080001, which is odd"

SEVERAL_WORDS = """ldmia r0!, {r1, r2}|ldmia.w r0, {r1, r2}|ldmdb r0, {r1, r2}|stmia r0!, {r1, r2}
stmdb r0!, {r1, r2}|ldrd r1, r2, [r0, #8]|ldrd r1, r2, [r0], #-8|strd r1, r2, [r0, #-8]!|ldrex r1, [r0, #4]
strex r3, r1, [r0]|mov sp, r0; push {r1}|mov sp, r0; pop {r1, r2}|mov sp, r0; ldrd r1, r2, [sp, #8]
msr msp, r0; isb; push {r1, lr}"""
"""Instructions that access several words, at the odd address in r0."""
HALFWORDS = "ldrexh r1, [r0]|strexh r3, r1, [r0]"

WAYS = """mov r5, r4|movs r5, r4|mov.w r5, r4|add r5, r4, #8|sub.w r5, r4, #0x1000|addw r5, r4, #4
ldr r5, =0x20080001|ldr.w r5, =0x20080001|push {r4}; pop {r5}
movs r6, #1; add.w r5, r4, r6, lsl #2|movs r6, #4; adds r5, r6, r4|movs r6, #2; add.w r5, r4, r6, lsl #1
mov r5, r4; ldr r6, [r5], #4|mov r5, r4; ldr r6, [r5, #-8]!
movw r5, #1; movt r5, #0x2008|movs r5, #0x20; lsls r5, r5, #24; add.w r5, r5, #0x80000; adds r5, #1
ldr r5, =0x20080000; cmp r5, r5; it eq; moveq r5, r4
ldr r5, =0x20080000; ldrd r6, r5, [r5]; mov r5, r4|ldr r5, =0x2007FFFE; adds r5, #3"""
"""Pieces of code that put an odd address into r5. They copy it from r4, load it from memory, add an index,
write back an address, compute it, or move it under a condition. Those in the last line first put an even
address into r5.
"""

OTHER_PROCESSORS = """qadd r0,r1,r2|sel r0,r1,r2|pkhbt r0,r1,r2|sxtb16 r0,r1|sxtab16 r0,r1,r2|sxtab r0,r1,r2
uxtah r0,r1,r2|ssat16 r0,#3,r1|usat16 r0,#3,r1|usada8 r0,r1,r2,r3|smlabb r0,r1,r2,r3|smulwt r0,r1,r2
smladx r0,r1,r2,r3|smusd r0,r1,r2|smmlar r0,r1,r2,r3|smlaltt r0,r1,r2,r3|smlald r0,r1,r2,r3
smlsld r0,r1,r2,r3|umaal r0,r1,r2,r3|uadd8 r0,r1,r2|shasx r0,r1,r2
.inst.w 0xe8d0127f|.inst.w 0xe8d01faf|.inst.w 0xe840f100|.inst.n 0xb658"""
"""Instructions of other processors: most are of a Cortex-M4, the last are LDREXD, LDA, TT and SETEND."""


def _each(table):
    return [one.replace("; ", "\n ") for line in table.splitlines() for one in line.split("|")]


def _same_on_both(text, seconds=0.01):
    """Return the message with which the emulator ends the program.

    The emulator usually changes between its exact and its fast processor. Check that the message is the same
    if the exact processor executes the whole program.
    """
    first, alone = (Bench(program(f"{text}\n wait_forever")) for _ in range(2))
    alone.board.cpu.watch(lambda *_: None)
    message = first.fault(seconds)
    assert message == alone.fault(seconds)
    return message


@pytest.mark.parametrize("instruction", _each(SEVERAL_WORDS))
def test_several_words_at_an_address_that_is_no_multiple_of_4_end_the_run(instruction):
    """Access to several words at an address that is not aligned is always a UsageFault, whatever the register
    CCR says (ARMv7-M Architecture Reference Manual, A3.2.1).
    """
    assert WORDS in _same_on_both(f"{ODD}{COMPUTE}{instruction}")


@pytest.mark.parametrize("instruction", _each(HALFWORDS))
def test_an_exclusive_halfword_at_an_odd_address_ends_the_run(instruction):
    assert HALFWORD in _same_on_both(f"{ODD}{COMPUTE}{instruction}")


@pytest.mark.parametrize("way", _each(WAYS))
def test_an_odd_address_is_found_in_whatever_way_it_came_about(way):
    """The emulator's fast processor checks registers at the start of a block of code.

    So changes of the registers within a block have to be tracked.
    """
    text = f"{ODD}{COMPUTE}nop\n {way}\n ldmia r5, {{r1, r2}}"
    assert "unaligned LDM" in _same_on_both(text)


def test_a_copy_of_words_that_are_aligned_runs_on_the_second_processor():
    """A program that only copies aligned words runs on the emulator's fast processor. On the exact processor,
    each run would take several times as long.
    """
    bench = run(
        f"""ldr r0, =0x20080000
  ldr r1, =0x20081000
  ldr r6, =1000
1: ldmia r0, {{r2, r3}}
  add.w r5, r1, r6, lsl #3
  stmia r5!, {{r2, r3}}
  strd r2, r3, [r5, #8]
  push {{r2, r3}}
  pop {{r2, r3}}
  subs r6, #1
  bne 1b
  {COMPUTE}
  wait_forever"""
    )
    blocks = bench.board.cpu._execution._block_table
    looped = [block for block in blocks if block.aligned]
    assert looped, "its base registers are looked at"
    assert not any(block.needs_exact for block in looped)


@pytest.mark.parametrize("instruction", _each(OTHER_PROCESSORS))
def test_an_instruction_of_another_processor_ends_the_run(instruction):
    text = f".cpu cortex-m4\n ldr r0, =0x20080000\n movs r1, #3\n{instruction}\n wait_forever"
    assert "undefined instruction" in fault_of(text, 0.01)


@pytest.mark.parametrize(
    "instruction", _each("vldr s0, [r0]|vldmia r0, {s0-s3}|vmov s0, r0|mcr p15, 0, r0, c7, c10, 5")
)
def test_an_instruction_of_a_unit_that_a_cortex_m3_has_not_ends_the_run(instruction):
    text = f".cpu cortex-m4\n.fpu fpv4-sp-d16\n ldr r0, =0x20080000\n{COMPUTE}{instruction}"
    assert "which the Cortex-M3 has not" in _same_on_both(text)


@pytest.mark.parametrize("division", ["udiv r2, r0, r1", "sdiv r2, r0, r1"])
def test_a_division_by_zero_ends_the_run_if_the_program_asked_for_that(division):
    assert "DIV_0_TRP" in _same_on_both(f"store 0xE000ED14, 0x210\n movs r1, #0\n{COMPUTE}{division}")
    again = (
        f"store 0xE000ED14, 0x210\n{COMPUTE} store 0xE000ED14, 0x200\n movs r1, #0\n{division}\n keep r2, 0"
    )
    assert run(f"{again}\n wait_forever").slot(0) == 0


@pytest.mark.parametrize("jump", ["bx r0", "blx r0", "push {r0}\n pop {pc}", "push {r0}\n ldr pc, [sp]"])
def test_a_jump_without_the_thumb_bit_is_said_to_be_one(jump):
    """The jump leaves the Thumb state, so the instruction after the jump is a UsageFault of the kind INVSTATE
    (ARMv7-M Architecture Reference Manual, B1.4.2).
    """
    reason = _same_on_both(f"{COMPUTE}adr r0, 1f\n{jump}\n nop\n.align 2\n1: nop")
    assert "jump to an address without bit 0" in reason


def test_faultmask_is_not_passed_over_in_silence():
    assert "FAULTMASK" in fault_of("cpsid f\n store 0xE000ED04, 0x04000000\n nop\n wait_forever\n")


def test_an_exception_that_returns_out_of_thumb_is_found():
    """The handler clears the T bit of the status register that the interrupt has saved on the stack.

    On a real board, the instruction after the return from the handler faults.
    """
    reason = fault_of(
        "store 0xE000ED04, 0x04000000\n nop\n wait_forever\nbad: ldr r1, [sp, #28]\n bic r1, #1 << 24\n"
        " str r1, [sp, #28]\n bx lr",
        handlers={15: "bad"},
    )
    assert "T bit" in reason
