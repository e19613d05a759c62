"""The figures draw what records and fits say, and a page is sent only what is new."""

import math
from typing import Any

import numpy as np
import pytest
from dashboard_support import Browser, records, told
from fit_support import FRACTIONAL, UNDECIDED, WHITE, curves, fit_after, with_curves
from fltea.records.records import Estimate, Sample
from fltea.sinks.page.curve_figures import CurveFigures
from fltea.sinks.page.figures import Figures
from fltea.sinks.page.history import DeviceHistory
from fltea.sinks.page.page import closed
from fltea.sinks.page.tiers import WINDOWS
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


def test_the_heading_is_drawn_by_the_time_after_a_rest() -> None:
    figures = CurveFigures()
    figures.show_heading({1: 0.02, 60: 0.25})
    drawn = figures.forecast.data
    assert drawn == {"t_s": [1, 60], "std": [0.02, 0.25]}
    assert figures.heading.y_range.start < 0.02 < 0.25 < figures.heading.y_range.end
    figures.show_heading({1: 0.02, 60: 0.25})
    assert figures.forecast.data is drawn, "what is drawn is not sent again"
    figures.show_heading({})
    assert figures.forecast.data == {"t_s": [], "std": []}


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
    browser = Browser(history)
    update, density = browser.update, browser.page._curves.density
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
    assert density.data["density"][0] == curves(2.0)[0].density[0]
    said = update(axis="gyro_y")
    update()
    assert shown == ["gyro_x", "gyro_x", "gyro_y"]
    assert not said["curves"]["spectrum"] or said["axis"] != "gyro_y"
    assert len(density.data["hz"]) == 0


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


# --- what a page sends ---


@pytest.fixture(scope="module")
def browser() -> Browser:
    return Browser(told(records("n=400")), DeviceHistory("other", "host"))


def test_figures_hold_the_estimates_and_only_the_new_ones_are_sent() -> None:
    found = records("n=400")
    history = told(found[:-1])
    browser = Browser(history)
    told_first = browser.update()
    rows = browser.page._figures.estimates
    last = next(r for r in reversed(found) if isinstance(r, Estimate))
    browser.choose(window=0)
    told_now = browser.update()
    assert told_first["seq"] == told_now["seq"] == last.seq
    x = last.axes["gyro_x"].fltea
    assert (rows.data["alpha"][-1], rows.data["f"][-1]) == (x.alpha, x.f)
    assert rows.data["alpha_high"][-1] == x.alpha + x.alpha_std
    assert rows.data["alpha_low"][-1] == x.alpha - x.alpha_std
    before = len(rows.data["alpha"])
    history.write(replace(found[-3], seq=last.seq + 1))
    history.write(replace(found[-3], seq=last.seq + 2))
    browser.update()
    assert len(rows.data["alpha"]) == before + 1


def test_source_of_a_page_does_not_outgrow_its_window() -> None:
    found = records("n=3400")
    history = told(found[:200])
    browser = Browser(history)
    browser.choose(window=0)
    for k in range(200, len(found), 100):
        for record in found[k : k + 100]:
            history.write(record)
        browser.update()
    assert len(browser.page._figures.estimates.data["alpha"]) == 30 * 100 + 2


def test_choices(browser: Browser) -> None:
    assert browser.update()["axis"] == "gyro_x"
    said = browser.update(axis="gyro_z", window=2)
    assert (said["axis"], said["window"]) == ("gyro_z", 2)
    assert browser.update(device="other")["device"] == "other"
    assert browser.update(device="due", axis="gyro_y")["axis"] == "gyro_y"


@pytest.mark.parametrize(
    "data",
    [
        {"axis": ["gyro_q"]},
        {"axis": [3]},
        {"axis": [None]},
        {"device": [["due"]]},
        {"device": ["<script>"]},
        {"window": [len(WINDOWS)]},
        {"window": [-1]},
        {"window": ["0"]},
        {"ack": ["x"]},
        {"ack": [None]},
        {},
        {"device": []},
        {"device": ["due"], "axis": "gyro_x"},
        {"ack": [1, 2]},
    ],
)
def test_choices_that_make_no_sense_change_nothing(browser: Browser, data: dict[str, Any]) -> None:
    before = browser.update()
    browser.page._on_control("data", None, data)
    after = browser.update()
    for name in ("device", "axis", "window", "axes"):
        assert after[name] == before[name]
