"""Tests the exact likelihood. It has to equal the probability density that is computed from the samples'
whole covariance matrix, and to agree with closed forms.
"""

import math

import numpy as np
import pytest
from fltea.noise import spectra
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.rig.tiers import long
from tools.validation.evaluate import exact_likelihood
from tools.validation.evaluate.cases import Case, H, samples
from tools.validation.evaluate.exact_fit import ExactSeries
from tools.validation.evaluate.exact_likelihood import FREQUENCIES, autocovariance, innovations, likelihood

Array = np.ndarray


def toeplitz(gamma: Array) -> Array:
    lags = np.arange(len(gamma))
    return gamma[np.abs(lags[:, np.newaxis] - lags)]


def multivariate(gamma: Array, y: Array) -> float:
    """Return the negative logarithm of the normal density of the samples y, from the whole covariance matrix.

    The mean of the samples, and the scale (factor of the covariances), are those that fit best.
    """
    n, ones = len(y), np.ones(len(y))
    matrix = toeplitz(gamma)
    mean = ones @ np.linalg.solve(matrix, y) / (ones @ np.linalg.solve(matrix, ones))
    scale = (y - mean) @ np.linalg.solve(matrix, y - mean) / n
    _, log_det = np.linalg.slogdet(2 * np.pi * scale * matrix)
    return float(0.5 * (log_det + n))


@settings(max_examples=25, deadline=None)
@given(
    alpha=st.floats(0.05, 1.8),
    share=st.floats(0.001, 0.95),
    weight=st.floats(0.01, 0.99),
    seed=st.integers(0, 1000),
)
def test_sixty_samples_against_the_whole_matrix(alpha: float, share: float, weight: float, seed: int) -> None:
    y = 3 + 2 * np.random.default_rng(seed).standard_normal(60)
    spectrum = weight * spectra.fractional(FREQUENCIES, alpha, -share * 2**alpha) + (1 - weight)
    gamma = autocovariance(spectrum, 60)
    assert likelihood(gamma, y).nll == pytest.approx(multivariate(gamma, y), abs=1e-6)


@pytest.mark.parametrize("phi", [-0.9, 0.3, 0.95, 0.999])
def test_ar1(phi: float) -> None:
    """An autoregression AR(1) with coefficient φ has the autocovariance γ(k) = φ^k / (1 - φ²) at lag k. Each
    sample adds to the likelihood only what the sample before does not predict.
    """
    gamma = autocovariance(1 / (1 - 2 * phi * np.cos(FREQUENCIES) + phi**2), 3000)
    np.testing.assert_allclose(gamma * (1 - phi**2), phi ** np.arange(3000.0), atol=1e-4)
    y = np.random.default_rng(5).standard_normal((3000, 1))
    error, variance = innovations(phi ** np.arange(3000.0) / (1 - phi**2), y)
    np.testing.assert_allclose(error[1:, 0], y[1:, 0] - phi * y[:-1, 0], atol=1e-9)
    np.testing.assert_allclose(variance, [1 / (1 - phi**2), *np.ones(2999)], rtol=1e-9)


@pytest.mark.parametrize("d", [0.1, 0.3, 0.45])
def test_fractional_noise(d: float) -> None:
    """For f = 0, the spectrum of noise of order d is infinite at frequency 0. Its autocovariance γ has a
    closed form.

    At lag 0 it is γ(0) = Γ(1 - 2d)/Γ(1 - d)². At lag k, γ(k)/γ(k - 1) = (k - 1 + d)/(k - d).
    """
    gamma = autocovariance(spectra.fractional(FREQUENCIES, d, 0.0), 2000)
    k = np.arange(1.0, 2000)
    expected = (
        math.gamma(1 - 2 * d) / math.gamma(1 - d) ** 2 * np.cumprod(np.append(1, (k - 1 + d) / (k - d)))
    )
    # The spectrum is used at CIRCLE frequencies, as if the noise repeated after CIRCLE samples. The true
    # noise has a longer memory. This changes all autocovariances here by the same constant, so it is
    # subtracted.
    np.testing.assert_allclose(gamma - gamma[0], expected - expected[0], atol=2e-3 * expected[0])


@pytest.mark.parametrize("gamma", [[0.0, 0.0], [1.0, 1.1], [1.0, -1.0, 1.0], [-1.0, 0.0]])
def test_what_is_no_autocovariance(gamma: list[float]) -> None:
    with pytest.raises(ValueError, match="not the autocovariances"):
        likelihood(np.array(gamma), np.arange(len(gamma), dtype=float))


@pytest.mark.parametrize("n", [0, exact_likelihood.CIRCLE // 8 + 1])
def test_lengths(n: int) -> None:
    with pytest.raises(ValueError, match="n must be"):
        autocovariance(np.ones_like(FREQUENCIES), n)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, long(1)])
def test_the_fit_is_a_maximum_and_its_interval_is_where_it_ends(seed: int) -> None:
    """The exact fit to 600 samples is a maximum: no neighbouring parameters have a larger likelihood.

    The interval of the order α contains all orders for which 2 log L (L: likelihood) is below its maximum by
    at most a fixed value.
    """
    case = Case(0.8, -10.0, 30.0)
    series = ExactSeries(samples(case, 2, 600)[:, seed], H)
    _, found = series.covers(case.alpha, series.fit())
    assert found.s2 + found.R == pytest.approx(case.noise.s2 + case.noise.R, rel=0.3)
    for step in 0.2 * np.vstack([np.eye(3), -np.eye(3)]):
        assert series.nll(found.theta + step) > found.nll - 0.02
    inside = [series.covers(alpha, found)[0] for alpha in found.alpha - np.linspace(0, 0.8, 9)]
    assert inside[0]
    assert not inside[-1]
    assert sorted(inside, reverse=True) == inside, "it has one lower end"
