"""Spectra against closed forms, against the recursion itself, and against each other's aliases."""

import numpy as np
import pytest
from fltea.noise import spectra as spectrum
from fltea.spectrum.periodogram import periodogram
from hypothesis import given
from hypothesis import strategies as st
from identify_support import H, recursion

LAM = np.linspace(1e-4, np.pi, 400)


@given(st.floats(-0.99, 0.99))
def test_aliases(phi: float) -> None:
    """α = 0 with g = φ, α = 1 with g = φ - 1, and AR(1), by its textbook formula, are the same."""
    textbook = 1 / (1 - 2 * phi * np.cos(LAM) + phi**2)
    np.testing.assert_allclose(spectrum.fractional(LAM, 0.0, phi), textbook, rtol=1e-9)
    np.testing.assert_allclose(spectrum.fractional(LAM, 1.0, phi - 1), textbook, rtol=1e-7)


@given(st.floats(0, 1.99), st.floats(-4, 0.5))
def test_fractional_is_the_square_of_its_transfer_function(alpha: float, g: float) -> None:
    z = np.exp(-1j * LAM)
    distance = np.abs((1 - z) ** alpha - g * z) ** 2
    good = distance > 1e-6
    np.testing.assert_allclose(spectrum.fractional(LAM, alpha, g)[good], 1 / distance[good], rtol=1e-6)


def test_recursion_has_the_spectrum() -> None:
    """Averages over frequency and series of I/S are 1, at low and at high frequencies."""
    alpha, f = 0.6, -3.0
    p = periodogram(recursion(alpha, f, 1500, 64, 1, 1000), H)
    ratio = (p.power / spectrum.fractional(p.lam, alpha, spectrum.g_of(alpha, f, H))).mean(axis=0)
    for part in np.array_split(ratio, 5):
        assert part.mean() == pytest.approx(1, abs=4 / np.sqrt(64 * len(part)) + 0.01)


@given(st.floats(0, 1.99), st.floats(-50, 5), st.floats(1e-3, 1), st.floats(1e-6, 1e6))
def test_conversions_are_inverse(alpha: float, f: float, h: float, Q: float) -> None:
    assert spectrum.f_of(alpha, spectrum.g_of(alpha, f, h), h) == pytest.approx(f, rel=1e-9)
    assert spectrum.noise_variance(alpha, spectrum.step_variance(alpha, Q, h), h) == pytest.approx(
        Q, rel=1e-9
    )
    assert spectrum.g_of(1.0, f, h) == pytest.approx(f * h)
