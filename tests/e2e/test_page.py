"""The live page in a real browser: Chromium as Debian ships it, the real command, the stand-in device."""

import re
from pathlib import Path

import pytest
from browser_support import SEQ, Watched
from host_support import QUICK, Daemon, Processes, wait_until
from playwright.sync_api import Browser, Page

COLUMNS = """([source, ...names]) => {
  const found = Bokeh.documents[0].roots().flatMap(plot => plot.renderers).find(
    renderer => source in renderer.data_source.data)
  return Object.fromEntries(names.map(name => [name, Array.from(found.data_source.data[name])]))
}"""

INK = """Bokeh.documents[0].roots().flatMap(plot => plot.renderers)
  .filter(renderer => renderer.name === "of the device").map(renderer => renderer.glyph.line_color.value)"""


def start(processes: Processes, *arguments: str | Path, page: str = "0") -> tuple[Daemon, str]:
    """The daemon and the address of its page."""
    settings = [] if "--estimate-on" in arguments else QUICK
    daemon = processes.daemon(*settings, *arguments, "--dashboard", page)
    daemon.wait_for(lambda: "\n" in daemon.stderr, "the address")
    found = re.search(r"http://127\.0\.0\.1:\d+/", daemon.stderr)
    return daemon, found[0]


def columns(page: Page, *names: str) -> dict[str, list[float]]:
    """Columns of the source that has the first of them."""
    found: dict[str, list[float]] = page.evaluate(COLUMNS, [names[0], *names])
    return found


def test_figures_fill_and_their_values_are_those_of_the_ndjson(
    processes: Processes, chromium: Browser, tmp_path: Path
) -> None:
    processes.stand_in(tmp_path / "due", "--noise", "alpha=0.5&f=-1&seed=7&offset_dps=1.5")
    daemon, url = start(processes, "--source", f"serial:{tmp_path / 'due'}")
    one = Watched(chromium, url + "#window=0&axis=gyro_y")
    one.wait_for_seq(350)  # the axes are known with the first statistics, a second after the start at most
    one.wait("document.querySelector('figure .axis').textContent === 'gyro_y'")
    shown = columns(one.page, "alpha_low", "seq", "alpha", "alpha_high", "f", "f_low", "f_high", "state")
    noise = columns(one.page, "y", "y")["y"][-150:]
    card = one.page.locator("[data-axis=gyro_y]")
    card.locator("summary").click()
    words = card.inner_text()
    device = one.page.inner_text("#hardware")
    choice_of_device = one.page.is_visible("#devices")
    of_device = [
        place.is_visible() for place in one.page.locator(".of-both, .of-device, #own-part, .why-not").all()
    ]
    code, stderr = daemon.end()
    assert code == 0, stderr
    estimates = {e["seq"]: e["axes"]["gyro_y"] for e in daemon.of("estimate")}
    compared = 0
    for i, seq in enumerate(shown["seq"]):
        if seq in estimates:
            e = estimates[int(seq)]["fltea"]
            compared += 1
            assert (shown["alpha"][i], shown["f"][i]) == (e["alpha"], e["f"])
            assert shown["alpha_low"][i] == e["alpha"] - e["alpha_std"]
            assert shown["f_high"][i] == e["f"] + e["f_std"]
    assert compared >= 190
    assert max(map(abs, noise)) < 1.4, "the offset of 1.5 deg/s is removed"
    assert re.search(r"-?\d\.\d+ ± \d\.\d+", words)
    assert "s^-α" in words
    assert card.locator(".head").inner_text() != ""
    assert not choice_of_device, "there is but one"
    assert not any(of_device), "the device does not estimate"
    assert "MPU-9250" in device
    assert "stand-in" in device
    origin = url.removeprefix("http://").rstrip("/")
    assert {request.split("/")[2] for request in one.requests} == {origin}, "nothing comes from elsewhere"
    assert one.complaints == []


