"""What the page leads with, in a real browser: verdicts, curves, and files to take home."""

import time
from collections.abc import Iterator

import msgspec
import pytest
import yaml
from browser_support import Watched
from dashboard_support import records
from fit_support import FRACTIONAL, UNDECIDED, WHITE, fit_after, with_curves
from fltea.records.records import AnyRecord, Sample
from fltea.settings.outputs import DashboardConfig
from fltea.sinks.page.sink import DashboardSink
from playwright.sync_api import Browser

AXES = {
    "gyro_x": with_curves(FRACTIONAL),
    "gyro_y": with_curves(WHITE, 0.5),
    "gyro_z": with_curves(UNDECIDED, 2),
}
DENSITY = "Bokeh.documents[0].roots().find(p => p.name === 'spectrum').renderers[1].data_source.data"


@pytest.fixture
def sink() -> Iterator[DashboardSink]:
    made = DashboardSink(DashboardConfig(address=0), {"due": "host"}, lambda *a: None)
    now_ns = time.time_ns()
    last: Sample | None = None
    for record in records("n=1500"):
        made.write(as_of(record, now_ns - 15 * 10**9))
        if isinstance(record, Sample):
            last = record
    assert last is not None
    made.write(as_of(fit_after(last, AXES), now_ns - 15 * 10**9))
    yield made
    made.close()


def as_of(record: AnyRecord, begin_ns: int) -> AnyRecord:
    """The same of a device named due, at a later time."""
    host_ns = getattr(record, "host_ns", 0) + begin_ns
    return msgspec.structs.replace(record, device="due", host_ns=host_ns)


def test_the_answer_leads_and_no_figure_is_large_that_the_data_do_not_support(
    sink: DashboardSink, chromium: Browser
) -> None:
    one = Watched(chromium, sink.url)
    one.wait("document.querySelectorAll('.card .head').length === 3")
    cards = {axis: one.page.locator(f"[data-axis={axis}]") for axis in AXES}
    assert cards["gyro_x"].locator(".head").inner_text() == "Fractional"
    assert cards["gyro_x"].locator(".big").all_inner_texts() == ["0.80", "−1.0"]
    assert cards["gyro_x"].locator(".interval").all_inner_texts() == ["0.76 … 0.85", "−1.3 … −0.8 s−α"]
    assert "α ± 0.05: reached" in cards["gyro_x"].inner_text()
    assert cards["gyro_y"].locator(".head").inner_text() == "White noise: order undefined"
    assert cards["gyro_y"].locator(".big").count() == 0
    assert cards["gyro_y"].locator(".undefined").all_inner_texts() == ["undefined", "undefined"]
    assert not any(character.isdigit() for character in cards["gyro_y"].locator(".order").inner_text())
    assert cards["gyro_z"].locator(".big").all_inner_texts() == ["0.66"]
    assert "if the noise is of fractional order" in cards["gyro_z"].inner_text()
    assert "Left out: 11.4 to 12.7 Hz" in cards["gyro_z"].inner_text()
    everything = one.page.inner_text("body")
    for fit in AXES.values():
        assert everything.count(fit.text) == 1, "each sentence stands once"
    assert "white noise gives" not in everything
    tops = one.page.evaluate(
        "['.card .head', '.card .order', '#spectrum', '#allan', '.tables'].map("
        "place => document.querySelector(place).getBoundingClientRect().top)"
    )
    assert tops == sorted(tops), "the answer, then its curves, then the rest"
    assert one.complaints == []


@pytest.mark.slow
def test_curves_of_the_chosen_axis_are_drawn_with_the_coefficients(
    sink: DashboardSink, chromium: Browser
) -> None:
    one = Watched(chromium, sink.url)
    for axis, fit in AXES.items():
        one.page.click(f"[data-axis={axis}] .pick")
        one.wait(f"Math.abs({DENSITY}.density[3] / {fit.spectrum.density[3]} - 1) < 1e-9")
        shown = one.page.evaluate(f"[...{DENSITY}.model]")
        assert shown == fit.spectrum.model
    one.wait("document.querySelector('#spectrum .axis').textContent === 'gyro_z'")
    assert one.page.is_visible("#allan canvas, #allan .drawn")
    assert one.page.inner_text("#coefficients").startswith("N, angle random walk")
    assert "deg/√h" in one.page.inner_text("#coefficients")
    assert not one.page.is_visible("#spectrum .not-drawn")
    assert one.complaints == []


