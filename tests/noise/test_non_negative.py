"""Non-negative least squares compared with scipy's, which only the tests need."""

import numpy as np
import pytest
from fltea.noise.non_negative import non_negative
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import nnls


@given(st.integers(0, 10**6), st.integers(1, 12), st.integers(0, 30), st.floats(-6, 6))
def test_it_is_scipys(seed: int, columns: int, more: int, spread: float) -> None:
    rng = np.random.default_rng(seed)
    M = (rng.normal(size=(columns + more, columns)) + 1) * 10 ** (spread * rng.random(columns))
    d = rng.normal(size=len(M)) + 1
    found = non_negative(M, d)
    assert found.min() >= 0
    off = [float(np.linalg.norm(M @ x - d)) for x in (found, nnls(M, d)[0])]
    assert off[0] == pytest.approx(off[1], rel=1e-6, abs=1e-9)


def test_columns_that_are_alike_or_zero_end_it() -> None:
    M = np.array([[1.0, 1.0, 0.0], [2.0, 2.0, 0.0]])
    np.testing.assert_allclose(M @ non_negative(M, np.array([3.0, 6.0])), [3.0, 6.0])
    assert non_negative(M, np.array([-1.0, -1.0])).tolist() == [0.0, 0.0, 0.0]
    assert non_negative(M, np.zeros(2)).tolist() == [0.0, 0.0, 0.0]
    assert non_negative(np.zeros((2, 0)), np.ones(2)).shape == (0,)
