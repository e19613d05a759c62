"""Many files are identified into one table.

Each file is identified once, each failure is a row of the table, and no work is repeated, even after a kill.
"""

import os
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import closing
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from fltea.cluster.listing import File, Unlisted, files_of
from fltea.cluster.run import Progress, run
from fltea.cluster.verdict_table import VerdictTable
from fltea.cluster.whole import identify_file
from fltea.identification.run import identify_all
from fltea.identification.workers import Here
from fltea.records.errors import FlteaError
from fltea.settings.how import How

from tests.rig.cluster_support import (
    ASK,
    command,
    identified,
    open_table,
    rows_in,
    s3_server,
    two_workers,
    values,
)
from tests.rig.identify_files import counts, npz
from tests.rig.identify_support import white
from tests.rig.toolchain import missing
from tools.faults.cluster import Cluster


@pytest.fixture(scope="module")
def s3() -> Iterator[Any]:
    with s3_server() as system:
        yield system


def go(pattern: str, out: Path, **options: Any) -> Progress:
    return identified(pattern, ASK, out, Here(), **options)


def test_from_s3_and_again(s3: Any, tmp_path: Path) -> None:
    """The storage has two recordings and a file that is no recording.

    The second run reads only a file that has changed.
    """
    local = npz(tmp_path / "a.npz", counts(600, 2))
    s3.put_file(local, "lab/2026-11/bench 1/a.npz")
    s3.pipe("lab/2026-11/b.npz", b"PK none")
    s3.put_file(local, "lab/2026-10/old.npz")
    out = tmp_path / "v.parquet"
    told: list[int] = []
    done = go("s3://lab/2026-11/**/*.npz", out, report=lambda progress: told.append(progress.done))
    assert (done.done, done.failed, done.skipped) == (2, 1, 0)
    assert told == [1, 2, 2]
    bad, x, y = rows_in(out)
    assert (bad["file"], bad["axis"], bad["again"]) == ("s3://lab/2026-11/b.npz", None, False)
    assert bad["error"].startswith("s3://lab/2026-11/b.npz: cannot be read as .npz")
    assert (x["axis"], y["axis"]) == ("gyro_x", "gyro_y")
    (alone,) = (row for row in identify_file(next(files_of([str(local)])), ASK) if row.axis == "gyro_x")
    for name in (
        "kind",
        "text",
        "p_white",
        "R",
        "N",
        "N_low",
        "fltea_alpha",
        "lsb",
        "samples",
        "data_checks",
    ):
        assert x[name] == (alone.values[name] if name in alone.values else getattr(alone, name))

    again = go("s3://lab/2026-11/**/*.npz", out)
    assert (again.done, again.skipped) == (0, 2)
    s3.put_file(npz(tmp_path / "c.npz", counts(600, 1, seed=2)), "lab/2026-11/b.npz")
    mended = go("s3://lab/2026-11/**/*.npz", out)
    assert (mended.done, mended.failed, mended.skipped) == (1, 0, 1)
    assert [row["error"] is None for row in rows_in(out) if row["file"].endswith("b.npz")] == [False, True]


def test_an_axis_without_a_result_says_why(tmp_path: Path) -> None:
    raw = counts(600, 2)
    raw[:, 0] = 7
    (file,) = files_of([str(npz(tmp_path / "a.npz", raw))])
    still, moving = identify_file(file, ASK)
    assert (still.axis, still.values, still.lost, still.again) == ("gyro_x", {}, 0, False)
    assert still.error is not None
    assert "constant" in still.error
    assert (moving.axis, moving.error) == ("gyro_y", None)


@pytest.mark.parametrize(
    ("new", "reason"),
    [
        (None, "FileNotFoundError"),
        (b"PK none, and more", "has changed since it was listed"),
        (b"PK else", "has changed since it was listed"),
    ],
)
def test_a_file_that_goes_away_or_changes_is_tried_again(
    new: bytes | None, reason: str, s3: Any, tmp_path: Path
) -> None:
    s3.pipe("lab/gone/a.npz", b"PK none")
    files = list(files_of(["s3://lab/gone"]))
    s3.rm("lab/gone/a.npz") if new is None else s3.pipe("lab/gone/a.npz", new)
    with open_table(tmp_path / "v.parquet") as table:
        assert run(files, ASK, Here(), table).failed == 1
    (row,) = rows_in(tmp_path / "v.parquet")
    assert row["again"]
    assert reason in row["error"]


