"""Tests of the report: one page with its pictures, which needs no other file."""

import html
import re
import shutil
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from fltea.identification import figures, report
from fltea.identification.axis import IdentifyOptions, analyse, identified, with_copies
from fltea.identification.axis_report import AxisReport, FileReport
from fltea.identification.curves import LAGS, ORDERS, curves, profile
from fltea.identification.load import Request, Unreadable
from fltea.identification.run import identify_all
from fltea.identification.sensor_events import BiasCourse, BiasStep, MotionSpan
from fltea.identification.settings import Settings
from fltea.identification.shuffled import estimate
from fltea.identification.workers import Here
from fltea.records.errors import UsageError
from fltea.records.whole_file import prepare_folder
from fltea.spectrum.intervals import CRITICAL
from msgspec.structs import replace

from tests.rig.identify_files import QUICK, counts, npz
from tests.rig.identify_support import H, long_recursion, white
from tests.rig.toolchain import missing

CHROMIUM = shutil.which("chromium")
NAME = "<b>rest & more.npz"
SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[FileReport], list[Path]]:
    """Write the report of two recordings.

    One file is white noise of a gyroscope and an accelerometer. The other is no recording.
    """
    folder = tmp_path_factory.mktemp("report")
    path = npz(folder / NAME, counts(2000, 1), accel_raw=counts(2000, 3, seed=5), accel_lsb_per_g=16384.0)
    settings = Settings(IdentifyOptions(shuffles=5), QUICK, figures=True, forecast=True)
    requests = [
        Request((path,), ("gyro_x", "accel_z")),
        Unreadable("gone.mcap", UsageError("gone.mcap: <nothing> there.")),
    ]
    reports = identify_all(requests, settings, Here())
    prepare_folder("--report", folder / "out")
    return folder / "out", reports, report.write(folder / "out", reports)


def test_page_has_all_and_needs_nothing(made: tuple[Path, list[FileReport], list[Path]]) -> None:
    folder, reports, written = made
    page = (folder / report.PAGE).read_text()
    assert written[0] == folder / report.PAGE
    inline = re.findall(r"<figure>(<svg.*?</svg>)<figcaption>", page)
    assert sorted(inline) == sorted(path.read_text() for path in written[1:])
    kinds = [path.stem.split("_", 1)[1] for path in written[1:]]
    for axis in ("gyro_x", "accel_z"):
        assert sorted(kind.rpartition("_")[2] for kind in kinds if axis in kind) == sorted(figures.TITLES)
    assert len(kinds) == 2 * len(figures.TITLES)
    assert not re.search(r"<(link|script|iframe|img)|url\(|src=|href=", page)
    for axis_report in reports[0].axes.values():
        assert html.escape(axis_report.result.verdict.text) in page
        for rule in axis_report.result.verdict.rules:
            assert html.escape(rule.question) in page


def test_a_plain_install_writes_a_report_with_all_figures(tmp_path: Path) -> None:
    """The report is written although matplotlib cannot be imported."""
    path = npz(tmp_path / "rest.npz", counts(2000, 1))
    command = ["fltea", "identify", path, "--forecast", "--shuffles", 1, "--report", tmp_path / "out"]
    program = (
        "import sys; sys.modules['matplotlib'] = None; "
        f"sys.argv = {[str(word) for word in command]}; from fltea.cli.app import main; main()"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr.partition(":")[0]) == (0, "fltea"), done.stderr
    page = (tmp_path / "out" / report.PAGE).read_text()
    assert page.count("<svg") == len(figures.TITLES)
    assert len(list((tmp_path / "out").glob("*.svg"))) == len(figures.TITLES)


def test_text_of_others_is_text(made: tuple[Path, list[FileReport], list[Path]]) -> None:
    folder, _, written = made
    page = (folder / report.PAGE).read_text()
    assert "<b>rest" not in page
    assert "&lt;b&gt;rest &amp; more.npz" in page
    assert "gone.mcap: &lt;nothing&gt; there." in page
    assert all(re.fullmatch(r"[\w.-]+", path.name) for path in written)


def test_what_is_seen_is_the_answer_and_the_rest_is_folded(
    made: tuple[Path, list[FileReport], list[Path]],
) -> None:
    page = (made[0] / report.PAGE).read_text()
    assert "<details open" not in page
    seen = re.sub(r"<details>.*?</details>", "", page)
    for axis in ("gyro_x", "accel_z"):
        for kind, (title, _) in figures.TITLES.items():
            label = f'aria-label="{axis}: {html.escape(title)}"'
            if kind != "profile":
                assert (label in seen) == (kind in figures.SEEN), kind
                assert page.count(label) == 1, kind
    for text in ("<th>N [deg/√h]</th>", "<th>made of</th>"):
        assert text.replace("<th>N", '<th class="sub">N') in seen
    assert "null test p" not in seen
    assert "null test p" in page
    assert "σ of the heading after a rest of 20 s (purple)" in seen
    assert "and after its first half, 10 s (blue)" in seen


