"""Tests of exceptions, interrupts, sleep and their times. Small programs run on the emulator and store
results in RAM.
"""

import re
from pathlib import Path

import pytest

from tests.rig.machine_support import fault_of, run

PROGRAMS = sorted(Path(__file__).with_name("programs").glob("*.S"))


def numbered(text: str) -> dict[int, str]:
    """Return a text such as "1 a, 2 b" as a dictionary of its words, by the numbers before them."""
    return {int(number): word for number, word in (pair.split() for pair in text.split(", "))} if text else {}


@pytest.mark.parametrize("file", PROGRAMS, ids=lambda file: file.stem)
def test_a_program_finds_what_it_says(file: Path) -> None:
    """Each program file has comments with the expected results in RAM, the handlers and the running time."""
    text = file.read_text(encoding="utf-8")
    said = dict(re.findall(r"^// (seconds|handlers|slots): (.*)$", text, re.MULTILINE))
    expected = {number: int(value, 0) for number, value in numbered(said["slots"]).items()}
    bench = run(text, float(said.get("seconds", 0.01)), numbered(said.get("handlers", "")))
    assert {number: bench.slot(number) for number in expected} == expected


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
