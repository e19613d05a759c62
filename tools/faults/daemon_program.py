"""Faults of the program and of the machine it runs on."""

import signal
import time

from tools.faults import daemon
from tools.faults.case import Case, Outcome
from tools.faults.daemon_line import AFTER, BEFORE
from tools.faults.stage import Stage

HOUR_NS = 3600 * 10**9
FLUSHED_S = 1.0
"""A kill may cost what was recorded in the last second."""


def kill_9(stage: Stage) -> Outcome:
    """The daemon is killed while it records, and started again; the board goes on meanwhile."""
    state = ("--state", stage.folder / "state", "--set", "state.period_s=0.5")
    board, program = daemon.pair(stage, *state)
    board.send(BEFORE)
    board.send_until((stage.folder / "state").exists, "a snapshot")
    with stage.fault():
        program.end(signal.SIGKILL)
        board.send(20)
    source = ("--source", f"serial:{board.link}", "--record", stage.folder / "second")
    second = stage.daemon(*source, *state)
    board.send_until(lambda: bool(second.of("estimate")), "estimates")
    board.send(AFTER)
    daemon.finish(board, second)
    wire = daemon.read_recording(stage.folder / daemon.RECORDING).wire
    published, saved = len(program.of("sample")), len(board.samples_in(wire))
    unused = second.of("stats")[-1]["samples"]["before_hello"]
    figures = {"published before": published, "of them recorded": saved, "before HELLO": unused}
    lost_s = (published - saved) / 100
    wrong = [] if lost_s <= FLUSHED_S else [f"the recording lacks the last {lost_s} s"]
    epochs = [record["reason"] for record in second.of("epoch")]
    wrong += [] if epochs == ["resumed"] else [f"the second daemon's epochs: {epochs}"]
    return daemon.outcome(
        stage,
        board,
        program,
        second,
        others=f"record lost {published - saved}",
        excuse="until the next daemon heard a HELLO",
        figures=figures,
        wrong=wrong,
    )


def two_daemons(stage: Stage) -> Outcome:
    """A second daemon wants the port, waits, and gets it when the first ends."""
    board, program = daemon.pair(stage)
    board.send(BEFORE)
    second = stage.daemon("--source", f"serial:{board.link}")
    with stage.fault():
        board.send_until(lambda: "port_busy" in second.errors(), "the second daemon")
        board.send(100)
        i, k = max(board.arrived())
        program.wait_for_sample(board.boots[i].boot_id, k)
        program.end()
    board.send_until(lambda: bool(second.of("sample")), "samples of the second daemon")
    board.send(AFTER)
    daemon.finish(board, second)
    figures = {"before HELLO": second.of("stats")[-1]["samples"]["before_hello"]}
    excuse = "until the other heard a HELLO"
    return daemon.outcome(
        stage, board, program, second, others=daemon.dropped(program), excuse=excuse, figures=figures
    )


def clock_step(stage: Stage) -> Outcome:
    """The machine's date is set an hour forward, then two hours back; then the board is reset."""
    board = stage.board()
    program = daemon.recorder(stage, board, clock=stage.clock)
    daemon.introduce(board, program)
    board.send(BEFORE)
    with stage.fault():
        stage.set_clock(HOUR_NS)
        board.send(100)
        stage.set_clock(-HOUR_NS)
        board.send(100)
    board.boot()
    board.send(AFTER)
    daemon.finish(board, program)
    now_ns = time.time_ns()
    of_epoch = [[r["host_ns"] for r in program.of("sample") if r["epoch"] == epoch] for epoch in (1, 2)]
    wrong = []
    if any(times != sorted(set(times)) for times in of_epoch):
        wrong.append("time stamps run backwards within an epoch")
    if abs(of_epoch[1][-1] - (now_ns - HOUR_NS)) > HOUR_NS // 60:
        wrong.append("the new epoch does not follow the machine's date")
    off_ms = max(daemon.time_stamps_off_ms(program, epoch) for epoch in (1, 2))
    if off_ms > 1000:
        wrong.append(f"the step tore the time stamps: {off_ms} ms")
    steps = [round(ns / HOUR_NS) for ns in daemon.read_recording(stage.folder / daemon.RECORDING).steps_ns]
    if steps != [0, 1, -1]:
        wrong.append(f"the recording shows the date's steps as {steps} h")
    return daemon.outcome(stage, board, program, figures={"time stamps off [ms]": off_ms}, wrong=wrong)


CASES = (
    Case("`kill -9` while recording", kill_9),
    Case("two daemons on one port", two_daemons),
    Case("clock set an hour forward, two back", clock_step),
)
