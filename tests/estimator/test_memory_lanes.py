"""The native memories by lanes and instruction sets, and their state: cleared, restored, reset."""

import numpy as np
import pytest
from memory_probe import DIRECT, SETS, Memory, fused
from test_memory_native import history  # type: ignore[import-not-found]  # beside this file

# The first test of each instruction set compiles its probe.
pytestmark = pytest.mark.timeout(300)


@pytest.mark.parametrize("instruction_set", SETS)
@pytest.mark.parametrize(("digits", "window"), [(DIRECT, 100), (6, 100), (6, 0)])
def test_a_lane_is_what_it_would_be_alone(instruction_set: str, digits: int, window: int) -> None:
    together = Memory(digits, window, "w", instruction_set)
    lanes = together.lanes
    random = np.random.default_rng(4)
    x, P = random.standard_normal((350, lanes)), random.uniform(0.5, 2, (350, lanes))
    orders = random.uniform(-0.9, 3, (3, lanes))
    together.push(x, P)
    S, V = together.evaluate(orders)
    both = together.sums(orders[1])
    for lane in range(lanes):
        alone = Memory(digits, window, "d", instruction_set)
        alone.push(x[:, lane], P[:, lane])
        S_alone, V_alone = alone.evaluate(orders[:, lane])
        assert (S[:, lane] == S_alone[:, 0]).all()
        assert V[lane] == V_alone[0]
        assert (both[0][lane], both[1][lane]) == tuple(a[0] for a in alone.sums(orders[1, lane]))


@pytest.mark.parametrize(("digits", "window"), [(DIRECT, 100), (6, 100), (6, 0)])
def test_instruction_sets_differ_by_rounding(digits: int, window: int) -> None:
    results = []
    for instruction_set in SETS:
        memory = Memory(digits, window, "w", instruction_set)
        memory.push(*history(400))
        S, V = memory.evaluate([0.4, -0.6, 1.3])
        results.append([*S[:, 0], V[0]])
        np.testing.assert_array_equal(S, np.repeat(S[:, :1], memory.lanes, 1))
    np.testing.assert_allclose(results, [results[0]] * len(SETS), rtol=1e-12)
    if all(fused(name) for name in SETS[:2]) and len(SETS) > 1:
        assert results[0] == results[1]


@pytest.mark.parametrize(("digits", "window"), [(DIRECT, 30), (6, 30), (6, 0), (6, 7)])
def test_cleared_lanes_are_new_and_the_others_untouched(digits: int, window: int) -> None:
    memory, untouched, new = (Memory(digits, window, "w") for _ in range(3))
    mask = np.arange(memory.lanes) % 2 == 0
    for each in (memory, untouched):
        each.push(*history(100))
    memory.clear(mask)
    for each in (memory, untouched, new):
        each.push(*history(20, seed=9))
    (S, V), (kept_S, kept_V) = memory.evaluate([0.4, -0.6, 1.3]), untouched.evaluate([0.4, -0.6, 1.3])
    new_S, new_V = new.evaluate([0.4, -0.6, 1.3])
    assert (S[:, ~mask] == kept_S[:, ~mask]).all()
    assert (V[~mask] == kept_V[~mask]).all()
    np.testing.assert_allclose(S[:, mask], new_S[:, mask], rtol=0, atol=1e-15)
    np.testing.assert_allclose(V[mask], new_V[mask], rtol=1e-15)


@pytest.mark.parametrize(("digits", "window"), [(DIRECT, 30), (6, 30), (6, 0), (6, 7), (6, 15)])
@pytest.mark.parametrize("n", [0, 1, 15, 29, 100])
def test_a_restored_memory_continues_bit_for_bit(digits: int, window: int, n: int) -> None:
    first, second = Memory(digits, window, "w"), Memory(digits, window, "w")
    first.push(*history(n))
    second.push(*history(37, seed=5))
    second.restore(first.save())
    for seed in range(3):
        for each in (first, second):
            each.push(*history(23, seed))
        for mine, other in zip(
            first.evaluate([0.4, -0.6, 1.3]), second.evaluate([0.4, -0.6, 1.3]), strict=True
        ):
            assert (mine == other).all()


def test_reset_forgets() -> None:
    for digits, window in ((DIRECT, 30), (6, 30), (6, 0)):
        used, new = Memory(digits, window), Memory(digits, window)
        used.push(*history(100))
        used.reset()
        for each in (used, new):
            each.push(*history(44, seed=3))
        assert used.sums(0.3) == new.sums(0.3)
