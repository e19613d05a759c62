"""The curves in charts (SVG files) agree with the fit, after their points are converted from pixels."""

import math
import re
from xml.etree import ElementTree

import pytest
from fltea.documents import curves
from fltea.documents.chart import HEIGHT, LEFT, RIGHT, TOP, WIDTH, Bands, Curve, chart, log_log
from fltea.documents.chart_scales import Axis
from fltea.records.fit import FitAllan

from tests.rig.fit_support import UNDECIDED, with_curves

SVG = "{http://www.w3.org/2000/svg}"


class Chart:
    """A chart that was read back from its SVG text.

    `lines`: points in pixels by colour. `tips`: tooltips of the chart's points.
    """

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
    """The straight lines of a chart of the Allan deviation are σ = N/√τ, 0.664 B and K √(τ/3).

    If the deviation has exactly these values, its curve and the line have the same points.
    """
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
    line = Curve([1.0, 2.0], [low, high], "data")
    words = re.findall(r'text-anchor="end">([^<]*)<', log_log("t", "x", "y", [line]))
    assert 1 <= len(words) <= 8
    assert len(set(words)) == len(words)


def test_a_linear_axis_goes_from_end_to_end() -> None:
    line = Curve([0.0, 5.0, 10.0], [-1.0, 0.0, 1.0], "own")
    shown = Chart(chart("t", Axis("x [s]", ends=(0.0, 10.0)), Axis("y", ends=(-1.0, 1.0)), [line]))
    ((first, middle, last),) = shown.lines["#a05fd0"]
    assert (first[0], last[0]) == (LEFT, WIDTH - RIGHT)
    assert last[1] == TOP
    assert middle[1] - last[1] == first[1] - middle[1] > 50
    for word in ("0", "2", "10", "-0.5", "0.0", "1.0", "x [s]"):
        assert word in shown.words


@pytest.mark.parametrize(("low", "high"), [(0.0, 1e-9), (-3.0, 86_400.0), (5.0, 5.0), (1e6, 1e6 + 1), (0, 0)])
def test_a_linear_axis_has_some_marks_and_not_too_many(low: float, high: float) -> None:
    svg = chart("t", Axis("x"), Axis("y"), [Curve([1.0, 2.0], [low, high], "data")])
    words = re.findall(r'text-anchor="end">([^<]*)<', svg)
    assert 2 <= len(words) <= 7
    assert len(set(words)) == len(words)


def test_a_line_is_broken_where_a_number_is_missing_and_cut_at_the_frame() -> None:
    nan = math.nan
    line = Curve([0, 1, 2, 3, 4, 5], [0.0, 1.0, nan, 1.0, 9.0, 1.0], "own")
    shown = Chart(chart("t", Axis("x"), Axis("y", ends=(0.0, 2.0)), [line]))
    before, up, down = shown.lines["#a05fd0"]
    assert [len(part) for part in (before, up, down)] == [2, 2, 2]
    assert up[1][1] == down[0][1] == TOP
    eighth = (down[1][0] - up[0][0]) / 2 / 8
    assert up[1][0] - up[0][0] == pytest.approx(eighth, abs=0.1)
    assert "nan" not in chart("t", Axis("x"), Axis("y"), [line])


def test_a_long_line_keeps_its_extremes_in_some_hundred_points() -> None:
    y = [math.sin(i / 50) for i in range(200_000)]
    y[77_777], y[123_456] = 5.0, -5.0
    line = Curve(range(len(y)), y, "own", [v - 1 for v in y], [v + 1 for v in y])
    svg = chart("t", Axis("time [s]"), Axis("y"), [line])
    ((*points,),) = Chart(svg).lines["#a05fd0"]
    assert 100 < len(points) < 300
    x = [at for at, _ in points]
    assert x == sorted(x)
    highest = min(points, key=lambda point: point[1])
    assert Chart(chart("t", Axis("x"), Axis("y"), [Curve([0, 77_777, len(y) - 1], [-5, 5, 0], "own")])).lines[
        "#a05fd0"
    ][0][1] == pytest.approx(highest)
    assert len(svg) < 25_000


def test_the_legend_says_what_has_a_label_below_the_chart() -> None:
    long = "a model of many parts: " + "relaxation + " * 12 + "white"
    labelled = [
        Curve([0, 1], [0, 1], "own", [0, 0], [1, 2], label="<it>"),
        Curve([0, 1], [1, 0], "data"),
        Curve([0, 1], [1, 0], "points", label=long),
    ]
    root = ElementTree.fromstring(chart("t", Axis("x"), Axis("y"), labelled, Bands([(0.2, 0.4)], "motion")))
    below = [one for one in root.iter(f"{SVG}text") if float(one.attrib["y"]) > HEIGHT]
    said = " ".join(one.text or "" for one in below)
    assert said == f"<it> {long} motion"
    assert max(len(one.text or "") for one in below) < 75
    assert max(float(one.attrib["y"]) for one in below) < float(root.attrib["height"])
    plain = ElementTree.fromstring(chart("t", Axis("x"), Axis("y"), labelled[1:2]))
    assert float(plain.attrib["height"]) == HEIGHT
