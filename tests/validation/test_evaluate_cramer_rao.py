"""The Cramér–Rao bound against closed forms and against differences of the spectrum that is fitted."""

import math

import numpy as np
import pytest
from fltea.noise import spectra as spectrum
from hypothesis import given, settings
from hypothesis import strategies as st

from tools.validation.evaluate.cramer_rao import LAM, bound, fisher, mean

N, H = 3000, 0.01
CASES = [(0.3, -0.4, 2.0, 0.5), (0.6, -0.19, 1.0, 3.0), (0.8, -0.025, 0.03, 1.0), (1.4, -1.1, 1.0, 0.2)]


@settings(max_examples=25)
@given(phi=st.floats(-0.95, 0.95))
def test_ar1(phi: float) -> None:
    """α = 1 and g = φ - 1 are AR(1), with var φ = (1 - φ²)/n; var log s2 = 2/n."""
    information = fisher(1.0, phi - 1, 2.5, 0.0, N)
    assert information[1, 1] == pytest.approx(N / (1 - phi**2), rel=1e-6)
    assert information[2, 2] == pytest.approx(N / 2, rel=1e-9)
    assert information[1, 2] == pytest.approx(0, abs=1e-6 * N)


@pytest.mark.parametrize("d", [0.05, 0.3, 0.45])
def test_fractional_noise(d: float) -> None:
    """g = 0 is ARFIMA(0, d, 0), whose var d is 6/(π² n)."""
    assert fisher(d, 0.0, 1.0, 0.0, N)[0, 0] == pytest.approx(N * math.pi**2 / 6, rel=1e-6)


@pytest.mark.parametrize("case", CASES)
def test_total_power_is_known_to_two_over_n(case: tuple[float, float, float, float]) -> None:
    """To scale s2 and R together scales the spectrum."""
    assert fisher(*case, N)[2:, 2:].sum() == pytest.approx(N / 2, rel=1e-9)


def log_spectrum(p: np.ndarray) -> np.ndarray:
    alpha, f, log_s2, log_R = p
    g = spectrum.g_of(alpha, f, H)
    return np.log(math.exp(log_s2) * spectrum.fractional(LAM, alpha, g) + math.exp(log_R))


@pytest.mark.parametrize("case", CASES)
def test_bound_of_alpha_and_f_by_differences(case: tuple[float, float, float, float]) -> None:
    """With f itself for a parameter, and the slopes from the spectrum that the Whittle fit uses."""
    alpha, g, s2, R = case
    here = np.array([alpha, spectrum.f_of(alpha, g, H), math.log(s2), math.log(R)])
    slopes = []
    for i, step in enumerate(1e-5 * np.eye(4)):
        step = step * max(1.0, abs(here[i]))
        slopes.append((log_spectrum(here + step) - log_spectrum(here - step)) / (2 * step[i]))
    information = N / 2 * mean(np.array(slopes)[:, np.newaxis] * np.array(slopes))
    expected = np.sqrt(np.diag(np.linalg.inv(information)))
    found = bound(alpha, g, s2, R, N, H)
    assert found.alpha == pytest.approx(expected[0], rel=1e-4)
    assert found.f == pytest.approx(expected[1], rel=1e-4)


@pytest.mark.parametrize(
    ("shape", "expected"),
    [
        *((spectrum.ar1(LAM, phi), 1 / (1 - phi**2)) for phi in (-0.9, 0.5, 0.999, 0.99999)),
        *(
            (spectrum.fractional(LAM, d, 0.0), math.gamma(1 - 2 * d) / math.gamma(1 - d) ** 2)
            for d in (0.1, 0.3)
        ),
    ],
)
def test_means_over_the_frequencies(shape: np.ndarray, expected: float) -> None:
    """Variances of AR(1), with a memory of up to 100,000 samples, and of a pole at λ = 0."""
    assert mean(shape) == pytest.approx(expected, rel=1e-5)
