"""The tail of F as a normal deviate."""

import math
from statistics import NormalDist

import numpy as np
import pytest
from fltea.spectrum.f_tail import f_deviate
from fltea.spectrum.lines import f_log_tail
from hypothesis import given
from hypothesis import strategies as st


@given(st.integers(1, 500), st.integers(5, 5000), st.floats(0.5, 20))
def test_of_whole_ordinates(m: int, k: int, ratio: float) -> None:
    exact = f_log_tail(m, k, ratio)
    if -22 < exact < -0.01:
        deviate = -NormalDist().inv_cdf(math.exp(exact))
        assert float(f_deviate(ratio, 2 * m, 2 * k)) == pytest.approx(deviate, abs=0.02)


def test_of_degrees_that_are_not_whole() -> None:
    """Between those of its neighbours, and rising with the ratio."""
    degrees = np.linspace(2, 6, 41)
    found = f_deviate(3.0, degrees, 100.0)
    assert (np.diff(found) > 0).all()
    assert (np.diff(f_deviate(np.linspace(0.01, 10, 99), 7.3, 41.7)) > 0).all()
