"""Tests of how the live page looks in a real browser. All tests share a server with invented records."""

import re
import time
from collections.abc import Iterator

import msgspec
import pytest
import yaml
from fltea.records.records import AnyRecord, Hello, Sample, Stats
from fltea.settings.outputs import DashboardConfig
from fltea.sinks.page.sink import DashboardSink
from msgspec.structs import replace
from playwright.sync_api import Browser, expect

from tests.rig.browser_support import Watched
from tests.rig.dashboard_support import both, records
from tests.rig.example_records import MOVES, RESTS, STEP
from tests.rig.fit_support import FRACTIONAL, UNDECIDED, WHITE, fit_after, with_curves

FITS = {
    "gyro_x": with_curves(FRACTIONAL),
    "gyro_y": with_curves(WHITE, 0.5),
    "gyro_z": with_curves(UNDECIDED, 2),
}
DOWN = replace(STEP, size=-0.043)
HOSTILE = "<img src=x onerror=document.title='owned'>"
SIZES = [(1280, "light"), (1280, "dark"), (390, "light"), (390, "dark")]


@pytest.fixture(scope="module")
def sink() -> Iterator[DashboardSink]:
    """Serve two devices: one with known noise, and one that computes estimates itself and whose clock is
    slow.
    """
    made = DashboardSink(
        DashboardConfig(address=0, visitors=200), {"due": "host", "own": "both"}, lambda *a: None
    )
    begin_ns = time.time_ns() - 15 * 10**9
    last: Sample | None = None
    for record in records("n=1500"):
        made.write(as_of(record, begin_ns))
        last = record if isinstance(record, Sample) else last
    assert last is not None
    made.write(as_of(fit_after(last, FITS), begin_ns))
    for record in (STEP, replace(DOWN, host_ns=11 * 10**9), MOVES, RESTS, replace(MOVES, host_ns=13 * 10**9)):
        made.write(as_of(record, begin_ns))
    for record in both(records("n=1500")):
        made.write(as_of(record, begin_ns, "own"))
    yield made
    made.close()


def as_of(record: AnyRecord, begin_ns: int, device: str = "due") -> AnyRecord:
    """Return the same record for another device, at a later time."""
    changes: dict[str, object] = {"device": device, "host_ns": getattr(record, "host_ns", 0) + begin_ns}
    if device == "own":
        changes |= {"clock_ppm": -380_000.0} if isinstance(record, Stats) else {}
        changes |= {"sensor": HOSTILE} if isinstance(record, Hello) else {}
    return msgspec.structs.replace(record, **changes)


@pytest.fixture(scope="module")
def seen(sink: DashboardSink, chromium: Browser) -> Iterator[Watched]:
    """Return a browser page that all tests share and leave open.

    Each test leaves it as it was, with nothing expanded.
    """
    one = Watched(chromium, sink.url)
    one.wait("document.querySelectorAll('.axis').length === 3")
    yield one
    assert one.complaints == []
    assert {url.split("/")[2] for url in one.requests} == {sink.url.split("/")[2]}, "nothing from elsewhere"


def details(one: Watched, axis: str) -> None:
    one.page.get_by_role("button", name=f"details of {axis}").click()


def test_each_axis_is_a_sentence_and_nothing_else_is_open(seen: Watched) -> None:
    axes = [text.replace("\n", " ") for text in seen.page.locator(".axis p").all_inner_texts()]
    assert axes[0].startswith("Fractional: α = 0.80 (0.76 … 0.85), f = −1.0 (−1.3 … −0.8) s^−α; N = 0.13")
    assert axes[0].endswith(" deg/s; α ± 0.05: reached.")
    assert axes[1].startswith("White noise: N = 0.06")
    assert axes[2].startswith("Undecided: α = 0.66 (0.41 … 0.97), f between −6.0 and 0.4 s^−α, if the noise")
    assert not seen.page.is_visible("#open")
    assert seen.page.locator("details[open]").count() == 0
    assert seen.page.inner_text("main").count("α =") == 2, "one α an axis"
    assert seen.page.inner_text("#health") == "nothing is lost"