def test_a_local_file_that_the_worker_does_not_see(tmp_path: Path) -> None:
    """A worker may not see a file, for example because a shared disk is not mounted there. When the worker
    sees it, the next run identifies the file.
    """
    path, aside = npz(tmp_path / "a.npz", counts(600, 1)), tmp_path / "aside"
    files = list(files_of([str(path)]))
    path.rename(aside)
    with open_table(tmp_path / "v.parquet") as table:
        assert run(files, ASK, Here(), table).failed == 1
    (row,) = rows_in(tmp_path / "v.parquet")
    assert row["again"]
    assert row["error"].startswith(f"{path}: is not there, or may not be read, on ")
    aside.rename(path)
    done = go(str(path), tmp_path / "v.parquet")
    assert (done.done, done.failed, done.skipped) == (1, 0, 0)
    assert [row["error"] for row in rows_in(tmp_path / "v.parquet")] == [None]


def test_a_folder_that_cannot_be_listed_is_a_row(tmp_path: Path) -> None:
    """A folder that cannot be listed gets a row in the table, which stays until the folder can be listed."""
    path, out = npz(tmp_path / "a.npz", counts(600, 1)), tmp_path / "v.parquet"
    closed = Unlisted(File("/closed", "file", "/closed", -1, ""), "cannot be listed (PermissionError)")
    with open_table(out) as table:
        done = run([closed, *files_of([str(path)])], ASK, Here(), table)
    assert (done.done, done.failed, done.first_failure) == (
        2,
        1,
        "/closed: cannot be listed (PermissionError)",
    )
    assert [(row["file"], row["again"]) for row in rows_in(out)] == [("/closed", True), (str(path), False)]
    assert go(str(path), out).skipped == 1
    assert [row["file"] for row in rows_in(out)] == [str(path)]


