import numpy as np
import pytest
from fltea.noise.memory import NewestFirst
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


def test_arrays_are_copied_and_contiguous() -> None:
    memory = NewestFirst(3, (2, 2))
    P = np.empty((2, 2))
    for k in range(8):
        P[:] = k
        memory.push(P)
    assert memory.values[:, 0, 0].tolist() == [7, 6, 5]
    assert memory.values.flags.c_contiguous
    assert (len(memory), memory.window) == (3, 3)


@pytest.mark.parametrize("window", [0, -1])
def test_a_window_has_at_least_one_sample(window: int) -> None:
    with pytest.raises(ValueError, match="window must be at least 1 sample"):
        NewestFirst(window)
