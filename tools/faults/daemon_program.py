"""Faults of the daemon itself, and of the machine that runs it."""

import signal
import time

from tools.faults.case import Case
from tools.faults.daemon import Scene, read_recording, time_stamps_off_ms
from tools.faults.expected import SOME, Expected
from tools.faults.outcome import Outcome
from tools.faults.stage import Stage

HOUR_NS = 3600 * 10**9
FLUSHED_S = 1.0
"""When the daemon is killed, bytes that arrived less than this time before may be missing in the recording
[s].
"""


def kill_9(stage: Stage) -> Outcome:
    """Kill the daemon while it records, and start another; the board keeps sending meanwhile."""
    state = ("--state", stage.folder / "state", "--set", "state.period_s=0.5")
    scene = Scene(stage, *state)
    scene.board.send_until((stage.folder / "state").exists, "a snapshot")
    with scene.fault() as board:
        scene.program.end(signal.SIGKILL)
        board.send(20)
    second = scene.listen("--source", f"serial:{board.link}", "--record", stage.folder / "second", *state)
    board.send_until(lambda: bool(second.of("estimate")), "estimates")
    scene.finish()
    wire = read_recording(scene.recording).wire
    published, saved = len(scene.program.of("sample")), len(board.samples_in(wire))
    unused = second.of("stats")[-1]["sample_counts"]["before_hello"]
    figures = {"published before": published, "of them recorded": saved, "before HELLO": unused}
    lost_s = (published - saved) / 100
    wrong = [] if lost_s <= FLUSHED_S else [f"the recording lacks the last {lost_s} s"]
    epochs = [record["reason"] for record in second.of("epoch")]
    wrong += [] if epochs == ["resumed"] else [f"the second daemon's epochs: {epochs}"]
    return scene.outcome(
        excuse="until the next daemon heard a HELLO",
        figures=figures,
        wrong=wrong,
        recording_is_whole=False,
    )


def two_daemons(stage: Stage) -> Outcome:
    """Start a second daemon on the serial port. It waits, and gets the port when the first daemon ends."""
    scene = Scene(stage)
    with scene.fault() as board:
        second = scene.listen("--source", f"serial:{board.link}")
        scene.send_until_error("port_busy")
        board.send(100)
        i, k = max(board.arrived())
        scene.program.wait_for_sample(board.boots[i].boot_id, k)
        scene.program.end()
    board.send_until(lambda: bool(second.of("sample")), "samples of the second daemon")
    scene.finish()
    return scene.outcome(
        excuse="until the other heard a HELLO",
        figures={"before HELLO": second.of("stats")[-1]["sample_counts"]["before_hello"]},
        recording_is_whole=False,
    )


def clock_step(stage: Stage) -> Outcome:
    """Set the machine's date an hour forward, then two hours back; then reset the board."""
    scene = Scene(stage, clock=stage.clock)
    with scene.fault() as board:
        stage.set_clock(HOUR_NS)
        board.send(100)
        stage.set_clock(-HOUR_NS)
        board.send(100)
    board.boot()
    scene.finish()
    program, now_ns = scene.program, time.time_ns()
    of_epoch = [[r["host_ns"] for r in program.of("sample") if r["epoch"] == epoch] for epoch in (1, 2)]
    wrong = []
    if any(times != sorted(set(times)) for times in of_epoch):
        wrong.append("time stamps run backwards within an epoch")
    if abs(of_epoch[1][-1] - (now_ns - HOUR_NS)) > HOUR_NS // 60:
        wrong.append("the new epoch does not follow the machine's date")
    figures = time_stamps_off_ms(program, 1, 2)
    if max(figures.values()) > 1000:
        wrong.append(f"the step of the clock moved time stamps within an epoch: {figures}")
    steps = [round(ns / HOUR_NS) for ns in read_recording(scene.recording).steps_ns]
    if steps != [0, 1, -1]:
        wrong.append(f"the recording shows clock shifts of {steps} h, not [0, 1, -1] h")
    return scene.outcome(figures=figures, wrong=wrong)


CASES = (
    Case("`kill -9` while recording", kill_9, Expected(("resumed",), excused=SOME)),
    Case("two daemons on one port", two_daemons, Expected(("port_busy", "start"), excused=SOME)),
    Case("clock set an hour forward, two back", clock_step, Expected(("restart",), due=500)),
)
