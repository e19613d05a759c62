"""Quantiles of chi-squared against scipy's, which comes with the tests only."""

import numpy as np
import pytest
from fltea.spectrum.chi_square import MANY, quantile
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chi2


@pytest.mark.parametrize("probability", [0.005, 0.025, 0.05, 0.5, 0.95, 0.975, 0.995])
def test_against_scipy(probability):
    degrees = np.concatenate([np.geomspace(0.5, MANY, 200), [MANY, 1.001 * MANY], np.geomspace(160, 1e8, 50)])
    expected = chi2.ppf(probability, degrees)
    few = degrees < MANY
    np.testing.assert_allclose(quantile(probability, degrees)[few], expected[few], rtol=1e-9)
    np.testing.assert_allclose(quantile(probability, degrees)[~few], expected[~few], rtol=2e-4)


@given(st.floats(0.001, 0.999), st.floats(0.3, 1e6))
def test_the_distribution_at_the_quantile(probability, degrees):
    assert chi2.cdf(quantile(probability, [degrees]), degrees)[0] == pytest.approx(probability, abs=2e-4)


@pytest.mark.parametrize(
    ("probability", "degrees"),
    [(0.0, 1.0), (1.0, 1.0), (0.5, 0.0), (0.5, -1.0), (0.5, np.nan), (0.5, np.inf)],
)
def test_what_has_no_quantile(probability, degrees):
    with pytest.raises(ValueError, match=r"must be positive|lies between"):
        quantile(probability, [degrees])
