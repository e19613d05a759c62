"""The figures of spectrum and Allan deviation draw what the fit says, and are sent only when it is new."""

import json
import math
from typing import Any

import numpy as np
import pytest
from bokeh.document import Document
from dashboard_support import records, told
from fit_support import FRACTIONAL, UNDECIDED, WHITE, curves, fit_after, with_curves
from fltea.records.records import Sample
from fltea.sinks.page.curve_figures import CurveFigures
from fltea.sinks.page.figures import Figures
from fltea.sinks.page.page import Page, closed
from msgspec.structs import replace


def test_curves_are_drawn_as_the_fit_gives_them() -> None:
    figures = CurveFigures()
    spectrum, allan = curves()
    figures.show("gyro_z", "deg/s", with_curves(UNDECIDED))
    assert figures.density.data["hz"].tolist() == spectrum.hz
    assert figures.density.data["density"].tolist() == spectrum.density
    assert figures.density.data["model"].tolist() == spectrum.model
    assert figures.left_out.data == {"low": [11.4, 24.0], "high": [12.7, 25.0]}
    assert figures.deviation.data["adev"].tolist() == allan.adev
    assert figures.deviation.data["high"].tolist() == allan.high
    assert figures.spectrum.yaxis[0].axis_label == "gyro_z [(deg/s)/√Hz]"
    for plot, x, y in (
        (figures.spectrum, spectrum.hz, spectrum.density),
        (figures.allan, allan.tau_s, [*allan.low, *allan.high]),
    ):
        assert plot.x_range.start <= min(x) < max(x) <= plot.x_range.end
        assert plot.y_range.start <= min(y) < max(y) <= plot.y_range.end
        ticks = [t for t in plot.yaxis[0].ticker.ticks if plot.y_range.start <= t <= plot.y_range.end]
        assert len(ticks) >= 2


def test_marks_are_the_lines_of_the_coefficients() -> None:
    """σ = N/√τ, 0.664 B and K √(τ/3)."""
    figures = CurveFigures()
    fit = with_curves(WHITE)
    assert fit.allan is not None
    fit = replace(fit, allan=type(fit.allan)([0.03, 3.0], [1, 1], [1, 1], [1, 1], [1, 1], 0.3, 2.0, 0.5))
    figures.show("gyro_x", "deg/s", fit)
    marks = figures.marks.data
    assert marks["name"] == ["N", "B", "K"]
    assert [ys[-1] for ys in marks["ys"]] == pytest.approx([0.3 / math.sqrt(3), 2 * 0.664, 0.5])
    figures.show("gyro_x", "deg/s", with_curves(WHITE))
    assert figures.marks.data["name"] == ["N", "B"], "K is not seen"


def test_what_a_logarithmic_axis_cannot_show_is_left_out() -> None:
    figures = CurveFigures()
    fit = with_curves(WHITE)
    assert fit.allan is not None
    assert fit.spectrum is not None
    spectrum = type(fit.spectrum)([0.1, 1.0, 10.0], [0.0, float("nan"), 1e-3], [-1.0])
    allan = type(fit.allan)([0.01, 0.02], [1e-3, 2e-3], [0.0, 1e-3], [2e-3, float("inf")], [])
    figures.show("gyro_x", "deg/s", replace(fit, spectrum=spectrum, allan=allan, rate_left_out=[(0, 0.05)]))
    assert np.isnan(figures.density.data["density"]).tolist() == [True, True, False]
    assert np.isnan(figures.density.data["model"]).all()
    assert np.isnan(figures.deviation.data["low"]).tolist() == [True, False]
    assert min(figures.left_out.data["low"]) > 0
    assert np.isfinite([figures.allan.y_range.start, figures.allan.y_range.end]).all()


def test_without_curves_the_figures_are_empty() -> None:
    figures = CurveFigures()
    figures.show("gyro_x", "deg/s", with_curves(FRACTIONAL))
    figures.show("gyro_y", "deg/s", None)
    for source in (figures.density, figures.deviation, figures.left_out, figures.marks):
        assert {len(column) for column in source.data.values()} == {0}


def test_curves_are_sent_once_and_again_only_when_they_changed(monkeypatch: pytest.MonkeyPatch) -> None:
    shown: list[str] = []
    show = CurveFigures.show

    def counted(self: CurveFigures, axis: str, *rest: Any) -> None:
        shown.append(axis)
        show(self, axis, *rest)

    monkeypatch.setattr(CurveFigures, "show", counted)
    found = records("n=400")
    last = next(r for r in reversed(found) if isinstance(r, Sample))
    history = told(found, [fit_after(last, {"gyro_x": with_curves(FRACTIONAL), "gyro_y": WHITE})])
    page = Page(Document(), {"due": history})

    def update(**choice: Any) -> dict[str, Any]:
        usual = {"device": "", "axis": "", "window": None, "ack": page._tick}
        page._control.data = {name: [value] for name, value in {**usual, **choice}.items()}
        page.update()
        said: dict[str, Any] = json.loads(page._facts.data["json"][0])
        return said

    for _ in range(3):
        said = update()
    assert shown == ["gyro_x"]
    assert said["curves"]["spectrum"]
    history.write(fit_after(last, {"gyro_x": FRACTIONAL}))
    update()
    assert shown == ["gyro_x"], "a fit without curves leaves those that are drawn"
    history.write(fit_after(last, {"gyro_x": with_curves(FRACTIONAL, 2.0)}))
    update()
    update()
    assert shown == ["gyro_x", "gyro_x"]
    assert page._curves.density.data["density"][0] == curves(2.0)[0].density[0]
    said = update(axis="gyro_y")
    update()
    assert shown == ["gyro_x", "gyro_x", "gyro_y"]
    assert not said["curves"]["spectrum"] or said["axis"] != "gyro_y"
    assert len(page._curves.density.data["hz"]) == 0


def test_an_area_has_no_height_where_nothing_is_known_however_it_is_cut() -> None:
    nan = float("nan")
    low = np.array([nan, 1.0, nan, nan, 5.0, nan])
    high = np.array([nan, 3.0, nan, nan, 7.0, nan])
    for cut in range(7):
        first = closed(low[:cut], high[:cut])
        second = closed(low[cut:], high[cut:], first[2])
        assert np.nan_to_num([*first[0], *second[0]], nan=-1).tolist() == [-1, 1, 2, 2, 5, 6]
        assert np.nan_to_num([*first[1], *second[1]], nan=-1).tolist() == [-1, 3, 2, 2, 7, 6]


def test_an_interval_that_is_far_wider_does_not_flatten_what_is_shown() -> None:
    figures = Figures()
    columns = {name: [0.0, 1.0] for name in figures.estimates.column_names}
    figures.estimates.data = columns | {"f_low": [-1.0, -1.0], "f_high": [0.0, 0.0]}
    fits = {name: [0.0, 1.0] for name in figures.fits.column_names}
    figures.fits.data = fits | {"f_mid": [-0.5, -0.5], "f_low": [-40.0, -40.0], "f_high": [0.5, 0.5]}
    figures.fit()
    assert figures.f.y_range.start == pytest.approx(-2 - 0.25)
    assert figures.f.y_range.end == pytest.approx(0.5 + 0.25)
