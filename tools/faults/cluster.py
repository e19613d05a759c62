"""Faults of `fltea identify --dask --out`: a worker or the scheduler is killed in the middle of a file."""

import contextlib
import logging
import os
import signal
import subprocess
import sys
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from fltea.cluster.listing import files_of
from fltea.cluster.run import Progress, run
from fltea.cluster.verdict_table import VerdictTable
from fltea.cluster.whole import Ask
from fltea.identification.axis import IdentifyOptions
from fltea.identification.settings import Settings
from fltea.identification.workers import Here, Workers
from fltea.records.errors import FlteaError
from fltea.settings.how import How

from tools.faults.case import Case
from tools.faults.expected import Expected
from tools.faults.outcome import Outcome
from tools.faults.stage import Stage

SAMPLES, PIECES, SMALL = 1 << 14, 4, 6
ASK = Ask(
    Settings(IdentifyOptions(shuffles=0)),
    how=How(rate_hz=100.0, units="deg/s"),
    block_bytes=8 * SAMPLES // PIECES + 256,
)
DONE = 3
"""Number of identified files after which the scheduler is killed."""


CLUSTER = """
import time
from distributed import LocalCluster

how = dict(threads_per_worker=1, processes=False, dashboard_address=None, host="127.0.0.1", protocol="tcp")
with LocalCluster(n_workers=1, **how) as cluster:
    print(cluster.scheduler_address, flush=True)
    time.sleep(1e6)
"""


class Cluster:
    """A process with a Dask scheduler and a worker that has one thread."""

    def __init__(self) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-c", CLUSTER], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
        )
        assert self._process.stdout is not None
        with self._process.stdout as stdout:
            self.address = stdout.readline().strip()

    def close(self) -> None:
        """Kill the process with SIGKILL."""
        self._process.kill()
        self._process.wait()

    kill = close

    def pause(self) -> None:
        """Suspend the process with SIGSTOP; its connections stay open."""
        self._process.send_signal(signal.SIGSTOP)


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Suppress the long log that Dask writes when a process is killed."""
    logging.disable(logging.ERROR)
    try:
        yield
    finally:
        logging.disable(logging.NOTSET)


@_quiet()
def worker_killed(stage: Stage) -> Outcome:
    """Kill one of two workers while a large file is identified in several pieces."""
    from distributed import LocalCluster
    from fltea.identification.dask_workers import DaskWorkers

    files = _make(stage.folder)
    killed: list[int] = []
    start: Any = LocalCluster  # distributed has no type hints
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # Dask warns about its own ports and files
        with start(n_workers=2, threads_per_worker=1, dashboard_address=None, host="127.0.0.1") as cluster:
            for nanny in cluster.workers.values():
                # keeps Dask from starting a new worker in place of the killed one
                nanny.close_gracefully()
            workers = DaskWorkers(cluster.scheduler_address)
            pids = list(workers._client.run(os.getpid).values())

            def kill_one(progress: Progress) -> None:
                if "piece" in progress.now and not killed:
                    killed.append(pids[0])
                    os.kill(pids[0], signal.SIGKILL)

            _identify(files, stage.folder / "v.parquet", workers, kill_one)
    wrong = [] if killed else ["no worker was killed"]
    return _outcome(stage.folder, [], "the other worker processed its pieces, too", wrong)


@_quiet()
def scheduler_killed(stage: Stage) -> Outcome:
    """Kill the scheduler, then run the same identification again with another scheduler."""
    from fltea.identification.dask_workers import DaskWorkers

    files, reported, out = _make(stage.folder), [], stage.folder / "v.parquet"
    with contextlib.closing(Cluster()) as cluster:

        def kill(progress: Progress) -> None:
            if progress.done == DONE:
                cluster.kill()

        try:
            _identify(files, out, DaskWorkers(cluster.address), kill)
        except FlteaError as error:
            reported.append(str(error).removeprefix(f"--dask {cluster.address}: ").partition(",")[0])
    first = _verdicts(out)
    with contextlib.closing(Cluster()) as cluster:
        done = _identify(files, out, DaskWorkers(cluster.address))
    wrong = (
        [f"{done.skipped} of {len(first)} files were not identified again"]
        if done.skipped != len(first)
        else []
    )
    more = f"{len(first)} files before, {done.done} by another scheduler"
    return _outcome(stage.folder, reported, more, wrong)


def _make(folder: Path) -> Path:
    """Write a file so large that it is processed in pieces, and small files."""
    files = folder / "in"
    files.mkdir()
    noise = np.random.default_rng(17).normal(0, 0.05, SAMPLES)
    np.save(files / "large.npy", noise)
    for number in range(SMALL):
        np.save(files / f"{number}.npy", noise[: 1000 + 100 * number])
    return files


def _identify(
    files: Path, out: Path, workers: Workers, tell: Callable[[Progress], None] = lambda progress: None
) -> Progress:
    table = VerdictTable(out, ASK.digest())
    try:
        return run(files_of([str(files)]), ASK, workers, table, tell)
    finally:
        table.close()
        workers.close()


def _verdicts(out: Path) -> dict[str, dict[str, Any]]:
    from pyarrow import parquet

    return {row["file"]: row for row in parquet.read_table(out).to_pylist()}


def _outcome(folder: Path, reported: list[str], more: str, wrong: list[str]) -> Outcome:
    """Compare the table of verdicts with one that was made without a cluster; return the outcome."""
    from pyarrow import parquet

    _identify(folder / "in", folder / "here.parquet", Here())
    found, wanted = _verdicts(folder / "v.parquet"), _verdicts(folder / "here.parquet")
    rows = parquet.read_table(folder / "v.parquet").num_rows
    other = [
        file
        for file, row in found.items()
        if row["error"] is None and row | {"seconds": 0} != wanted[file] | {"seconds": 0}
    ]
    if rows != len(found):
        wrong = [*wrong, f"{rows} rows of {len(found)} files"]
    if other:
        wrong = [*wrong, f"verdicts that differ from those without a cluster: {other}"]
    failed = sum(row["error"] is not None for row in found.values())
    where = {"with their verdict": len(found) - failed, "with the reason of a failure": failed}
    return Outcome(reported, SMALL + 1, where, "files", more, wrong=wrong)


CASES = (
    Case(
        "one of two workers killed (`kill -9`) in mid-file",
        worker_killed,
        Expected(due=SMALL + 1),
        tested=False,
    ),
    Case(
        "scheduler killed (`kill -9`), the command given again",
        scheduler_killed,
        Expected(("the scheduler is gone",), due=SMALL + 1),
        tested=False,
    ),
)
