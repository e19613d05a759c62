"""Faults of one of two workers of NATS: killed, stopped, cut off, and under a clock that jumps."""

import os
import signal
import time
from typing import Any

from tools.faults.case import Case, Outcome
from tools.faults.ingest_scene import NatsScene, outcome, until_all_again, walked_by
from tools.faults.mqtt_boards import DEVICES
from tools.faults.program import Program, wait_until
from tools.faults.stage import Stage
from tools.frames_load import RATE_HZ

PAST_LEASE_S = 8.0
DAY_NS = 86_400 * 10**9


def worker_killed(stage: Stage) -> Outcome:
    """By `kill -9`."""
    return _killed(NatsScene(stage))


def worker_stands_still(stage: Stage) -> Outcome:
    """Stopped for longer than a lease, and let go on."""
    scene = NatsScene(stage)
    first, second = scene.workers
    before, published = len(first.records), scene.boards.samples
    os.kill(first.process.pid, signal.SIGSTOP)
    try:
        scene.until_all_by(second)
    finally:
        os.kill(first.process.pid, signal.SIGCONT)
    _share_again(scene, first)
    early = _walked_without_a_lease(first.records[before:], published + 2 * RATE_HZ)
    wrong = [f"it walked {early} samples that were the other's"] if early else []
    return outcome(scene.boards, scene.workers, "both share again", wrong)


def worker_cut_off(stage: Stage) -> Outcome:
    """The network between it and the server is split until the other has all, and then is whole again."""
    scene = NatsScene(stage)
    first, second = scene.workers
    scene.line.cut()
    cut_s = time.monotonic()
    scene.until_all_by(second)
    taken_s = time.monotonic() - cut_s
    walked = len(first.of("sample"))
    time.sleep(PAST_LEASE_S)
    late = len(first.of("sample")) - walked
    scene.line.heal()
    _share_again(scene, first)
    wrong = [f"the one that was cut off walked {late} samples more"] if late else []
    more = f"taken over after {taken_s:.0f} s; both share again"
    return outcome(scene.boards, scene.workers, more, wrong)


def clock_jumps(stage: Stage) -> Outcome:
    """A worker's clock goes a day forward, and back; then it is killed."""
    scene = NatsScene(stage)
    return _killed(scene, [*_set_clock(stage, scene, DAY_NS), *_set_clock(stage, scene, 0)])


def clock_ahead(stage: Stage) -> Outcome:
    """A worker is killed while its clock is a day ahead: so are its snapshots."""
    scene = NatsScene(stage)
    return _killed(scene, _set_clock(stage, scene, DAY_NS))


def _set_clock(stage: Stage, scene: NatsScene, ahead_ns: int) -> list[str]:
    """Move the first worker's clock; what is wrong if that moves a partition."""
    before = _taken(scene.workers)
    stage.set_clock(ahead_ns)
    time.sleep(PAST_LEASE_S)
    moved = _taken(scene.workers) - before
    return [f"{moved} partitions were taken when the clock was set"] if moved else []


def _taken(workers: list[Program]) -> int:
    return sum(worker.errors().count("partition_taken") for worker in workers)


def _killed(scene: NatsScene, wrong: list[str] | None = None) -> Outcome:
    """Kill the first worker, and let the second take all. wrong: before."""
    first, second = scene.workers
    before = walked_by(second)
    epochs = len(second.of("epoch"))
    first.kill()
    killed_s = time.monotonic()
    scene.until_all_by(second)
    taken_s = time.monotonic() - killed_s
    reasons = {r["device"]: r["reason"] for r in second.of("epoch")[epochs:] if r["device"] not in before}
    found = [f"did not go on from snapshots: {reasons}"] if set(reasons.values()) != {"resumed"} else []
    more = f"{DEVICES - len(before)} of {DEVICES} sensors taken over after {taken_s:.0f} s"
    return outcome(scene.boards, scene.workers, more, [*(wrong or []), *found])


def _walked_without_a_lease(records: list[dict[str, Any]], since: int) -> int:
    """Samples of these numbers or later before it took a partition; earlier ones were on their way."""
    lease = next(i for i, r in enumerate(records) if r["class"] == "error" and r["kind"] == "partition_taken")
    return sum(r["class"] == "sample" and r["seq"] >= since for r in records[:lease])


def _share_again(scene: NatsScene, worker: Program) -> None:
    since = scene.boards.samples
    wait_until(lambda: bool(walked_by(worker, since)), "its share")
    until_all_again(scene.boards, scene.workers)


CASES = (
    Case("one of two workers killed (`kill -9`)", worker_killed),
    Case("one of two workers stopped (SIGSTOP) until the other had all, and let go on", worker_stands_still),
    Case("one of two workers cut off from the server until the other had all", worker_cut_off),
    Case("clock of a worker set a day forward, and back; then it was killed", clock_jumps),
    Case("a worker killed while its clock was a day ahead", clock_ahead),
)
