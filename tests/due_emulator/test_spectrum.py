"""Tests of the board's running spectrum and fit on the emulated Due.

The results have to be equal to those on a PC in every bit, and the computing time is limited.
"""

import pytest

from tests.rig.tiers import long_but
from tests.rig.toolchain import arm_compiler
from tools.bench.spectrum_cost import NOISES, on_due, on_pc

SAMPLES = 9000


@pytest.fixture(scope="module")
def due():
    arm_compiler()
    return on_due(SAMPLES)


@pytest.mark.slow
def test_the_board_has_the_bits_of_a_pc(due):
    pc = on_pc(SAMPLES)
    assert due.hash == pc.hash
    assert (due.alpha, due.alpha_std, due.bins) == (pc.alpha, pc.alpha_std, pc.bins)


@pytest.mark.parametrize("noise", long_but(["kFast"], NOISES[1:]))
def test_the_board_has_the_bits_of_a_pc_of_any_noise(due, noise):
    board, pc = on_due(4000, noise), on_pc(4000, noise)
    assert board._replace(phases={}) == pc._replace(phases={}, bytes=board.bytes)
    assert (board.alpha_std > 0) == (noise == "kFast")


def test_costs_are_those_of_the_readme_or_less(due):
    of_samples = due.phases["sample"].instructions + due.phases["level"].instructions
    assert of_samples / SAMPLES < 1100
    assert due.phases["bins"].instructions < 1_200_000
    assert due.phases["next fit"].instructions < 2_500_000
    assert due.evaluations[1] <= 6
    assert due.phases["first fit"].instructions < 70_000_000
    assert max(phase.longest for phase in due.phases.values()) < 75_000
    assert due.bytes[0] <= 11_800
