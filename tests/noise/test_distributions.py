"""Tests of the tails and quantiles of distributions. They are compared with those of scipy, which only the
tests need.
"""

import math
from statistics import NormalDist

import numpy as np
import pytest
from fltea.noise.distributions import (
    MANY,
    chi2_quantile,
    chi2_tail,
    f_deviate,
    f_log_tail,
    student_quantile,
    student_tail,
)
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

DEGREES = st.floats(math.log(0.3), math.log(1e6)).map(math.exp)


@given(st.floats(1e-3, 10), DEGREES)
def test_the_tail_of_chi_squared(ratio: float, degrees: float) -> None:
    """The absolute error of the tail is small.

    In the far tail, the relative error is small as well, as far as the digits of lgamma permit.
    """
    expected = stats.chi2.sf(ratio * degrees, degrees)
    found = chi2_tail(ratio * degrees, degrees)
    assert found == pytest.approx(expected, rel=1e-12 * max(degrees, 1e3), abs=1e-13)
    if ratio > 1.5 and degrees < 1000:
        assert found == pytest.approx(expected, rel=1e-9, abs=1e-290)


def test_the_tail_of_chi_squared_at_its_ends() -> None:
    assert [chi2_tail(x, 3) for x in (-1, 0)] == [1, 1]
    assert [chi2_tail(x, 3) for x in (5e3, math.inf)] == [0, 0]
    assert chi2_tail(4.0, 2) == pytest.approx(math.exp(-2), rel=1e-14)


@pytest.mark.parametrize("probability", [0.005, 0.025, 0.05, 0.5, 0.95, 0.975, 0.995])
def test_quantiles_of_chi_squared(probability: float) -> None:
    degrees = np.concatenate([np.geomspace(0.5, MANY, 200), [MANY, 1.001 * MANY], np.geomspace(160, 1e8, 50)])
    expected = stats.chi2.ppf(probability, degrees)
    few = degrees < MANY
    found = chi2_quantile(probability, degrees)
    np.testing.assert_allclose(found[few], expected[few], rtol=1e-9)
    np.testing.assert_allclose(found[~few], expected[~few], rtol=2e-4)


@pytest.mark.parametrize(
    ("probability", "degrees"),
    [(0.0, 1.0), (1.0, 1.0), (0.5, 0.0), (0.5, -1.0), (0.5, np.nan), (0.5, np.inf)],
)
def test_what_has_no_quantile(probability: float, degrees: float) -> None:
    with pytest.raises(ValueError, match=r"must be positive|lies between"):
        chi2_quantile(probability, [degrees])


@given(st.floats(0, 50), DEGREES, DEGREES)
def test_the_tail_of_f(ratio: float, first: float, second: float) -> None:
    expected = stats.f.logsf(ratio, first, second)
    if expected > -600:  # below this, the tail computed by scipy underflows
        assert math.exp(f_log_tail(ratio, first, second)) == pytest.approx(math.exp(expected), abs=1e-8)
    if -600 < expected < -0.01 and max(first, second) < 1e4:
        assert f_log_tail(ratio, first, second) == pytest.approx(expected, rel=1e-8)


def test_the_tail_of_f_where_it_has_a_closed_form() -> None:
    """If the first number of degrees of freedom is two, the tail of F is (1 + 2 ratio / second)^(-second / 2)
    in closed form, even where it is tiny.
    """
    for ratio in (3.0, 1e9):
        assert f_log_tail(ratio, 2, 96) == pytest.approx(-48 * math.log1p(ratio / 48), rel=1e-12)
    assert f_log_tail(-1.0, 2, 96) == 0


@given(st.floats(0.01, 20), st.floats(2, 1000), st.floats(10, 10_000))
def test_f_as_a_normal_deviate(ratio: float, first: float, second: float) -> None:
    log_tail = f_log_tail(ratio, first, second)
    if -20.7 < log_tail < -0.01:
        deviate = -NormalDist().inv_cdf(math.exp(log_tail))
        assert float(f_deviate(ratio, first, second)) == pytest.approx(deviate, abs=0.02)


def test_deviates_rise_with_the_ratio_and_come_as_an_array() -> None:
    assert (np.diff(f_deviate(np.linspace(0.01, 10, 99), 7.3, 41.7)) > 0).all()
    assert (np.diff(f_deviate(3.0, np.linspace(2, 6, 41), 100.0)) > 0).all()
    assert f_deviate([[1.0], [2.0]], [4.0, 5.0, 6.0], 30.0).shape == (2, 3)


@given(st.floats(0, 1e3), DEGREES)
def test_students_tails(t: float, degrees: float) -> None:
    expected = 2 * stats.t.sf(t, degrees)
    assert student_tail(t, degrees) == pytest.approx(expected, rel=1e-8 * max(degrees / 1e3, 1), abs=1e-290)
    assert student_tail(-t, degrees) == student_tail(t, degrees)


@given(st.floats(0.5001, 1 - 1e-9), st.floats(0.5, 1e5))
def test_students_quantiles(probability: float, degrees: float) -> None:
    expected = stats.t.ppf(probability, degrees)
    assert student_quantile(probability, degrees) == pytest.approx(expected, rel=1e-6, abs=1e-9)
