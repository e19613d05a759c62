"""Tests the parts of noise. Their spectra are compared with closed forms. Their derivatives are tested, too,
and the conversion of their parameters to free parameters and back.
"""

import math

import numpy as np
import pytest
from fltea.noise import parts as p
from fltea.noise import spectra as spectrum
from fltea.spectrum.candidate_models import native
from fltea.spectrum.periodogram import periodogram
from hypothesis import given
from hypothesis import strategies as st

from tests.rig.identify_support import H, recursion
from tests.rig.model_support import PARTS, bins, closed_form

LAM = np.linspace(1e-3, np.pi, 5000)

kinds = pytest.mark.parametrize("kind", PARTS)


@kinds
def test_every_kind_is_here(kind: str) -> None:
    tags = {one.__struct_config__.tag for one in p.AnyPart.__args__}
    assert tags == {*PARTS, "white"}


@kinds
@given(st.data())
def test_spectra_are_those_of_closed_forms(kind: str, data: st.DataObject) -> None:
    parts = [p.White(1.0), p.Relaxation(1.0, 0.5), data.draw(PARTS[kind])]
    expected = closed_form(parts, LAM, H)
    found = p.spectrum(parts, LAM, H)
    np.testing.assert_allclose(
        found, expected, rtol=2e-4, atol=3e-4 * expected.max() * (kind in "notch mean")
    )


@kinds
@given(st.data())
def test_free_parameters_are_those_of_the_part(kind: str, data: st.DataObject) -> None:
    part = data.draw(PARTS[kind])
    eta = part.eta(H)
    assert len(eta) == p.free_of(part.code)
    again = p.part_of(part.code, eta, H)
    assert type(again) is type(part)
    for name in part.__struct_fields__:
        assert getattr(again, name) == pytest.approx(getattr(part, name), rel=1e-5, abs=1e-6)


@kinds
@given(st.data())
def test_slopes_are_differences(kind: str, data: st.DataObject) -> None:
    part = data.draw(PARTS[kind])
    data_of = bins([p.White(1.0)], 60_000, H, None)
    fits = native(data_of, H, 0)
    codes, eta = [0, 1, part.code], [0.0, 0.3, -3.0, *part.eta(H)]
    total, rows = np.empty(len(data_of.lam)), np.empty((len(eta), len(data_of.lam)))
    fits.slopes(codes, eta, total, rows)
    spare = np.empty_like(rows)
    for i, row in enumerate(rows):
        ends = []
        for step in (-1e-5, 1e-5):
            moved = [*eta]
            moved[i] += step
            fits.slopes(codes, moved, end := np.empty_like(total), spare)
            ends.append(np.log(end))
        np.testing.assert_allclose(row, (ends[1] - ends[0]) / 2e-5, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize(
    ("kind", "values"),
    [(p.White, (-1.0,)), (p.White, (math.nan,)), (p.Relaxation, (1.0, -0.1)), (p.LowPass, (math.inf, 1.0))],
)
def test_what_is_no_part_is_refused(kind: type[p.Part], values: tuple[float, ...]) -> None:
    with pytest.raises(ValueError, match="must be"):
        kind(*values)


def test_a_state_that_grows_has_no_spectrum() -> None:
    with pytest.raises(ValueError, match="not stationary"):
        p.spectrum([p.Order(0.5, 1.0, 1.0)], LAM, H)


@given(st.floats(-0.99, 0.99))
def test_aliases(phi: float) -> None:
    """With the sampling period h and g = h^α f, three noises have the same spectrum: the order α = 0 with g =
    φ, the order α = 1 with g = φ - 1, and an autoregression AR(1) with the coefficient φ.
    """
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
    """Samples that the recursion of a fractional noise generates have the spectrum that the closed form
    gives. The mean ratio of their periodogram to this spectrum is 1, both at low and at high frequencies.
    """
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