@pytest.mark.parametrize(
    ("rest_s", "said", "half"),
    [
        (200, "200 s", "100 s"),
        (300, "300 s", "150 s"),
        (3600, "60 min", "30 min"),
        (86_400, "24 h", "12 h"),
        (9000, "2.5 h", "75 min"),
    ],
)
def test_the_heading_says_after_how_long_a_rest(
    made: tuple[Path, list[FileReport], list[Path]], rest_s: float, said: str, half: str
) -> None:
    axis = made[1][0].axes["gyro_x"]
    assert isinstance(axis, AxisReport)
    assert axis.forecast is not None
    assert axis.forecast.after_s == 20
    text = figures.meaning("forecast", replace(axis, forecast=replace(axis.forecast, after_s=rest_s)))
    assert f"after a rest of {said} (purple)" in text
    assert f"after its first half, {half} (blue)" in text
    assert "95 %" in text


def test_the_bias_is_shown_where_it_is_known_with_steps_and_motion(
    made: tuple[Path, list[FileReport], list[Path]],
) -> None:
    """The vertical axis of the picture shows the range that the bias has while its σ is small.

    Otherwise the first seconds, with their large σ, would determine this range.
    """
    axis = made[1][0].axes["gyro_x"]
    assert isinstance(axis, AxisReport)
    bias = np.array([40.0, -30.0, *([0.01, 0.02] * 20)])
    course = BiasCourse(np.arange(42.0), bias, np.array([50.0, 20.0, *[0.005] * 40]))
    steps = tuple(BiasStep(at_s, 0.1, 0.01) for at_s in (10.0, 20.0))
    motion = (MotionSpan(5.0, 7.0, "gyro_x", 10.0, "deg/s"),)
    drawn = figures.draw("gyro_x", replace(axis, course=course, bias_steps=steps, motion=motion))["bias"]
    words = [one.text for one in ElementTree.fromstring(drawn).iter(f"{SVG}text")]
    assert {"0.00", "0.01", "0.02", "0.03"} <= set(words)
    assert (words.count("step"), words.count("motion")) == (1, 1)
    assert drawn.count('stroke-dasharray="1 3"') == 3, "two steps, and their entry in the legend"


UNITS = {
    "spectrum": ("frequency [Hz]", "density [{unit}/√Hz]"),
    "profile": ("order α held at", "2 log L below the best with an order"),
    "alpha": ("time [s]", "order α"),
    "f": ("time [s]", "parameter f [s^−α]"),
    "allan": ("averaging time τ [s]", "deviation [{unit}]"),
    "bias": ("time [s]", "bias [{unit}]"),
    "forecast": ("time after rest [s]", "heading, σ [{angle}]"),
    "innovations": ("lag [samples]", "correlation of the innovations"),
}


def test_each_figure_is_a_chart_with_units_and_numbers(
    made: tuple[Path, list[FileReport], list[Path]],
) -> None:
    """Each picture has curves of several points, a legend, titles of its axes, and no NaN."""
    assert set(UNITS) == set(figures.TITLES)
    for path in made[2][1:]:
        text = path.read_text()
        assert not re.search(r"\b(nan|inf)\b", text, re.IGNORECASE), path.name
        root = ElementTree.fromstring(text)
        words = [one.text for one in root.iter(f"{SVG}text")]
        of = {"unit": "m/s²", "angle": "m/s"} if "accel" in path.stem else {"unit": "deg/s", "angle": "°"}
        for title in UNITS[path.stem.rpartition("_")[2]]:
            assert title.format(**of) in words, path.name
        places = {one for line in root.iter(f"{SVG}polyline") for one in line.attrib["points"].split()}
        assert len(places) > 8, path.name
        assert len(words) > 2 + 2 + 2 + 1, path.name


@pytest.mark.slow
def test_the_report_of_three_axes_of_a_long_recording_is_small(tmp_path: Path) -> None:
    path = npz(tmp_path / "long.npz", counts(60_000))
    settings = Settings(IdentifyOptions(shuffles=5), QUICK, figures=True, forecast=True)
    reports = identify_all([Request((path,))], settings, Here())
    assert len(reports[0].axes) == 3
    written = report.write(tmp_path, reports)
    assert len(written) == 1 + 3 * len(figures.TITLES)
    assert written[0].stat().st_size < 600_000


