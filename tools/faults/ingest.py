"""Faults of the ingest through NATS: a worker killed, the server away, boards that keep nothing."""

import contextlib
import time
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from itertools import chain
from pathlib import Path

from tools.fault_script.program import Program
from tools.faults.nats_stage import DEVICES, Stage
from tools.faults.played import played
from tools.faults.row import Row
from tools.frames_load import RATE_HZ

PART = "ingest"
AWAY_S = 8.0
"""Longer than a lease."""


def worker_killed(folder: Path) -> Row:
    """One of two, by `kill -9`."""
    with contextlib.closing(Stage(folder)) as stage:
        first, second = stage.workers
        before = stage.heard(second)
        first.kill()
        killed_s = time.monotonic()
        stage.until(lambda: stage.heard(second) == set(stage.boards.names), "the second worker for all")
        taken_s = time.monotonic() - killed_s
        return _row(
            stage,
            "one of two workers killed (`kill -9`)",
            f"{DEVICES - len(before)} of {DEVICES} sensors taken over after {taken_s:.0f} s",
        )


def server_restarted(folder: Path) -> Row:
    """Killed, and started at once."""
    return _server_killed(folder, 0.0, "NATS server killed (`kill -9`), started again at once")


def server_away(folder: Path) -> Row:
    """Killed, and started after longer than a lease."""
    return _server_killed(folder, AWAY_S, f"NATS server away for {AWAY_S:g} s")


def server_away_boards_keep_nothing(folder: Path) -> Row:
    """The same with boards that publish once and forget (QoS 0)."""
    return _server_killed(folder, AWAY_S, f"NATS server away for {AWAY_S:g} s, boards send with QoS 0", qos=0)


CASES = (worker_killed, server_restarted, server_away, server_away_boards_keep_nothing)


def _server_killed(folder: Path, away_s: float, name: str, qos: int = 1) -> Row:
    with contextlib.closing(Stage(folder, qos)) as stage:
        stage.server.kill()
        killed_s = time.monotonic()
        time.sleep(away_s)
        stage.server.start()
        back = stage.boards.seconds * RATE_HZ

        def again() -> bool:
            found = {r["device"] for r in chain(*(w.of("sample") for w in stage.workers)) if r["seq"] >= back}
            return found == set(stage.boards.names)

        stage.until(again, "samples of all sensors")
        return _row(
            stage,
            name,
            f"samples of all sensors again {time.monotonic() - killed_s - away_s:.0f} s after it was back",
        )


def _row(stage: Stage, name: str, more: str) -> Row:
    """Let all that was published arrive, and account for it."""
    time.sleep(1.0)
    stage.boards.stop()
    due = stage.boards.seconds * RATE_HZ
    living = [worker for worker in stage.workers if worker.code is None]
    last = {(name, due - 1) for name in stage.boards.names}
    stage.until(lambda: last <= _samples(living), "the last samples")
    with ThreadPoolExecutor() as pool:  # at the same time: else the last one takes what the others give back
        list(pool.map(lambda worker: worker.end(), living))
    wrong = [worker.stderr[-500:] for worker in living if worker.code != 0]
    delivered = _samples(stage.workers)
    lost = _lost(stage) - delivered
    first = {(name, at) for name in stage.boards.names for at in range(RATE_HZ)} - delivered - lost
    twice = sum(len(worker.of("sample")) for worker in stage.workers) - len(delivered)
    strange = delivered - {(name, at) for name in stage.boards.names for at in range(due)}
    if strange:
        wrong.append(f"samples that nobody sent: {sorted(strange)[:5]}")
    where = {
        "delivered": len(delivered),
        "counted as lost": len(lost),
        "before a sensor's second message": len(first),
    }
    told = list(dict.fromkeys(chain(*(worker.errors() for worker in stage.workers))))
    return Row(PART, name, told, "samples", due * DEVICES, where, f"{more}; {twice} delivered twice", wrong)


def _samples(workers: Iterable[Program]) -> set[tuple[str, int]]:
    return {(r["device"], r["seq"]) for worker in workers for r in worker.of("sample")}


def _lost(stage: Stage) -> set[tuple[str, int]]:
    return {
        (r["device"], at)
        for worker in stage.workers
        for r in worker.of("gap")
        for at in range(r["seq"], r["seq"] + r["missing"])
    }


def rows(words: list[str]) -> Iterator[Row]:
    """One of each case."""
    return played(PART, CASES, words)
