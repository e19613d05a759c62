"""Faults of the outputs: each may lose its own records, counted, and no other may notice."""

import re
import socket
from pathlib import Path

from tools.faults import daemon
from tools.faults.case import Case, Outcome
from tools.faults.daemon_line import AFTER, BEFORE
from tools.faults.pages import Browser, bytes_sent, connections, open_page_and_read_nothing
from tools.faults.program import Program, wait_until
from tools.faults.stage import Stage

PAGES = 3
ONE_UPDATE_KB = 30.0
PAGE = ("--dashboard", "127.0.0.1:0")


def broker_down(stage: Stage) -> Outcome:
    """The broker is killed, and comes back on the same port."""
    broker = stage.broker()
    settings = ("--mqtt", f"127.0.0.1:{broker.port}", "--set", "mqtt.estimate_every=1")
    board, program = daemon.pair(stage, *settings, *PAGE)
    board.send_until(lambda: broker.received()["estimate"] > 50, "messages at the broker")
    with stage.fault():
        board.send_during(broker.kill)
        board.send_until(lambda: "broker_lost" in program.errors(), "the loss")
        board.send(300 if stage.short else 6000)
        board.send_during(broker.start)
        board.send_until(lambda: "broker_back" in program.errors(), "the connection")
    board.send(AFTER)
    daemon.finish(board, program)
    received, sent = broker.received(), len(program.of("estimate")) + len(program.of("stats"))
    lost = program.of("stats")[-1]["outputs"]["mqtt"]["dropped"]
    arrived = received["estimate"] + received["stats"]
    figures = {"published": sent, "received by the broker": arrived, "counted lost": lost}
    uncounted = sent - arrived - lost
    wrong = [f"{uncounted} messages are lost and not counted"] if uncounted > 0 else []
    wrong += [] if -uncounted <= 200 else [f"{-uncounted} messages are counted lost, but arrived"]
    others = daemon.dropped(program, but="mqtt")
    wrong += daemon.missing_in_recording(stage.folder / daemon.RECORDING, board)
    return daemon.outcome(stage, board, program, others=others, figures=figures, wrong=wrong)


def browser_killed(stage: Stage) -> Outcome:
    """Chromium on the live page is killed while it is drawing."""
    board, program = daemon.pair(stage, *PAGE)
    url, port = _page_of(program)
    browser = Browser(url, stage.folder / "chromium")
    stage.later(browser.kill)
    board.send(BEFORE)
    board.send_until(lambda: connections(program.process.pid, port) > 0, "the browser")
    board.send(200)
    with stage.fault():
        board.send_during(browser.kill)
        board.send_until(lambda: not connections(program.process.pid, port), "the end of the connection")
    board.send(AFTER)
    daemon.finish(board, program)
    return daemon.outcome(stage, board, program)


def page_that_does_not_read(stage: Stage) -> Outcome:
    """Three pages are open, and none takes what it is sent."""
    board, program = daemon.pair(stage, *PAGE)
    url, _ = _page_of(program)
    board.send(BEFORE)
    pages: list[socket.socket] = []
    stage.later(lambda: [page.close() for page in pages])  # type: ignore[func-returns-value]
    with stage.fault():
        board.send_during(lambda: pages.extend(open_page_and_read_nothing(url) for _ in range(PAGES)))
        before_mb = _memory_mb(program)
        board.send(300 if stage.short else 6000)
        growth_mb = _memory_mb(program) - before_mb
    sent: list[int] = []
    board.send_during(lambda: sent.extend(map(bytes_sent, pages)))
    sent_kb = sum(sent) / 1000
    board.send(AFTER)
    daemon.finish(board, program)
    figures = {"pages": len(pages), "sent to them [kB]": sent_kb, "memory grew by [MB]": growth_mb}
    wrong = [] if sent_kb < ONE_UPDATE_KB * PAGES else [f"pages that read nothing were sent {sent_kb} kB"]
    return daemon.outcome(stage, board, program, figures=figures, wrong=wrong)


def disk_full(stage: Stage) -> Outcome:
    """The recording's file system fills up; later there is room again."""
    disk = stage.disk(daemon.RECORDING)
    board = stage.board()
    program = daemon.recorder(stage, board, *PAGE, "--set", "record.resume_mb=0.5", before=disk.before)
    daemon.introduce(board, program)
    disk.attach(program.process.pid)
    board.send(BEFORE)
    with stage.fault():
        board.send_during(disk.fill)
        board.send_until(lambda: disk.kind in program.errors(), "the full disk")
        board.send(100 if stage.short else 2000)
        disk.free()
        board.send_until(lambda: "record_resumed" in program.errors(), "the recording")
    board.send(AFTER)
    daemon.finish(board, program)
    recorded, last = daemon.read_recording(disk.inside), program.of("stats")[-1]
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
        wrong.append(f"{items} items are missing, but stats says {last['outputs']['record']}")
    return daemon.outcome(
        stage, board, program, others=daemon.dropped(program, but="record"), figures=figures, wrong=wrong
    )


def _page_of(program: Program) -> tuple[str, int]:
    """Address and port of the live page."""
    wait_until(lambda: "live page at " in program.stderr, "the page's address")
    match = re.search(r"live page at (http://\S+:(\d+)/)", program.stderr)
    assert match is not None
    return match[1], int(match[2])


def _memory_mb(program: Program) -> float:
    status = Path(f"/proc/{program.process.pid}/status").read_text()
    return next(int(line.split()[1]) for line in status.splitlines() if line.startswith("VmRSS")) / 1024


CASES = (
    Case("MQTT broker killed, back after a while", broker_down),
    Case("browser killed in mid-stream", browser_killed),
    Case("three open pages that do not read", page_that_does_not_read),
    Case("disk full, later room again", disk_full),
)
