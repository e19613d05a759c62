"""Parts of noise: spectra against closed forms, slopes, and coordinates there and back."""

import math

import numpy as np
import pytest
from fltea.noise import parts as p
from fltea.spectrum.frontier import native
from hypothesis import given
from hypothesis import strategies as st
from identify_support import H
from sentence_support import PARTS, bins, closed_form

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
def test_coordinates_are_those_of_the_part(kind: str, data: st.DataObject) -> None:
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