def test_nothing_is_left_on_the_disk(s3: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    s3.put_file(npz(tmp_path / "a.npz", counts(600, 1)), "lab/tidy/a.npz")
    os.remove(tmp_path / "a.npz")
    (row,) = identify_file(next(files_of(["s3://lab/tidy"])), ASK)
    assert row.error is None
    assert list(tmp_path.iterdir()) == []


@pytest.mark.long
def test_a_cluster_that_reads_from_s3_with_a_worker_killed(s3: Any, tmp_path: Path) -> None:
    """Two workers read a file in pieces, and one of them is killed meanwhile."""

    n = 1 << 13
    how = msgspec.structs.replace(ASK, how=How(rate_hz=100.0, units="deg/s"), block_bytes=8 * n // 4 + 256)
    noise = 0.05 * white(n, 1, 3)[0]
    killed: list[int] = []
    for name, samples in (("a", n), ("b", 1000), ("c", 700)):
        np.save(tmp_path / f"{name}.npy", noise[:samples])
        s3.put_file(tmp_path / f"{name}.npy", f"lab/pieces/{name}/{name}.npy")
    with two_workers() as cluster:
        from fltea.identification.dask_workers import DaskWorkers

        workers = DaskWorkers(cluster.scheduler_address)
        pids = list(workers._client.run(os.getpid).values())

        def kill_one(progress: Progress) -> None:
            if "piece" in progress.now and not killed:
                killed.append(pids[0])
                os.kill(pids[0], signal.SIGKILL)

        done = identified("s3://lab/pieces/**", how, tmp_path / "v.parquet", workers, report=kill_one)
    assert killed
    assert (done.done, done.failed) == (3, 0)
    identified("s3://lab/pieces", how, tmp_path / "w.parquet", Here())
    assert values(tmp_path / "v.parquet") == values(tmp_path / "w.parquet")
    assert [row["parts"] for row in rows_in(tmp_path / "v.parquet")] == [4, 1, 1]


FILES, DONE = 8, 3


@pytest.mark.slow
def test_killed_and_another_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """If the scheduler is gone, the command ends, and the table holds the finished files.

    With another scheduler, the same command identifies the other files.
    """
    try:
        from fltea.identification import dask_workers
    except ModuleNotFoundError:
        missing("distributed is not installed: pip install -e '.[dask]'")
    monkeypatch.setattr(dask_workers, "CONNECT_S", 3.0)
    (tmp_path / "in").mkdir()
    for i in range(FILES):
        npz(tmp_path / "in" / f"{i}.npz", counts(1000, 1, seed=i))
    out = tmp_path / "v.parquet"
    add = VerdictTable.add
    with closing(Cluster()) as cluster, monkeypatch.context() as patch:

        def add_and_kill(table: VerdictTable, rows: list[Any]) -> None:
            add(table, rows)
            if len(table) == DONE:
                cluster.kill()

        patch.setattr(VerdictTable, "add", add_and_kill)
        assert command(patch, tmp_path / "in", "--dask", cluster.address, "--out", out) == 1
    said = capsys.readouterr().err
    assert f"--dask {cluster.address}: the scheduler is gone" in said
    assert "Traceback" not in said
    first = {row["file"]: row["seconds"] for row in rows_in(out)}
    assert DONE <= len(first) < FILES

    with closing(Cluster()) as cluster:
        assert command(monkeypatch, tmp_path / "in", "--dask", cluster.address, "--out", out) == 0
    assert f"{FILES - len(first)} files done, {len(first)} were done before" in capsys.readouterr().err
    found = rows_in(out)
    assert len(found) == FILES
    assert [row["error"] for row in found] == [None] * FILES
    assert {row["file"]: row["seconds"] for row in found}.items() >= first.items()


class Gone(Here):
    """Workers that cancel every task, like a Dask client that has lost its scheduler."""

    def submit(self, task: Callable[..., Any], *arguments: Any) -> "Future[Any]":
        future: Future[Any] = Future()
        future.cancel()
        future.set_running_or_notify_cancel()
        return future

    def check(self) -> None:
        raise FlteaError("the scheduler is gone")


def test_what_was_under_way_is_no_failure_of_the_files(tmp_path: Path) -> None:
    path = npz(tmp_path / "a.npz", counts(1000, 1))
    with pytest.raises(FlteaError, match="scheduler is gone"):
        identified(str(path), ASK, tmp_path / "v.parquet", Gone())
    with open_table(tmp_path / "v.parquet") as table:
        assert len(table) == 0
    with pytest.raises(FlteaError, match="scheduler is gone"):
        identify_all([ASK.request(path)], ASK.settings, Gone(), Here())


class Liar(Here):
    """Workers that return something else in place of every result."""

    def __init__(self, lie: Callable[[Any], Any]) -> None:
        self._lie = lie

    def submit(self, task: Callable[..., Any], *arguments: Any) -> "Future[Any]":
        future: Future[Any] = Future()
        future.set_result(self._lie(task(*arguments)))
        return future


@pytest.mark.parametrize(
    "lie",
    [
        lambda rows: None,
        lambda rows: [],
        lambda rows: [msgspec.structs.asdict(row) for row in rows],
        lambda rows: [msgspec.structs.replace(row, file="/other") for row in rows],
        lambda rows: [msgspec.structs.replace(row, settings="of another version") for row in rows],
        lambda rows: [msgspec.structs.replace(row, kind=7) for row in rows],
        lambda rows: [msgspec.structs.replace(row, values={"unknown": 1.0}) for row in rows],
    ],
)
def test_what_is_no_answer_is_not_in_the_table(lie: Callable[[Any], Any], tmp_path: Path) -> None:
    """The file's row in the table says that a worker's answer was wrong, and the next run reads the file
    again.
    """
    path, out = npz(tmp_path / "a.npz", counts(1000, 1)), tmp_path / "v.parquet"
    assert identified(str(path), ASK, out, Liar(lie)).failed == 1
    (row,) = rows_in(out)
    assert (row["file"], row["again"]) == (str(path), True)
    assert "does not belong to its task" in row["error"]
    assert go(str(path), out).failed == 0
    assert [row["error"] for row in rows_in(out)] == [None]
