"""Tests of the scatter of Allan variances. It is compared with simulations, and with the known sums for
power-law spectra.
"""

import itertools

import numpy as np
import pytest
from fltea.identification.allan import averaging_factors, differences, overlapping
from fltea.identification.noise_model import AxisModel, Lorentzian, draws
from fltea.identification.reproduction import expected
from fltea.noise.allan_deviation import model_adev
from fltea.noise.allan_spread import allan_degrees
from fltea.noise.distributions import chi2_log_std
from fltea.noise.parts import Order, Relaxation, Resonance, Walk, White
from fltea.spectrum.allan_dof import full_overlap
from scipy import special, stats

from tests.rig.tiers import slow_but

H = 0.01
N = 4096
SIMULATIONS = 200
MODELS = {
    "white": AxisModel((White(0.01),)),
    "walk": AxisModel((White(1.0), Walk(1.0))),
    "relaxation": AxisModel((White(0.01), Relaxation(0.07, 0.1))),
    "order": AxisModel((White(0.02), Order(0.6, -3.0, 0.15))),
    "resonance": AxisModel((White(1.0), Resonance(5.0, 20.0, 1.0))),
    "wide line": AxisModel((White(0.01),), (Lorentzian(31.4, 8.0, 0.03),)),
    "line": AxisModel((White(0.01),), (Lorentzian(31.4, 0.5, 0.03),)),
    "slow line": AxisModel((White(0.01),), (Lorentzian(0.19, 0.023, 0.05),)),
    "slow line, wide": AxisModel((White(0.01),), (Lorentzian(0.5, 0.09, 0.3), Lorentzian(30.0, 0.3, 0.02))),
    "hair line": AxisModel((White(0.01),), (Lorentzian(7.3, 0.01, 0.003), Lorentzian(21.0, 0.02, 0.01))),
}


@pytest.mark.parametrize("name", slow_but(["relaxation", "order", "wide line"], MODELS))
def test_mean_and_spread_are_those_of_simulations(name: str) -> None:
    """Mean and degrees of freedom of Allan variances agree with those of simulations, within the errors of
    the simulations.

    The simulated degrees of freedom follow from the variance of n simulated Allan variances. The relative
    error of that variance is √((2 + e) / n), where e = 12 / degrees is the excess kurtosis of chi-squared.
    """
    model, factors = MODELS[name], averaging_factors(N)
    deviation, degrees = expected(model, H, factors, differences(factors, [N]))
    simulated = itertools.islice(draws(model, H, N, np.random.default_rng(5)), SIMULATIONS)
    squares = np.array([overlapping([y], factors) for y, _ in simulated]) ** 2
    mean, std = squares.mean(axis=0), squares.std(axis=0, ddof=1)
    error = std / np.sqrt(SIMULATIONS)
    assert (np.abs(mean - deviation**2) < 4 * error + 2e-3 * mean).all()
    off = np.log(degrees * (std / mean) ** 2 / 2)
    error = np.sqrt((2 + 12 / degrees) / SIMULATIONS)
    assert np.abs(off / error).max() < 4
    assert abs((off / error).mean()) < 3


@pytest.mark.parametrize("power", [0, -1, -2])
def test_degrees_of_powers_of_the_frequency_are_those_of_their_sums(power: int) -> None:
    """The degrees of freedom equal those by the sums of Greenhall and Riley, at averaging times of many
    samples.

    Their sums are for exact powers of the frequency. The noise here has such a spectrum only far below the
    sampling rate, so short averaging times are left out.
    """
    samples, factors = 1 << 15, np.array([64, 200, 1000, 4000, 8192])

    def spectrum(lam: np.ndarray) -> np.ndarray:
        return (2 * np.sin(lam / 2)) ** power

    found = allan_degrees(
        spectrum, factors, model_adev(spectrum, factors) ** 2, differences(factors, [samples])
    )
    wanted = full_overlap(np.full(len(factors), power), factors, samples)
    np.testing.assert_allclose(found, wanted, rtol=0.02)


def test_of_neighbours_of_white_noise_it_is_exact() -> None:
    """By hand: the mean of M squared differences has M / Σ r² degrees of freedom, where r is the correlation
    of two differences, and the sum is over all lags. For differences of neighbouring samples of white noise,
    r is 1 at lag 0 and -1/2 at lags 1 and -1, so Σ r² = 1 + 2/4.
    """
    found = allan_degrees(np.ones_like, [1], [1.0], [10**6])
    assert found == pytest.approx(10**6 / 1.5, rel=1e-5)


@pytest.mark.parametrize(("width_hz", "degrees"), [(1e-7, 2.0), (0.5, 2 * np.pi * 0.5 * H * 10_000)])
def test_a_line_alone_has_two_degrees_for_each_time_that_it_remembers(
    width_hz: float, degrees: float
) -> None:
    model = AxisModel((White(1e-12),), (Lorentzian(11.0, width_hz, 3.0),))
    _, found = expected(model, H, np.array([1.0]), np.array([10_000.0]))
    assert found == pytest.approx(degrees, rel=0.06)


def test_the_deviation_of_a_narrow_line_is_that_of_its_cosine() -> None:
    """The Allan deviation of a cosine at m samples is proportional to sin²(m λ/2) / m, where λ is its
    frequency in radians per sample.

    A narrow spectral line has the same deviation if the integral over the spectrum is taken in steps as
    narrow as the line.
    """
    line = Lorentzian(7.3, 1e-5, 2.0)
    factors = np.array([1, 3, 10, 31, 100])
    found, _ = expected(AxisModel((White(1e-12),), (line,)), H, factors, np.full(5, 1e6))
    lam = 2 * np.pi * 7.3 * H
    wanted = np.sqrt(2.0 * 2 * np.sin(factors * lam / 2) ** 4 / (factors * np.sin(lam / 2)) ** 2)
    np.testing.assert_allclose(found, wanted, rtol=1e-3)


def test_the_logarithm_of_chi_squared() -> None:
    degrees = np.array([1.0, 1.7, 4.0, 30.0, 1e5])
    np.testing.assert_allclose(chi2_log_std(degrees), np.sqrt(special.polygamma(1, degrees / 2)), rtol=1e-9)
    drawn = np.log(stats.chi2(4).rvs(200_000, random_state=1)).std()
    assert chi2_log_std(4.0) == pytest.approx(drawn, rel=0.01)