@pytest.mark.slow
def test_estimates_of_device_and_host_stand_side_by_side(
    processes: Processes, chromium: Browser, tmp_path: Path
) -> None:
    """At 100 Hz its start-up window takes five seconds; a faster device soon fills the pty."""
    processes.stand_in(tmp_path / "due", "--estimate")
    daemon, url = start(processes, "--source", f"serial:{tmp_path / 'due'}", "--estimate-on", "both")
    one = Watched(chromium, url + "#window=0&axis=gyro_y")
    one.wait("Number(document.querySelector('[data-axis=gyro_y]')?.dataset.apart || 0) !== 0")
    one.wait("document.querySelector('#windows button').getAttribute('aria-pressed') === 'true'")
    one.wait("document.querySelector('#apart .axis').textContent === 'gyro_y'")
    one.wait("document.querySelector('#apart .apart').textContent.startsWith('device')")
    wait_until(lambda: len(columns(one.page, "apart", "time")["time"]) >= 50, "rows of both on the page")
    shown = columns(one.page, "apart", "time", "alpha", "f", "apart_low", "apart_high")
    one.page.click("[data-axis=gyro_y] summary")
    card = one.page.inner_text("[data-axis=gyro_y]")
    far = one.page.inner_text("#apart")
    legend = one.page.inner_text("figure:has([data-of=alpha]):not(#apart) figcaption")
    beside = one.page.inner_text("figure:not(#apart) [data-of=alpha]")
    drawn = one.page.is_visible("#apart .drawn >> nth=1")
    own = one.page.inner_text("#own")
    ink = one.page.evaluate(INK)
    one.page.emulate_media(color_scheme="dark")
    one.wait(f"({INK})[0] !== '{ink[0]}'")
    code, stderr = daemon.end()
    assert (code, stderr.count("\n")) == (0, 1), "nothing but the address"
    expected = {e["host_ns"] * 1e-6: e["axes"]["gyro_y"] for e in daemon.of("device_estimate")}
    compared = 0
    for i, time_ms in enumerate(shown["time"]):
        if time_ms in expected:
            e = expected[time_ms]
            compared += 1
            assert (shown["alpha"][i], shown["f"][i]) == (e["alpha"], e["f"])
            assert (
                shown["apart_low"][i] == shown["apart"][i] == shown["apart_high"][i] == e["alpha_difference"]
            )
    assert compared >= 20
    number = r"[+-]\d\.\de-\d+"
    assert re.search(rf"device − host: {number} now, at most \d\.\de-\d+ of what is shown", beside)
    assert "state x̂, device − host" in card
    assert re.search(rf"device − host: {number} now, at most \d\.\de-\d+ of what is shown", far)
    assert "FLTEA, host" in legend
    assert "FLTEA, device" in legend
    assert "the device's own" not in legend
    assert "skipped samples" in own
    assert drawn
    assert len(set(ink)) == 1, "in both figures and that of the difference"
    assert one.complaints == []


@pytest.mark.slow
def test_status_tells_of_a_stall_a_restart_and_the_start_up(
    processes: Processes, chromium: Browser, tmp_path: Path
) -> None:
    port = tmp_path / "due"
    device = processes.stand_in(port)
    daemon, url = start(processes, "--source", f"serial:{port}", "--startup", "6000")
    one = Watched(chromium, url)
    status = "document.querySelector('#status').textContent"
    one.wait(f"/^start-up: \\d+ samples to go.*epoch 1/.test({status})")
    device.stop()
    one.wait(f"{status}.startsWith('stalled for')")
    assert one.page.get_attribute("#status", "data-level") == "bad"
    processes.stand_in(port)
    one.wait(f"/^start-up: \\d+ samples to go.*reconnected, epoch 2: the device restarted/.test({status})")
    events = one.page.inner_text("#events")
    assert "epoch 2 begins: the device restarted" in events
    assert "unplugged" in events
    assert one.page.evaluate("document.documentElement.dataset.epoch") == "2"
    daemon.end()


@pytest.mark.slow
def test_page_says_that_the_daemon_is_gone_and_comes_back_with_it(
    processes: Processes, chromium: Browser
) -> None:
    daemon, url = start(processes, "--source", "synthetic:?window=100")
    one = Watched(chromium, url + "#window=0&axis=gyro_z")
    one.wait_for_seq(100)
    assert not one.page.is_visible("#gone")
    assert daemon.end()[0] == 0
    one.page.wait_for_selector("#gone", state="visible")
    daemon, _ = start(processes, "--source", "synthetic:?window=100", page=url.rpartition(":")[2].rstrip("/"))
    one.page.wait_for_selector("#gone", state="hidden")
    one.wait_for_seq(100)
    one.wait("document.querySelector('figure .axis').textContent === 'gyro_z'")
    assert one.page.get_attribute("#windows button:nth-child(1)", "aria-pressed") == "true"
    daemon.end()