def test_each_axis_is_drawn_without_being_opened(seen: Watched) -> None:
    """The overview shows each axis: the last minutes with the bias, and the spectrum with the model."""
    for axis in FITS:
        card = f".axis[data-axis={axis}]"
        seen.wait(f"document.querySelectorAll('{card} .rate svg polyline').length >= 2")
        assert seen.page.locator(f"{card} .rate svg polygon.state").count() >= 1, "the band of the bias"
        expect(seen.page.locator(f"{card} .spectrum svg polyline")).to_have_count(2)
        boxes = [seen.page.locator(f"{card} {of} svg").bounding_box() for of in (".rate", ".spectrum")]
        assert all(box["width"] > 400 and box["height"] > 100 for box in boxes)
        assert boxes[0]["x"] + boxes[0]["width"] <= boxes[1]["x"], "side by side"


@pytest.mark.slow
def test_a_phone_has_the_first_drawing_alone(sink: DashboardSink, chromium: Browser) -> None:
    one = Watched(chromium, sink.url, viewport={"width": 390, "height": 844})
    one.wait("document.querySelectorAll('.rate svg polyline').length >= 6")
    assert not any(one.page.locator(".spectrum").nth(k).is_visible() for k in range(3))
    assert not any("spectra" in url for url in one.requests), "nor does it ask for the others"
    one.page.set_viewport_size({"width": 1000, "height": 844})
    one.wait("document.querySelectorAll('.spectrum svg').length === 3")
    one.page.context.close()


def test_details_stand_below_their_axis_with_its_curves_in_their_ranges(seen: Watched) -> None:
    for axis, fit in FITS.items():
        details(seen, axis)
        expect(seen.page.locator("#text")).to_contain_text(fit.text)
        seen.wait("document.querySelectorAll('#curves svg').length >= 2")
        above, below = (
            seen.page.locator(f"[data-axis={axis}]").bounding_box(),
            seen.page.locator("#open").bounding_box(),
        )
        assert 0 <= below["y"] - above["y"] - above["height"] < 20
        for figure in seen.page.locator("#curves figure").all()[:2]:
            box = figure.bounding_box()
            assert box["width"] > 200
            assert box["height"] > 120
        assert "deg/√h" in seen.page.inner_text("#coefficients")
    assert seen.page.locator("#curves rect[fill=currentColor]").count() == 2, "bands that were left out"
    expect(seen.page.locator("#text")).to_contain_text("Left out: 11.4 to 12.7 Hz")
    details(seen, "gyro_z")
    expect(seen.page.locator("#open")).to_be_hidden()


def test_over_time_is_drawn_where_somebody_looks(seen: Watched) -> None:
    details(seen, "gyro_x")
    seen.page.click("#course summary")
    points = (
        "[...document.querySelectorAll('#courses figure[data-name=%s] polyline')].map(l => l.points.length)"
    )
    seen.page.click("#windows button:nth-child(1)")
    seen.wait(f"({points % 'alpha'}).some(n => n > 100)")
    assert "course=true" in seen.page.url
    assert "window=0" in seen.page.url
    drawn = [
        one.get_attribute("data-name") for one in seen.page.locator("#courses figure:not([hidden])").all()
    ]
    assert drawn == ["noise", "alpha", "f", "lag1", "nis"]
    left, right = (
        seen.page.evaluate(
            f"Math.{end}(...[...document.querySelector('[data-name=noise] polyline').points].map(p => p.x))"
        )
        for end in ("min", "max")
    )
    width = seen.page.locator("[data-name=noise] svg").bounding_box()["width"]
    assert width / 3 < left < right <= width, "the last 15 of 30 s"
    seen.page.click("#running summary")
    assert "α, 95 %" in seen.page.inner_text("#rows")
    seen.page.click("#running summary")
    seen.page.click("#course summary")
    details(seen, "gyro_x")


