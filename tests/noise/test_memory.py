import numpy as np
import pytest
from fltea.noise.memory import DirectMemory, NewestFirst
from hypothesis import given, settings
from hypothesis import strategies as st


@settings(derandomize=True, deadline=None, max_examples=50)
@given(window=st.integers(1, 9), pushes=st.integers(0, 50))
def test_holds_the_newest_first(window: int, pushes: int) -> None:
    memory = NewestFirst(window)
    for value in range(pushes):
        memory.push(float(value))
        expected = list(range(value, max(-1, value - window), -1))
        assert memory.values.tolist() == expected
        assert len(memory) == len(expected)


def test_states_and_covariances_stay_together_and_contiguous() -> None:
    memory = DirectMemory(3, N=2)
    for k in range(8):
        memory.push(np.array([k, -k], dtype=float), np.full((2, 2), float(k)))
    assert memory.states.tolist() == [[7, -7], [6, -6], [5, -5]]
    assert memory.covariances[:, 0, 0].tolist() == [7, 6, 5]
    assert memory.states.flags.c_contiguous
    assert memory.covariances.flags.c_contiguous
    assert (len(memory), memory.window) == (3, 3)


def test_push_copies() -> None:
    memory = DirectMemory(3)
    x, P = np.ones(1), np.ones((1, 1))
    memory.push(x, P)
    x[0] = P[0, 0] = 5
    assert memory.states[0, 0] == memory.covariances[0, 0, 0] == 1


@pytest.mark.parametrize("window", [0, -1])
def test_a_window_has_at_least_one_sample(window: int) -> None:
    with pytest.raises(ValueError, match="window must be at least 1 sample"):
        DirectMemory(window)


def test_wrong_shapes() -> None:
    with pytest.raises(ValueError, match="at least one state"):
        DirectMemory(3, N=0)
    with pytest.raises(ValueError, match=r"expected x \(2,\) and P \(2, 2\)"):
        DirectMemory(3, N=2).push(np.ones(2), np.ones(2))
