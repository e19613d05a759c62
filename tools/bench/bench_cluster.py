"""Measures the speed of `fltea identify --out` with Dask clusters of one and of two workers.

The recordings are ten minutes long, as MCAP; one large .npy file is processed in pieces, too. All files are
on this machine's disk, so the network of a cluster is not measured.
"""

import os
import shutil
import tempfile
import time
import warnings
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from fltea.cluster.listing import files_of
from fltea.cluster.run import run
from fltea.cluster.verdict_table import VerdictTable
from fltea.cluster.whole import Ask
from fltea.identification.axis import IdentifyOptions
from fltea.identification.dask_workers import DaskWorkers
from fltea.identification.settings import Settings
from fltea.settings.how import How

from tools.bench.day_files import counts, write_mcap
from tools.bench.feeder import RATE_HZ

MINUTES, FILES = 10, 6
TINY = 400
"""Number of invalid files of a few bytes. Each takes only the time to list it, to schedule it and to write
its row of the table.
"""
LARGE_SAMPLES, PIECES = 6_000_000, 6
AXES = 3


def measure() -> dict[str, Any]:
    """Return wall-clock and processor time of each measured task.

    The workers have loaded all modules before the measurement.
    """
    from distributed import LocalCluster

    start: Any = LocalCluster  # the package `distributed` has no type hints
    found: dict[str, Any] = {"cores": os.cpu_count()}
    with tempfile.TemporaryDirectory() as name, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # Dask warns about its own ports and files
        folder = Path(name)
        _make(folder)
        quick = Ask(Settings(IdentifyOptions(shuffles=0)))
        whole = Ask(Settings(IdentifyOptions()))
        size = (folder / "large" / "large.npy").stat().st_size
        large = msgspec.structs.replace(
            quick, how=How(units="deg/s", rate_hz=float(RATE_HZ)), block_bytes=size // PIECES + 1
        )
        for workers in (1, 2):
            with start(
                n_workers=workers, threads_per_worker=1, dashboard_address=None, host="127.0.0.1"
            ) as cluster:
                address = cluster.scheduler_address
                _timed(folder / "warm", quick, address, folder)
                found[f"workers_{workers}"] = {
                    "files": _timed(folder / "small", quick, address, folder),
                    "files_with_200_shuffles": _timed(folder / "few", whole, address, folder),
                    "pieces": _timed(folder / "large", large, address, folder),
                    "tiny": _timed(folder / "tiny", quick, address, folder, failing=True),
                }
    return found


def _make(folder: Path) -> None:
    recorded = write_mcap(folder / "recorded", counts(MINUTES * 60 * RATE_HZ))
    (file,) = recorded.glob("*.mcap")
    for name, files in (("warm", 2), ("small", FILES), ("few", 1)):
        (folder / name).mkdir()
        for i in range(files):
            shutil.copyfile(file, folder / name / f"{i}.mcap")
    (folder / "tiny").mkdir()
    for i in range(TINY):
        (folder / "tiny" / f"{i}.npz").write_bytes(b"PK none")
    (folder / "large").mkdir()
    rng = np.random.default_rng(1)
    np.save(folder / "large" / "large.npy", rng.normal(0, 0.05, (LARGE_SAMPLES, AXES)).astype(np.float32))


def _timed(files: Path, ask: Ask, address: str, folder: Path, *, failing: bool = False) -> dict[str, float]:
    workers = DaskWorkers(address)

    def worked() -> float:
        return float(sum(workers._client.run(time.process_time).values()))

    worked_before = worked()
    table = VerdictTable(Path(tempfile.mkdtemp(dir=folder)) / "v.parquet", ask.digest())
    client_begin, begin = time.process_time(), time.monotonic()
    try:
        done = run(files_of([str(files)]), ask, workers, table)
        seconds, client_s = time.monotonic() - begin, time.process_time() - client_begin
        worker_s = worked() - worked_before
    finally:
        table.close()
        workers.close()
    if done.failed and not failing:
        raise RuntimeError(done.first_failure)
    return {
        "files": done.done,
        "bytes": done.read,
        "seconds": round(seconds, 3),
        "files_per_s": round(done.done / seconds, 3),
        "bytes_per_s": round(done.read / seconds),
        "worker_cpu_s_per_file": round(worker_s / done.done, 4),
        "client_cpu_s_per_file": round(client_s / done.done, 5),
    }


def text(found: dict[str, Any]) -> str:
    """Return the figures as a table.

    Processor time depends less than wall-clock time on how busy the machine is. The processor time of the
    client includes that of the scheduler.
    """
    lines = ["workers  what                      files/s      MB/s  worker cpu s/file  client cpu ms/file"]
    for workers in (1, 2):
        for what, one in found[f"workers_{workers}"].items():
            lines.append(
                f"{workers:7}  {what:24} {one['files_per_s']:8.2f} {one['bytes_per_s'] / 1e6:9.2f}"
                f" {one['worker_cpu_s_per_file']:18.3f} {one['client_cpu_s_per_file'] * 1e3:19.1f}"
            )
    return "\n".join(lines)