def test_steps_and_motions_are_marked_on_the_course_and_said(seen: Watched) -> None:
    details(seen, "gyro_x")
    changes = seen.page.locator("#text .change")
    expect(changes).to_have_count(3)
    moves, down, up = changes.all_inner_texts()
    time_of = r"\d\d:\d\d:\d\d"
    assert re.fullmatch(rf"The sensor moves since {time_of} \(shown by accel\)\.", moves)
    assert re.fullmatch(rf"Step of \u22120\.043 ± 0\.022 deg/s at {time_of}\.", down)
    assert re.fullmatch(rf"Step of \+0\.104 ± 0\.022 deg/s at {time_of}\.", up)
    seen.page.click("#course summary")
    seen.page.click("#windows button:nth-child(1)")
    seen.wait("document.querySelectorAll('[data-name=noise] line.mark').length === 2")
    boxes = {
        what: seen.page.evaluate(
            f"[...document.querySelectorAll('[data-name=noise] svg {what}')]"
            ".map(one => (({left, right}) => [left, right])(one.getBoundingClientRect()))"
        )
        for what in ("line.mark", "rect.motion", "polyline.sample")
    }
    (first, _), (second, _) = boxes["line.mark"]
    end = max(right for _, right in boxes["polyline.sample"])
    second_px = (second - first) / 4
    (left, right), (lasts, to_now) = boxes["rect.motion"]
    assert end - second == pytest.approx(4 * second_px, abs=second_px / 2), "of 15 s the 11th"
    assert (left - first, right - left) == pytest.approx((second_px, 2 * second_px), abs=second_px / 5)
    assert (lasts - right, to_now - lasts) == pytest.approx((3 * second_px, 2 * second_px), abs=second_px / 2)
    labels = seen.page.locator("[data-name=noise] text.marked").all_text_contents()
    assert labels == ["+0.10", "\u22120.043"]
    assert seen.page.locator("#courses rect.motion").count() == 2, "in the figure of the bias alone"
    details(seen, "gyro_y")
    expect(changes).to_have_count(1)
    seen.wait("document.querySelectorAll('[data-name=noise] line.mark').length === 0")
    seen.page.click("#course summary")
    details(seen, "gyro_y")


def test_a_device_that_estimates_too_stands_beside_and_its_slow_clock_is_said(
    sink: DashboardSink, chromium: Browser
) -> None:
    one = Watched(chromium, sink.url + "#device=own&axis=gyro_y&course=true&window=0")
    expect(one.page.locator("#slow")).to_contain_text("runs at 0.62 times this computer's")
    one.wait("document.querySelector('[data-name=apart] polyline')")
    one.page.click("#running summary")
    expect(one.page.locator("#rows")).to_contain_text("α, device − host")
    assert "now, at most 1.0e-7" in one.page.inner_text("#rows")
    assert one.page.locator("[data-name=alpha] polyline.ink").count() == 1
    one.page.click("[data-parts='hardware,own'] summary")
    expect(one.page.locator("#own")).to_contain_text("skipped samples")
    assert HOSTILE in one.page.inner_text("#hardware"), "text of a device is text"
    assert one.page.locator("img").count() == 0
    assert one.page.title() == "fltea own"
    one.page.click("#devices button:nth-child(1)")
    expect(one.page.locator("#slow")).to_be_hidden()
    expect(one.page.locator("#open")).to_be_hidden()
    assert one.complaints == []


@pytest.mark.slow
@pytest.mark.parametrize(("width", "scheme"), SIZES)
def test_nobody_is_left_out(sink: DashboardSink, chromium: Browser, width: int, scheme: str) -> None:
    """axe-core finds no violation, nothing is wider than the screen, and the page is short on a phone."""
    one = Watched(chromium, sink.url, viewport={"width": width, "height": 844}, color_scheme=scheme)
    one.wait("document.querySelectorAll('.axis').length === 3")
    assert one.page.evaluate("document.documentElement.scrollHeight") < (1450 if width < 600 else 1150)
    assert one.violations() == []
    details(one, "gyro_x")
    one.page.click("#course summary")
    for summary in one.page.locator("main > details > summary, #running > summary").all():
        summary.click()
    one.wait("document.querySelector('#courses polyline') && document.querySelector('#curves svg')")
    one.wait("document.querySelector('#events li') && document.querySelector('#link dd')")
    assert one.violations() == []
    assert one.page.evaluate("document.documentElement.scrollWidth") <= width
    assert one.complaints == []


