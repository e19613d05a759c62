"""Tests of the profile that assigns the instructions of a run to functions and phases."""

import pytest

from tests.rig.machine_support import FOLDER, Bench, linked_program
from tools.due_emulator.function_profile import Profile, functions_of

CALLS = (FOLDER / "calls.S").read_text(encoding="utf-8")
LEAF = 2 + 1000 * 5 + 1
"""Number of instructions of the function `leaf`, which includes those that a condition disables, since they
take a cycle, too.
"""


@pytest.fixture(scope="module")
def linked(tmp_path_factory):
    return linked_program(tmp_path_factory.mktemp("calls"), CALLS, {15: "count"})


@pytest.fixture
def bench(linked):
    elf, image = linked
    bench = Bench(image)
    bench.functions = functions_of(elf)
    return bench


def profiled(bench, seconds, phases=()):
    with Profile(bench.board.cpu, bench.functions, phases) as profile:
        bench.run(seconds)
    return profile


def test_instructions_are_counted_for_the_function_that_they_stand_in(bench):
    found = profiled(bench, 0.05).by_function
    ticks = bench.slot(0)
    assert ticks == 7, "30,000 instructions are 7.5 ms"
    assert found["__aeabi_leaf"] == 6 * LEAF, "of two names, the one by which compiled code calls it"
    assert found["inner"] == 3 * 3
    assert found["outer"] == 3 * 4
    assert found["begin"] == 3 * 3 + 2 + 3 + 1
    assert found["count"] == 5 * ticks
    assert found.total() == bench.board.cpu.instructions


def test_a_phase_has_all_that_it_calls_but_other_phases_and_interrupts(bench):
    found = profiled(bench, 0.05, ("outer", "inner"))
    assert bench.slot(0) > 0
    assert found.by_phase == {"outer": 3 * (4 + LEAF), "inner": 3 * (3 + LEAF)}
    assert found.calls == {"outer": 3, "inner": 3}


def test_a_phase_that_goes_back_to_its_beginning_was_called_once(bench):
    found = profiled(bench, 0.05, ("loop",))
    assert (found.by_phase, found.calls) == ({"loop": 9 * 2 + 1}, {"loop": 1})


def test_only_what_runs_between_the_two_moments_is_counted(bench):
    # Only the second of six calls of `leaf` is counted. Each call takes 1.25 ms.
    bench.run(0.0015)
    before = bench.board.cpu.instructions
    found = profiled(bench, 0.0022)
    there = found.by_function.total()
    assert there == bench.board.cpu.instructions - before
    assert found.by_function == {"__aeabi_leaf": there - 5, "count": 5}
    bench.run(0.05)
    assert found.by_function.total() == there


def test_a_reset_does_not_end_a_profile(bench):
    with Profile(bench.board.cpu, bench.functions, ("outer",)) as profile:
        bench.run(0.05)
        once = profile.calls["outer"]
        bench.board.reopen_port()
        bench.run(0.5)
    assert (once, profile.calls["outer"]) == (3, 6)


def test_a_profile_changes_nothing_of_what_the_program_does(linked):
    _, image = linked
    watched, alone = Bench(image), Bench(image).run(0.05)
    with Profile(watched.board.cpu, {}):
        watched.run(0.05)
    assert watched.board.cpu.instructions == alone.board.cpu.instructions
    assert watched.board.machine.idle_ps == alone.board.machine.idle_ps


def test_a_phase_that_the_program_does_not_have_is_refused(bench):
    with pytest.raises(ValueError, match="inlined_one"):
        Profile(bench.board.cpu, bench.functions, ("outer", "inlined_one"))
