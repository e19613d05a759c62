"""Tests of the Allan deviation that follows from a spectrum. It is compared with closed forms (40 digits) and
with simulated noise.
"""

import mpmath
import numpy as np
import pytest
from fltea.identification.allan import overlapping
from fltea.identification.noise_model import AxisModel, draws
from fltea.noise.allan_deviation import model_adev
from fltea.noise.parts import Order, White
from fltea.noise.spectra import fractional, g_of, step_variance
from hypothesis import given, settings
from hypothesis import strategies as st

H = 0.01
OCTAVES = 2.0 ** np.arange(33)
OTHERS = np.unique(np.rint(np.geomspace(1, 3e6, 40)))


def ar1(lam: np.ndarray, phi: float) -> np.ndarray:
    return 1 / ((1 - phi) ** 2 + 4 * phi * np.sin(lam / 2) ** 2)


def ar1_deviation(phi: float, m: float) -> float:
    """Return the Allan deviation of the process x_k = φ x_{k-1} + noise of variance 1.

    The deviation follows from the variances of sums of m and of 2m values.
    """
    with mpmath.workdps(40):
        p = mpmath.mpf(phi)

        def sum_variance(n: float) -> mpmath.mpf:
            return (n * (1 + p) / (1 - p) - 2 * p * (1 - p**n) / (1 - p) ** 2) / (1 - p**2)

        return float(mpmath.sqrt((4 * sum_variance(m) - sum_variance(2 * m)) / (2 * mpmath.mpf(m) ** 2)))


@pytest.mark.parametrize(("factors", "error"), [(OCTAVES, 1e-6), (OTHERS, 1e-4)])
def test_white_noise(factors, error):
    found = model_adev(lambda lam: np.full(lam.shape, 4.0), factors)
    np.testing.assert_allclose(found, 2 / np.sqrt(factors), rtol=error)


@pytest.mark.parametrize("phi", [-0.95, -0.5, 0.5, 0.9, 0.999, 0.999999])
@pytest.mark.parametrize("factors", [OCTAVES[:24], OTHERS])
def test_ar1(phi, factors):
    found = model_adev(lambda lam: ar1(lam, phi), factors)
    np.testing.assert_allclose(found, [ar1_deviation(phi, m) for m in factors], rtol=2e-4)


def test_a_random_walk_at_its_corner():
    """The Allan variance of a random walk with steps of variance s2, at m samples, is s2 (2 m² + 1) / (6 m).

    The model here is a relaxation. Its corner frequency is so low that, at these averaging times, its Allan
    variance is that of a random walk.
    """
    m = OCTAVES[:12]
    found = model_adev(lambda lam: ar1(lam, 1 - 1e-9), m)
    np.testing.assert_allclose(found, np.sqrt((2 * m**2 + 1) / (6 * m)), rtol=2e-4)


@pytest.mark.parametrize("state", [Order(0.8, -1.0, 0.6), Order(1.5, -30.0, 10.0)], ids=["usual", "near 2"])
def test_noise_of_the_spectrum(state):
    model = AxisModel((White(0.02), state))
    g, s2 = g_of(state.alpha, state.f, H), step_variance(state.alpha, state.Q, H)
    factors = 2 ** np.arange(13)
    found = model_adev(lambda lam: s2 * fractional(lam, state.alpha, g) + 0.02, factors)
    drawn = [
        overlapping([y], factors)
        for y, _ in [next(draws(model, H, 1 << 17, np.random.default_rng(seed))) for seed in range(12)]
    ]
    square = np.square(drawn)
    error = square.std(axis=0, ddof=1) / np.sqrt(len(drawn)) / square.mean(axis=0)
    assert (np.abs(square.mean(axis=0) / found**2 - 1) < 5 * error + 1e-3).all()


@given(st.floats(0.05, 1.9), st.floats(0.001, 0.9), st.floats(1e-3, 1e3))
@settings(max_examples=40, deadline=None)
def test_scale_and_one_factor_at_a_time(alpha, share, scale):
    g = -share * 2**alpha

    def S(lam):
        return fractional(lam, alpha, g) + 0.1

    together = model_adev(S, [1, 7, 64, 1000])
    np.testing.assert_allclose(
        model_adev(lambda lam: scale**2 * S(lam), [1, 7, 64, 1000]), scale * together, rtol=1e-9
    )
    alone = [model_adev(S, [m])[0] for m in (1, 7, 64, 1000)]
    np.testing.assert_allclose(alone, together, rtol=1e-4)


@pytest.mark.parametrize("factor", [0.0, 0.5, -1.0, np.nan, np.inf])
def test_impossible_averaging_times(factor):
    with pytest.raises(ValueError, match="1 or more"):
        model_adev(np.ones_like, [1.0, factor])
