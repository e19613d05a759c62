"""A Dask scheduler that is killed: what is told, what is kept, and a second run with another one."""

from collections.abc import Callable
from concurrent.futures import Future
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from cluster_support import ASK, command, identified, open_table, rows_in
from fltea.cluster.verdict_table import VerdictTable
from fltea.identification.run import identify_all
from fltea.identification.workers import Here
from fltea.records.errors import FlteaError
from identify_files import counts, npz
from toolchain import missing

from tools.faults.cluster import Cluster

FILES, DONE = 8, 3


@pytest.mark.slow
def test_killed_and_another_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The command ends, with what was done in the table; with another scheduler it does the others."""
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
    """What is handed to it is cancelled, as by a client that has lost its scheduler."""

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
