"""Faults of the daemon's outputs.

The output with the fault may lose records if it counts the lost records. No other output may lose any.
"""

import math
import re
import shutil
import socket
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from fltea.sources.mcap import find_session

from tools.faults.case import Case
from tools.faults.daemon import RECORDING, Scene, read_recording
from tools.faults.expected import SOME, Expected
from tools.faults.outcome import Outcome
from tools.faults.pages import Browser, connections, open_page_and_read_nothing
from tools.faults.program import Program, wait_until
from tools.faults.small_disk import WHERE_FULL, WHERE_LIMITED
from tools.faults.stage import Stage

PAGES = 3
MOST_MB = 10.0
"""Largest permitted growth of the daemon's memory [MB]. It is not 0, because a program still grows a little
after its start.
"""
PAGE = ("--dashboard", "127.0.0.1:0")


def broker_down(stage: Stage) -> Outcome:
    """Kill the broker, and start it again on the same port."""
    broker = stage.broker()
    settings = ("--mqtt", f"127.0.0.1:{broker.port}", "--set", "mqtt.estimate_every=1")
    scene = Scene(stage, *settings, *PAGE)
    scene.board.send_until(lambda: broker.received()["estimate"] > 50, "messages at the broker")
    with scene.fault(before=0) as board:
        board.send_during(broker.kill)
        scene.send_until_error("broker_lost")
        board.send(300 if stage.short else 6000)
        board.send_during(broker.start)
        scene.send_until_error("broker_back")
    scene.finish()
    program, received = scene.program, broker.received()
    sent = len(program.of("estimate")) + len(program.of("stats"))
    lost = program.of("stats")[-1]["outputs"]["mqtt"]["dropped"]
    arrived = received["estimate"] + received["stats"]
    figures = {"published": sent, "received by the broker": arrived, "counted lost": lost}
    uncounted = sent - arrived - lost
    wrong = [f"{uncounted} messages are lost and not counted"] if uncounted > 0 else []
    wrong += [] if -uncounted <= 200 else [f"{-uncounted} messages are counted lost, but arrived"]
    return scene.outcome(but="mqtt", figures=figures, wrong=wrong)


def browser_killed(stage: Stage) -> Outcome:
    """Kill the browser Chromium while it draws the live page."""
    scene = Scene(stage, *PAGE)
    url, port = _page_of(scene.program)
    pid, browser = scene.program.process.pid, Browser(url, stage.folder / "chromium")
    stage.callback(browser.kill)
    scene.board.send_until(lambda: connections(pid, port) > 0, "the browser")
    with scene.fault(before=200) as board:
        board.send_during(browser.kill)
        board.send_until(lambda: not connections(pid, port), "the end of the connection")
    return scene.outcome()


def page_that_does_not_read(stage: Stage) -> Outcome:
    """Open the live page from three clients that never read the answers."""
    scene = Scene(stage, *PAGE)
    url, _ = _page_of(scene.program)
    pages: list[socket.socket] = []

    def open_pages() -> None:
        pages.extend(stage.enter_context(open_page_and_read_nothing(url)) for _ in range(PAGES))

    with scene.fault() as board:
        board.send_during(open_pages)
        before_mb = _memory_mb(scene.program)
        board.send(300 if stage.short else 6000)
        growth_mb = _memory_mb(scene.program) - before_mb
    figures = {"pages": len(pages), "memory grew by [MB]": growth_mb}
    return scene.outcome(figures=figures)


def disk_full(stage: Stage) -> Outcome:
    """Fill the file system to which the daemon records; later clear it again."""
    disk = stage.disk(RECORDING)
    scene = Scene(stage, *PAGE, "--set", "record.resume_mb=0.5", before=disk.before)
    disk.attach(scene.program.process.pid)
    with scene.fault() as board:
        board.send_during(disk.fill)
        scene.send_until_error(disk.kind)
        board.send(100 if stage.short else 2000)
        disk.free()
        scene.send_until_error("record_resumed")
    return _recorded_or_counted(scene, disk.inside)


def file_deleted(stage: Stage) -> Outcome:
    """Delete the file that is being recorded."""
    return _taken_away(stage, lambda scene: next(scene.recording.glob("*.mcap")).unlink())


def folder_deleted(stage: Stage) -> Outcome:
    """Delete the folder of the recording, with the file."""
    return _taken_away(stage, lambda scene: shutil.rmtree(scene.recording))


def _taken_away(stage: Stage, take: Callable[[Scene], None]) -> Outcome:
    scene = Scene(stage, *PAGE)
    with scene.fault(before=150 if stage.short else 2000) as board:
        take(scene)
        scene.send_until_error("record_resumed")
        board.send(100 if stage.short else 2000)
    found = _recorded_or_counted(scene, scene.recording)
    parts = [part.info.part for part in find_session([scene.recording]).parts]
    return found if parts == [1] else replace(found, wrong=[*found.wrong, f"the parts are {parts}"])


def _recorded_or_counted(scene: Scene, folder: Path) -> Outcome:
    """End the daemon, and check that each byte from the board is recorded or counted as lost."""
    scene.finish()
    recorded, last = read_recording(folder), scene.program.of("stats")[-1]
    of_link, missing = last["link"]["bytes"], sum(gap.bytes for gap in recorded.gaps)
    items = sum(gap.items for gap in recorded.gaps)
    figures = {
        "bytes that came": of_link,
        "recorded": len(recorded.wire),
        "counted as missing": missing,
        "items counted lost": items,
    }
    wrong = []
    if len(recorded.wire) + missing != of_link:
        wrong.append(f"{of_link - missing - len(recorded.wire)} bytes are neither recorded nor counted")
    if items != last["outputs"]["record"]["dropped"]:
        wrong.append(
            f"{items} items are missing in the recording, but stats says {last['outputs']['record']}"
        )
    return scene.outcome(but="record", recording_is_whole=False, figures=figures, wrong=wrong)


def _page_of(program: Program) -> tuple[str, int]:
    """Return the address and the port of the live page."""
    wait_until(lambda: "live page at " in program.stderr, "the page's address")
    match = re.search(r"live page at (http://\S+:(\d+)/)", program.stderr)
    assert match is not None
    return match[1], int(match[2])


def _memory_mb(program: Program) -> float:
    status = Path(f"/proc/{program.process.pid}/status").read_text()
    return next(int(line.split()[1]) for line in status.splitlines() if line.startswith("VmRSS")) / 1024


DELETED = Expected(("record_deleted", "record_resumed"), figures={"counted as missing": SOME})
CASES = (
    Case(
        "MQTT broker killed, back after a while",
        broker_down,
        Expected(("broker_lost", "broker_back"), figures={"counted lost": SOME}),
    ),
    Case("browser killed in mid-stream", browser_killed, Expected()),
    Case(
        "three open pages that do not read",
        page_that_does_not_read,
        Expected(figures={"pages": PAGES, "memory grew by [MB]": (-math.inf, MOST_MB)}),
    ),
    Case(
        "disk full, later room again",
        disk_full,
        Expected(
            (WHERE_FULL, "record_resumed"),
            instead={WHERE_FULL: WHERE_LIMITED},
            figures={"counted as missing": SOME},
        ),
    ),
    Case("a recording's file deleted", file_deleted, DELETED),
    Case("a recording's folder deleted", folder_deleted, DELETED),
)