def test_each_innovation_is_a_bar_of_its_own(made: tuple[Path, list[FileReport], list[Path]]) -> None:
    text = next(path for path in made[2] if path.stem.endswith("gyro_x_innovations")).read_text()
    bars = [one.attrib["points"].split() for one in ElementTree.fromstring(text).iter(f"{SVG}polyline")]
    assert len(bars) == LAGS
    zero = {begin.partition(",")[2] for begin, _ in bars}
    assert len(zero) == 1
    assert all(begin.partition(",")[0] == end.partition(",")[0] for begin, end in bars)


def test_names_of_figures_do_not_meet() -> None:
    names = ["a/rest.npz", "b/rest.npz", "c/rest.csv", "d/…", "rest-2.npz"]
    found = report._prefixes([FileReport(name) for name in names])
    assert len(set(found)) == len(names)


def test_folder_that_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(UsageError, match="cannot be written to"):
        prepare_folder("--report", tmp_path / "file")


@pytest.mark.slow
def test_page_in_a_browser(made: tuple[Path, list[FileReport], list[Path]]) -> None:
    """On a phone, nothing is wider than the screen. Light and dark differ, all figures are shown, and nothing
    is fetched.
    """
    if CHROMIUM is None:
        missing("no Chromium: apt-get install chromium")
    from playwright.sync_api import sync_playwright

    colours = {}
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        for scheme in ("light", "dark"):
            page = browser.new_page(viewport={"width": 375, "height": 800}, color_scheme=scheme)
            asked: list[str] = []
            page.on("request", lambda request, asked=asked: asked.append(request.url))  # type: ignore[call-overload]
            page.goto((made[0] / report.PAGE).as_uri())
            assert page.evaluate("document.documentElement.scrollWidth") <= 375
            page.evaluate("document.querySelectorAll('details').forEach(one => one.open = true)")
            assert page.evaluate("document.documentElement.scrollWidth") <= 375
            widths = page.evaluate(
                "[...document.querySelectorAll('figure > svg')].map(one => one.getBoundingClientRect().width)"
            )
            assert len(widths) == 2 * len(figures.TITLES)
            assert min(widths) > 300
            assert [url for url in asked if not url.startswith(("data:", "file:"))] == []
            colours[scheme] = page.evaluate("getComputedStyle(document.body).backgroundColor")
        browser.close()
    assert colours["light"] != colours["dark"]


def test_curves_agree_with_the_result() -> None:
    """The curve of FLTEA's estimates over time ends at the result. The profile of the likelihood gives the
    same interval of the order as the result.
    """
    x = long_recursion(0.7, -0.12, 3000, 3) + 0.3 * white(3000, 1, 4)[0]
    options = IdentifyOptions(estimator=QUICK, shuffles=30)
    copies = estimate(x, H, QUICK, None, range(30), 0)
    analysis = analyse(x, H, options)
    result = with_copies(identified(analysis, None, options), [copies])
    found = curves(analysis, None, options)
    assert result.fltea.alpha is not None
    assert found.path.alpha[-1] == pytest.approx(result.fltea.alpha, abs=1e-3)
    assert found.path.t_s[-1] == pytest.approx(30)
    assert (np.diff(found.path.t_s) > 0).all()
    assert (np.diff(found.path.white_alpha, axis=1) >= 0).all()
    shuffled = result.null.shuffled
    assert found.path.white_alpha[-1, 1] == pytest.approx(shuffled.alpha[1], abs=0.1)
    assert found.deviance.min() >= 0
    assert found.spectrum.counts.sum() == len(x) // 2 - 4
    assert np.abs(found.autocorrelation).max() < 1


def test_curves_without_copies() -> None:
    options = IdentifyOptions(estimator=QUICK, shuffles=0)
    analysis = analyse(white(2000, 1, 1)[0], H, options)
    found = curves(analysis, None, options)
    assert np.isfinite(found.path.alpha).any()
    assert np.isnan(found.path.white_alpha).all()


def test_the_profile_has_the_interval_of_the_order() -> None:
    y = long_recursion(0.6, -0.19, 60_000, 0) + 0.5 * white(60_000, 1, 10)[0]
    analysis = analyse(y, H)
    alpha = analysis.verdict.order.alpha
    assert alpha.value is not None
    assert alpha.low is not None
    assert alpha.high is not None
    deviance = profile(analysis.summed.seen.evidence.candidates, ORDERS)
    assert np.interp(alpha.value, ORDERS, deviance) < 0.5
    for end in (alpha.low, alpha.high):
        assert np.interp(end, ORDERS, deviance) == pytest.approx(CRITICAL, abs=1.5)