@pytest.mark.slow
def test_light_dark_and_choices(processes: Processes, chromium: Browser) -> None:
    daemon, url = start(
        processes, "--source", "synthetic:?window=100", "--source", "synthetic:?window=100&n=60&alpha=0.7"
    )
    ground = "getComputedStyle(document.body).backgroundColor"
    light = Watched(chromium, url, color_scheme="light")
    dark = Watched(chromium, url, color_scheme="dark")
    for one in (light, dark):
        one.wait_for_seq(100)
    colours = [one.page.evaluate(ground) for one in (light, dark)]
    assert colours[0] != colours[1]
    label = "Bokeh.documents[0].roots()[0].left[0].axis_label_text_color"
    assert light.page.evaluate(label) != dark.page.evaluate(label)
    light.page.click("#theme")  # system → light
    light.page.click("#theme")  # light → dark
    assert light.page.evaluate(ground) == colours[1]
    light.page.reload()
    light.wait_for_seq(100)
    assert light.page.evaluate(ground) == colours[1], "the choice is remembered"

    light.page.click("#devices button:nth-child(2)")
    light.wait("document.querySelector('#status').textContent.startsWith('at its end')")
    light.page.click("[data-axis=gyro_z] .pick")
    light.wait("document.querySelector('figure .axis').textContent === 'gyro_z'")
    light.page.click("#windows button:nth-child(3)")
    light.wait(
        "document.querySelector('#windows button:nth-child(3)').getAttribute('aria-pressed') === 'true'"
    )
    for one in (light, dark):
        assert one.complaints == []
    daemon.end()


@pytest.mark.slow
def test_text_of_a_device_is_shown_as_text(processes: Processes, chromium: Browser, tmp_path: Path) -> None:
    name = "<img src=x onerror=document.title='owned'>"
    recording = tmp_path / f"{name.replace('/', '')}.csv"
    lines = "\n".join(f"{k % 7 / 10},{k % 5 / 10},{k % 3 / 10}" for k in range(200))
    recording.write_text(f"gyro_x_dps,gyro_y_dps,gyro_z_dps\n{lines}\n")
    daemon, url = start(processes, "--source", f"replay:{recording}", "--rate", "100")
    one = Watched(chromium, url)
    one.wait_for_seq(150)
    assert "<img" in one.page.inner_text("#hardware")
    assert one.page.locator("img").count() == 0
    assert "owned" not in one.page.title()
    daemon.end()


@pytest.mark.slow
def test_record_button_records_what_can_be_replayed(
    processes: Processes, chromium: Browser, tmp_path: Path
) -> None:
    folder = tmp_path / "from the page"
    daemon, url = start(
        processes, "--source", "synthetic:?window=100&seed=1", "--set", f"dashboard.record_to={folder}"
    )
    one = Watched(chromium, url)
    one.wait_for_seq(100)
    text = "document.querySelector('#recording').textContent"
    one.wait(f"{text}.startsWith('Recordings go to {folder}')")
    one.page.get_by_role("button", name="Record", exact=True).click()
    one.wait(f"/^Recording to .*_000.mcap: [1-9].* so far/.test({text})")
    one.wait_for_seq(int(one.page.evaluate(SEQ)) + 150)
    one.page.get_by_role("button", name="Stop recording").click()
    one.wait(f"{text}.startsWith('Recorded ')")
    (path,) = folder.iterdir()
    assert path.name in one.page.inner_text("#recording")
    assert not one.page.is_visible("#problem")
    assert one.complaints == []
    code, stderr = daemon.end()
    assert (code, stderr.count("\n")) == (0, 1), "nothing but the address"
    replayed = processes.daemon(*QUICK, "--source", f"replay:{path}", "--once", "--samples")
    code, stderr = replayed.end(None)
    assert code == 0, stderr
    seqs = [r["seq"] for r in replayed.of("sample")]
    assert len(seqs) > 100
    assert seqs == list(range(seqs[0], seqs[0] + len(seqs)))


@pytest.mark.slow
def test_a_folder_that_cannot_be_written_to_is_said_on_the_page(
    processes: Processes, chromium: Browser, tmp_path: Path
) -> None:
    (tmp_path / "file").write_text("")
    daemon, url = start(
        processes, "--source", "synthetic:?window=100", "--set", f"dashboard.record_to={tmp_path / 'file'}"
    )
    one = Watched(chromium, url)
    one.wait_for_seq(100)
    one.page.get_by_role("button", name="Record", exact=True).click()
    one.page.wait_for_selector("#problem", state="visible")
    assert "the folder cannot be made" in one.page.inner_text("#problem")
    assert daemon.end()[0] == 0
