"""Faults of one of two workers of NATS: killed, stopped, cut off, and under a clock that jumps."""

import contextlib
import os
import signal
import struct
import time
from pathlib import Path
from typing import Any

from tools.fault_script.program import Program
from tools.faults.boards import DEVICES
from tools.faults.nats_stage import Stage
from tools.faults.row import Row
from tools.faults.sample_books import heard, row
from tools.frames_load import RATE_HZ

PAST_LEASE_S = 8.0
DAY_NS = 86_400 * 10**9


def worker_killed(folder: Path) -> Row:
    """By `kill -9`."""
    with contextlib.closing(Stage(folder)) as stage:
        more, wrong = _killed(stage)
        return row("one of two workers killed (`kill -9`)", stage.boards, stage.workers, more, wrong)


def worker_stands_still(folder: Path) -> Row:
    """Stopped for longer than a lease, and let go on."""
    with contextlib.closing(Stage(folder)) as stage:
        first, second = stage.workers
        before, published = len(first.records), stage.boards.samples
        os.kill(first.process.pid, signal.SIGSTOP)
        try:
            stage.until(lambda: heard(second) == stage.names, "the second worker for all")
        finally:
            os.kill(first.process.pid, signal.SIGCONT)
        _share_again(stage, first)
        early = _walked_without_a_lease(first.records[before:], published + 2 * RATE_HZ)
        return row(
            "one of two workers stopped (SIGSTOP) until the other had all, and let go on",
            stage.boards,
            stage.workers,
            "both share again",
            [f"it walked {early} samples that were the other's"] if early else [],
        )


def worker_cut_off(folder: Path) -> Row:
    """The network between it and the server is split until the other has all, and then is whole again."""
    with contextlib.closing(Stage(folder)) as stage:
        first, second = stage.workers
        stage.line.cut()
        cut_s = time.monotonic()
        stage.until(lambda: heard(second) == stage.names, "the second worker for all")
        taken_s = time.monotonic() - cut_s
        walked = len(first.of("sample"))
        time.sleep(PAST_LEASE_S)
        more = len(first.of("sample")) - walked
        stage.line.heal()
        _share_again(stage, first)
        return row(
            "one of two workers cut off from the server until the other had all",
            stage.boards,
            stage.workers,
            f"taken over after {taken_s:.0f} s; both share again",
            [f"the one that was cut off walked {more} samples more"] if more else [],
        )


def clock_jumps(folder: Path) -> Row:
    """A worker's clock goes a day forward, and back; then it is killed."""
    with contextlib.closing(Stage(folder)) as stage:
        wrong = [*_set_clock(stage, DAY_NS), *_set_clock(stage, 0)]
        more, others = _killed(stage)
        name = "clock of a worker set a day forward, and back; then it was killed"
        return row(name, stage.boards, stage.workers, more, [*wrong, *others])


def clock_ahead(folder: Path) -> Row:
    """A worker is killed while its clock is a day ahead: so are its snapshots."""
    with contextlib.closing(Stage(folder)) as stage:
        wrong = _set_clock(stage, DAY_NS)
        more, others = _killed(stage)
        name = "a worker killed while its clock was a day ahead"
        return row(name, stage.boards, stage.workers, more, [*wrong, *others])


def _set_clock(stage: Stage, ahead_ns: int) -> list[str]:
    """Move the first worker's clock; what is wrong if that moves a partition."""
    before = _taken(stage.workers)
    stage.clock.write_bytes(struct.pack("<q", ahead_ns))
    time.sleep(PAST_LEASE_S)
    moved = _taken(stage.workers) - before
    return [f"{moved} partitions were taken when the clock was set"] if moved else []


def _taken(workers: list[Program]) -> int:
    return sum(worker.errors().count("partition_taken") for worker in workers)


def _killed(stage: Stage) -> tuple[str, list[str]]:
    """Let the second worker take all; what there is to say, and what is wrong."""
    first, second = stage.workers
    before = heard(second)
    epochs = len(second.of("epoch"))
    first.kill()
    killed_s = time.monotonic()
    stage.until(lambda: heard(second) == stage.names, "the second worker for all")
    taken_s = time.monotonic() - killed_s
    reasons = {r["device"]: r["reason"] for r in second.of("epoch")[epochs:] if r["device"] not in before}
    wrong = [f"did not go on from snapshots: {reasons}"] if set(reasons.values()) != {"resumed"} else []
    return f"{DEVICES - len(before)} of {DEVICES} sensors taken over after {taken_s:.0f} s", wrong


def _walked_without_a_lease(records: list[dict[str, Any]], since: int) -> int:
    """Samples of these numbers or later before it took a partition; earlier ones were on their way."""
    lease = next(i for i, r in enumerate(records) if r["class"] == "error" and r["kind"] == "partition_taken")
    return sum(r["class"] == "sample" and r["seq"] >= since for r in records[:lease])


def _share_again(stage: Stage, worker: Program) -> None:
    since = stage.boards.samples
    stage.until(lambda: bool(heard(worker, since)), "its share")
    stage.until_all_again()


CASES = (worker_killed, worker_stands_still, worker_cut_off, clock_jumps, clock_ahead)
