"""Many files to a table: each once, failures as rows, and nothing done again that was done."""

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from cluster_support import ASK, open_table, rows_in, s3_server
from fltea.cluster.listing import files_of
from fltea.cluster.run import Progress, run
from fltea.cluster.whole import identify_file
from fltea.identify.workers import Here
from identify_files import counts, npz


@pytest.fixture(scope="module")
def s3() -> Iterator[Any]:
    with s3_server() as system:
        yield system


def go(pattern: str, out: Path, **options: Any) -> Progress:
    with open_table(out) as table:
        return run(files_of([pattern]), ASK, Here(), table, **options)


def test_from_s3_and_again(s3: Any, tmp_path: Path) -> None:
    """Two recordings and one that is none; the second time nothing is done, and a file that changed is."""
    local = npz(tmp_path / "a.npz", counts(600, 2))
    s3.put_file(local, "lab/2026-11/bench 1/a.npz")
    s3.pipe("lab/2026-11/b.npz", b"PK none")
    s3.put_file(local, "lab/2026-10/old.npz")
    out = tmp_path / "v.parquet"
    told: list[int] = []
    done = go("s3://lab/2026-11/**/*.npz", out, tell=lambda progress: told.append(progress.done))
    assert (done.done, done.failed, done.skipped) == (2, 1, 0)
    assert told == [1, 2, 2]
    bad, x, y = rows_in(out)
    assert (bad["file"], bad["axis"], bad["again"]) == ("s3://lab/2026-11/b.npz", None, False)
    assert bad["error"].startswith("s3://lab/2026-11/b.npz: cannot be read as .npz")
    assert (x["axis"], y["axis"]) == ("gyro_x", "gyro_y")
    (alone,) = (row for row in identify_file(next(files_of([str(local)])), ASK) if row.axis == "gyro_x")
    for name in ("kind", "text", "p_white", "R", "N", "N_low", "fltea_alpha", "lsb", "samples", "traps"):
        assert x[name] == getattr(alone, name)

    again = go("s3://lab/2026-11/**/*.npz", out)
    assert (again.done, again.skipped) == (0, 2)
    s3.put_file(npz(tmp_path / "c.npz", counts(600, 1, seed=2)), "lab/2026-11/b.npz")
    mended = go("s3://lab/2026-11/**/*.npz", out)
    assert (mended.done, mended.failed, mended.skipped) == (1, 0, 1)
    assert [row["error"] is None for row in rows_in(out) if row["file"].endswith("b.npz")] == [False, True]


def test_a_file_that_goes_away_is_tried_again(s3: Any, tmp_path: Path) -> None:
    s3.pipe("lab/gone/a.npz", b"PK none")
    files = list(files_of(["s3://lab/gone"]))
    s3.rm("lab/gone/a.npz")
    with open_table(tmp_path / "v.parquet") as table:
        assert run(files, ASK, Here(), table).failed == 1
    (row,) = rows_in(tmp_path / "v.parquet")
    assert row["again"]
    assert "FileNotFoundError" in row["error"]


def test_a_file_that_changed_since_it_was_listed(s3: Any, tmp_path: Path) -> None:
    s3.pipe("lab/change/a.npz", b"PK none")
    files = list(files_of(["s3://lab/change"]))
    s3.pipe("lab/change/a.npz", b"PK none, and more")
    (row,) = identify_file(files[0], ASK)
    assert row.again
    assert "had 7 when listed" in (row.error or "")


def test_nothing_is_left_on_the_disk(s3: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    s3.put_file(npz(tmp_path / "a.npz", counts(600, 1)), "lab/tidy/a.npz")
    os.remove(tmp_path / "a.npz")
    (row,) = identify_file(next(files_of(["s3://lab/tidy"])), ASK)
    assert row.error is None
    assert list(tmp_path.iterdir()) == []


def test_no_room_for_a_copy(s3: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    s3.pipe("lab/large/a.npz", b"PK none")
    monkeypatch.setattr("fltea.cluster.fetch.LEAST_FREE", 1 << 60)
    (row,) = identify_file(next(files_of(["s3://lab/large"])), ASK)
    assert "TMPDIR" in (row.error or "")
