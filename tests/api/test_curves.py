"""Curves as SVG: in the chart's coordinates they are what the fit says."""

import math
import re
from xml.etree import ElementTree

import pytest
from fit_support import UNDECIDED, with_curves
from fltea.documents import curves
from fltea.records.fit import FitAllan

SVG = "{http://www.w3.org/2000/svg}"


class Chart:
    """A chart that was read back. lines: points in pixels by colour; tips: what its points say."""

    def __init__(self, text: str) -> None:
        root = ElementTree.fromstring(text)
        self.lines: dict[str, list[list[tuple[float, float]]]] = {}
        for line in root.iter(f"{SVG}polyline"):
            points = [point.partition(",") for point in line.attrib["points"].split()]
            self.lines.setdefault(line.attrib["stroke"], []).append(
                [(float(x), float(y)) for x, _, y in points]
            )
        self.words = [one.text for one in root.iter(f"{SVG}text")]
        self.tips = [one.text for one in root.iter(f"{SVG}title")]
        self.bands = [one for one in root.iter(f"{SVG}rect") if one.attrib["fill"] == "currentColor"]
        self.crosses = list(root.iter(f"{SVG}path"))
        self.label = root.attrib["aria-label"]


def test_marks_are_the_lines_of_the_coefficients() -> None:
    """σ = N/√τ, 0.664 B and K √(τ/3): where the deviation is that, the lines cover it."""
    tau = [0.1, 0.4, 1.6, 6.4]
    for name, adev in (
        ("N", [0.3 / math.sqrt(t) for t in tau]),
        ("B", [math.sqrt(2 * math.log(2) / math.pi) * 0.3] * 4),
        ("K", [0.3 * math.sqrt(t / 3) for t in tau]),
    ):
        shown = Chart(curves.allan(FitAllan(tau, adev, adev, adev, adev, **{name: 0.3}), "deg/s"))
        assert name in shown.words
        assert shown.lines["#a05fd0"] == shown.lines["currentColor"] == shown.lines["#d95f02"]
    assert "#a05fd0" not in Chart(curves.allan(FitAllan(tau, adev, adev, adev, adev), "deg/s")).lines


def test_a_spectrum_has_its_bands_its_model_and_the_boards_bins() -> None:
    fit = with_curves(UNDECIDED)
    assert fit.spectrum is not None
    bins = [0.1, 1.0, 10.0], [5e-3, 4e-3, 3e-3]
    shown = Chart(curves.spectrum(fit.spectrum, "deg/s", fit.rate_left_out, bins))
    assert len(shown.bands) == 2
    assert len(shown.crosses) == 3
    assert all(word in shown.label for word in ("orange: fitted", "left out", "board's bins"))
    assert "density [deg/s/√Hz]" in shown.words
    assert [len(line) for line in shown.lines["#d95f02"]] == [len(fit.spectrum.model)]
    assert shown.tips[0] == f"{fit.spectrum.hz[0]:.3g}: {fit.spectrum.density[0]:.3g}"


def test_what_has_no_logarithm_is_left_out_and_text_is_text() -> None:
    nan = float("nan")
    allan = FitAllan([0.01, 0.02, 0.04], [nan, 2e-3, 1e-3], [0.0, 1e-3, 1e-3], [math.inf, 3e-3, 2e-3], [])
    shown = Chart(curves.allan(allan, "<b>"))
    assert [len(line) for line in shown.lines["currentColor"]] == [2]
    assert shown.tips == ["0.02: 0.002 (0.001 to 0.003)", "0.04: 0.001 (0.001 to 0.002)"]
    assert "deviation [<b>]" in shown.words


@pytest.mark.parametrize(("low", "high"), [(1.0, 1.5), (0.1, 5.0), (1e-6, 1e6), (3.0, 3.0)])
def test_an_axis_has_some_marks_and_not_too_many(low: float, high: float) -> None:
    line = curves.Curve([1.0, 2.0], [low, high], "data")
    words = re.findall(r'text-anchor="end">([^<]*)<', curves.log_log("t", "x", "y", [line]))
    assert 1 <= len(words) <= 8
    assert len(set(words)) == len(words)
