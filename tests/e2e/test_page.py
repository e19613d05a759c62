"""Tests of the live page with the real command and a simulated device, in a real browser."""

import re
import socket
from pathlib import Path

import pytest
from playwright.sync_api import Browser, expect

from tests.rig.browser_support import SEQ, Watched
from tests.rig.host_support import QUICK, Daemon, Processes, ask, port_of, wait_until

FEW_DESCRIPTORS = (
    "-c",
    "import resource; resource.setrlimit(resource.RLIMIT_NOFILE, (300, 300)); "
    "from fltea.cli.app import main; main()",
)


def start(
    processes: Processes, *arguments: str | Path, page: str = "0", program: tuple[str, ...] = ()
) -> tuple[Daemon, str]:
    """Start the daemon; return it, and the address of its live page."""
    daemon = processes.daemon(*QUICK, *arguments, "--dashboard", page, program=program)
    daemon.wait_for(lambda: "live page at" in daemon.stderr, "the address")
    found = re.search(r"http://127\.0\.0\.1:\d+/", daemon.stderr)
    assert found is not None
    return daemon, found[0]


def test_the_page_says_what_the_records_say(processes: Processes, chromium: Browser, tmp_path: Path) -> None:
    processes.stand_in(tmp_path / "due", "--noise", "alpha=0.5&f=-1&seed=7&offset_dps=1.5")
    daemon, url = start(processes, "--source", f"serial:{tmp_path / 'due'}")
    one = Watched(chromium, url)
    one.wait_for_seq(350)
    sentence = one.page.locator("[data-axis=gyro_y] p")
    expect(sentence).to_contain_text("bias 1.")
    one.page.click("[data-parts='hardware,own'] summary")
    expect(one.page.locator("#hardware")).to_contain_text("MPU-9250")
    assert one.page.is_hidden("#devices"), "there is but one"
    assert one.page.is_hidden("#own-part"), "the device does not estimate"
    said = sentence.inner_text()
    daemon.end_well()
    biases = {
        f"{e['axes']['gyro_y']['bias']:.2f}"[:3]
        for e in daemon.of("estimate")[-400:]
        if e["axes"]["gyro_y"]["bias"]
    }
    assert re.search(r"bias (\d\.\d)", said)[1] in biases
    assert "stand-in" in one.page.inner_text("#hardware"), "what was said stays"
    assert [text for text in one.complaints if "ERR_CONNECTION" not in text] == []


@pytest.mark.long
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
    assert "reconnects: 1" in one.page.inner_text("#health")
    one.page.click("[data-parts=events] summary")
    expect(one.page.locator("#events")).to_contain_text("epoch 2 begins: the device restarted")
    assert "unplugged" in one.page.inner_text("#events")
    daemon.end()


@pytest.mark.slow
def test_a_page_outlives_its_daemon_and_goes_on_with_the_next_one(
    processes: Processes, chromium: Browser, tmp_path: Path
) -> None:
    common = ("--source", f"serial:{tmp_path / 'due'}", "--state", tmp_path / "state")
    processes.stand_in(tmp_path / "due")
    daemon, url = start(processes, *common)
    one = Watched(chromium, url + "#window=0&axis=gyro_z&course=true")
    one.wait_for_seq(150)
    one.page.evaluate("window.isTheSame = true")
    daemon.end_well()
    one.page.wait_for_selector("#gone", state="visible")
    assert re.search(r"does not answer.* as of \d\d:\d\d:\d\d", one.page.inner_text("#gone"))
    daemon, _ = start(processes, *common, page=url.rpartition(":")[2].rstrip("/"))
    one.page.wait_for_selector("#gone", state="hidden")
    one.wait("document.querySelector('#status').textContent.includes('resumed from a snapshot')")
    one.wait("document.querySelectorAll('#courses polyline').length > 2")
    assert one.page.evaluate("window.isTheSame"), "it was not loaded again"
    assert one.page.get_attribute("#windows button:nth-child(1)", "aria-pressed") == "true"
    assert one.page.get_attribute("[data-axis=gyro_z] button", "aria-expanded") == "true"
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
    replayed.end_well(None)
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
    daemon.end_well()


@pytest.mark.long
def test_idle_connections_take_nothing_from_recording_and_state(processes: Processes, tmp_path: Path) -> None:
    """Idle connections must not exhaust the file descriptors of the program.

    In an earlier version, with a limit of 300 descriptors, 330 idle connections made the writing of
    recordings and of the saved state fail, with 55 MB of tracebacks.
    """
    processes.stand_in(tmp_path / "due")
    folder, state = tmp_path / "rec", tmp_path / "state"
    daemon, url = start(
        processes, "--source", f"serial:{tmp_path / 'due'}", "--record", folder, "--state", state,
        "--set", "state.period_s=0.5", "--rotate-s", "1", program=FEW_DESCRIPTORS,
    )  # fmt: skip
    idle = [socket.create_connection(("127.0.0.1", port_of(url))) for _ in range(330)]
    parts, age = len(list(folder.iterdir())), state.stat().st_mtime_ns if state.exists() else 0
    wait_until(lambda: len(list(folder.iterdir())) > parts + 1, "further parts of the recording")
    wait_until(lambda: state.exists() and state.stat().st_mtime_ns > age, "another snapshot")
    assert ask(port_of(url), "/state?parts=now:").status == 200
    for one in idle:
        one.close()
    stderr = daemon.end_well()
    assert len(stderr.splitlines()) <= 2, stderr
    assert {error["kind"] for error in daemon.of("error")} == {"too_many_connections"}