@pytest.mark.slow
def test_report_and_yaml_are_downloaded_and_the_report_shows_its_figures_by_itself(
    sink: DashboardSink, chromium: Browser
) -> None:
    one = Watched(chromium, sink.url)
    one.wait("!document.querySelector('#report').disabled")
    with one.page.expect_download() as asked:
        one.page.get_by_role("button", name="Download report").click()
    assert asked.value.suggested_filename.endswith(".html")
    with one.page.expect_download() as asked_yaml:
        one.page.get_by_role("button", name="Download imu.yaml").click()
    assert asked_yaml.value.suggested_filename.endswith("_imu.yaml")
    found = yaml.safe_load(asked_yaml.value.path().read_text())
    assert found["gyroscope_noise_density"] == pytest.approx(7.679e-5, rel=1e-3)
    assert not one.page.is_visible("#problem")
    assert one.complaints == []
    path = asked.value.path().with_suffix(".html")
    path.write_bytes(asked.value.path().read_bytes())
    sink.close()
    report = Watched(chromium, path.as_uri())
    report.wait("[...document.querySelectorAll('.plot')].filter(p => p.clientHeight > 200).length === 6")
    assert "Noise of fractional order" in report.page.inner_text("body")
    assert report.requests == [path.as_uri()], "complete in itself"
    assert report.complaints == []


@pytest.mark.slow
def test_a_button_whose_daemon_is_gone_says_so(sink: DashboardSink, chromium: Browser) -> None:
    one = Watched(chromium, sink.url)
    one.wait("!document.querySelector('#report').disabled")
    one.page.route("**/report.html*", lambda route: route.abort())
    one.page.get_by_role("button", name="Download report").click()
    one.page.wait_for_selector("#problem", state="visible")
    assert one.page.inner_text("#problem") == "The daemon does not answer."


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_on_a_phone_all_fits_and_can_be_read(sink: DashboardSink, chromium: Browser, scheme: str) -> None:
    one = Watched(chromium, sink.url, viewport={"width": 390, "height": 844}, color_scheme=scheme)
    one.wait("document.querySelectorAll('.card .head').length === 3")
    one.wait("!document.querySelector('#spectrum .drawn').hidden")
    rights = one.page.evaluate(
        "[document.documentElement.scrollWidth,"
        " ...[...document.querySelectorAll('figure, .card, #actions > *')]"
        ".filter(one => one.checkVisibility()).map(one => one.getBoundingClientRect().right)]"
    )
    assert max(rights) <= 390, rights
    shown = "[...document.querySelectorAll('figure, .card')].filter(one => one.checkVisibility())"
    lefts = one.page.evaluate(f"{shown}.map(one => one.getBoundingClientRect().left)")
    assert len(set(lefts)) == 1, "one column"
    assert min(one.page.evaluate(CONTRAST)) >= 4.5
    assert one.complaints == []


CONTRAST = """
(() => {
  const linear = v => (v /= 255) <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4
  const light = colour => colour.match(/[\\d.]+/g).slice(0, 3).map(Number).map(linear)
    .reduce((sum, v, i) => sum + v * [0.2126, 0.7152, 0.0722][i], 0)
  const card = light(getComputedStyle(document.querySelector(".card")).backgroundColor)
  const places = ".card p, .card dd, .card .big, .card .interval, .pick, figcaption p"
  return [...document.querySelectorAll(places)].map(one => {
    const l = light(getComputedStyle(one).color)
    return (Math.max(l, card) + 0.05) / (Math.min(l, card) + 0.05)
  })
})()
"""