@pytest.mark.slow
def test_a_keyboard_is_enough(sink: DashboardSink, chromium: Browser) -> None:
    one = Watched(chromium, sink.url)
    one.wait("document.querySelectorAll('.axis').length === 3")
    one.wait("!document.querySelector('#report').hidden")
    reached = []
    for _ in range(20):
        one.page.keyboard.press("Tab")
        focus = "document.activeElement"
        reached.append(one.page.evaluate(f"{focus}.getAttribute('aria-label') ?? {focus}.textContent.trim()"))
        if reached[-1] == "details of gyro_z" and reached.count(reached[-1]) == 1:
            one.page.keyboard.press("Enter")
            expect(one.page.locator("#open")).to_be_visible()
    names = " ".join(reached)
    for name in (
        "own",
        "theme",
        "details of gyro_x",
        "over time",
        "Download report",
        "what happened",
        "link",
    ):
        assert name in names, reached
    assert one.page.get_attribute("[data-axis=gyro_z] button", "aria-expanded") == "true"


@pytest.mark.slow
def test_the_theme_is_the_systems_or_the_one_chosen(sink: DashboardSink, chromium: Browser) -> None:
    ground = "getComputedStyle(document.body).backgroundColor"
    light, dark = (Watched(chromium, sink.url, color_scheme=scheme) for scheme in ("light", "dark"))
    colours = [one.page.evaluate(ground) for one in (light, dark)]
    assert colours[0] != colours[1]
    light.page.click("#theme")  # changes the theme from "system" to "light"
    light.page.click("#theme")  # changes the theme from "light" to "dark"
    assert light.page.evaluate(ground) == colours[1]
    light.page.reload()
    light.wait("document.querySelectorAll('.axis').length === 3")
    assert light.page.evaluate(ground) == colours[1], "the choice is remembered"


@pytest.mark.slow
def test_report_and_yaml_are_downloaded_and_the_report_is_complete_in_itself(
    seen: Watched, chromium: Browser
) -> None:
    seen.wait("!document.querySelector('#report').hidden")
    with seen.page.expect_download() as asked:
        seen.page.get_by_role("link", name="Download report").click()
    assert asked.value.suggested_filename.endswith(".html")
    with seen.page.expect_download() as asked_yaml:
        seen.page.get_by_role("link", name="Download imu.yaml").click()
    found = yaml.safe_load(asked_yaml.value.path().read_text())
    assert found["gyroscope_noise_density"] == pytest.approx(7.679e-5, rel=1e-3)
    path = asked.value.path().with_suffix(".html")
    path.write_bytes(asked.value.path().read_bytes())
    report = Watched(chromium, path.as_uri(), viewport={"width": 390, "height": 844})
    heights = report.page.evaluate("[...document.querySelectorAll('svg')].map(s => s.clientHeight)")
    assert len(heights) == 6
    assert min(heights) > 150
    assert "Noise of fractional order" in report.page.inner_text("body")
    assert report.violations() == []
    assert report.page.evaluate("document.documentElement.scrollWidth") <= 390
    assert report.requests == [path.as_uri()]
    assert report.complaints == []


@pytest.mark.slow
def test_a_button_whose_daemon_is_gone_says_so_and_all_is_grey(
    sink: DashboardSink, chromium: Browser
) -> None:
    one = Watched(chromium, sink.url)
    one.wait("document.querySelectorAll('.axis').length === 3")
    assert not one.page.is_visible("#gone")
    one.page.route("**/state*", lambda route: route.abort())
    one.page.wait_for_selector("#gone", state="visible")
    assert "All below is as of " in one.page.inner_text("#gone")
    assert one.page.evaluate("getComputedStyle(document.querySelector('main')).filter") == "grayscale(1)"
    one.page.unroute("**/state*")
    one.page.wait_for_selector("#gone", state="hidden")
    assert one.page.evaluate("getComputedStyle(document.querySelector('main')).filter") == "none"
