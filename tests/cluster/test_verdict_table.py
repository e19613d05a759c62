"""The table of verdicts keeps its rows even if a process is killed at any time.

Every file is in the table once.
"""

import contextlib
import os
import subprocess
import sys
from pathlib import Path

import pytest
from fltea.cluster import verdict_table
from fltea.cluster.listing import JOURNAL, File
from fltea.cluster.rows import Key, Row
from fltea.cluster.verdict_table import VerdictTable
from fltea.records.errors import FlteaError, UsageError

from tests.rig.cluster_support import ASK, file, open_table, rows_in

DIGEST = ASK.digest()


def rows(of: File, axes: int = 2) -> list[Row]:
    key = Key(of, DIGEST)
    return [
        key.row(axis=f"gyro_{'xyz'[i]}", values={"alpha": 0.5 + i}, data_checks=["short"])
        for i in range(axes)
    ]


def test_what_was_added_is_there_and_done(tmp_path: Path) -> None:
    out = tmp_path / "deep" / "v.parquet"
    with open_table(out) as table:
        assert file(1) not in table
        table.add(rows(file(1)))
        assert file(1) in table
    with open_table(out) as table:
        assert file(1) in table
        for other in (file(2), file(1, size=11), file(1, stamp="2")):
            assert other not in table
        table.add(rows(file(2), axes=1))
    with open_table(out, "other settings") as table:
        assert file(1) not in table
    found = rows_in(out)
    assert [(row["file"], row["axis"], row["alpha"]) for row in found] == [
        ("s3://lab/1.csv", "gyro_x", 0.5),
        ("s3://lab/1.csv", "gyro_y", 1.5),
        ("s3://lab/2.csv", "gyro_x", 0.5),
    ]
    assert found[0]["data_checks"] == ["short"]
    assert found[0]["K"] is None


def test_a_long_journal_becomes_parquet(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A long journal is written to a Parquet file and begins anew. Therefore the size of the journal and the
    memory in use are limited.
    """
    monkeypatch.setattr(verdict_table, "JOURNAL_BYTES", 2000)
    with open_table(tmp_path / "v.parquet") as table:
        for number in range(40):
            table.add(rows(file(number)))
            assert (tmp_path / "v.parquet" / JOURNAL).stat().st_size < 4000
        assert len(list((tmp_path / "v.parquet").glob("part-*.parquet"))) > 3
    assert len(rows_in(tmp_path / "v.parquet")) == 80


SCRIPT = """
import os, sys
from pathlib import Path
sys.path[:0] = {path!r}
from tests.cluster.test_verdict_table import file, rows, verdict_table, VerdictTable, DIGEST
verdict_table.JOURNAL_BYTES = {journal}
table = VerdictTable(Path({out!r}), DIGEST)
for number in range(5):
    table.add(rows(file(number)))
os.kill(os.getpid(), 9)
"""


@pytest.mark.slow
def test_a_kill_takes_nothing_that_was_added(tmp_path: Path) -> None:
    out = tmp_path / "v.parquet"
    script = SCRIPT.format(path=sys.path, journal=1500, out=str(out))
    assert subprocess.run([sys.executable, "-c", script]).returncode == -9
    journal = out / JOURNAL
    assert journal.stat().st_size
    # the journal ends with half a line, as if the program was killed while it wrote this line
    with journal.open("ab") as cut:
        cut.write(b'[{"file":"s3://lab/7.c')
    with open_table(out) as table:
        assert all(file(number) in table for number in range(5))
        table.add(rows(file(9)))
    assert [row["file"][9:10] for row in rows_in(out)] == [c for c in "012349" for _ in range(2)]


def test_a_kill_between_parquet_and_journal_doubles_nothing(tmp_path: Path) -> None:
    out = tmp_path / "v.parquet"
    with open_table(out) as table:
        table.add(rows(file(1)))
        journal = (out / JOURNAL).read_bytes()
    before = rows_in(out)
    (out / JOURNAL).write_bytes(journal)
    with open_table(out):
        pass
    assert rows_in(out) == before
    assert [row["axis"] for row in before] == ["gyro_x", "gyro_y"]


@pytest.mark.parametrize("killed", [False, True])
def test_what_was_not_the_files_fault_is_tried_again(tmp_path: Path, killed: bool) -> None:
    """A failure that was not the file's fault is tried again, even if its row is still in the journal."""
    out = tmp_path / "v.parquet"
    table = VerdictTable(out, DIGEST)
    with contextlib.closing(table):
        table.add([Key(file(1), DIGEST).row(error="no network", again=True)])
        table.add([Key(file(2), DIGEST).row(error="is no recording")])
        table.add(rows(file(3)))
        if killed:
            table.close(keep_journal=True)
    if not killed:
        assert [row["error"] for row in rows_in(out)] == ["no network", "is no recording", None, None]
    with open_table(out) as table:
        assert [file(number) in table for number in (1, 2, 3)] == [False, True, True]
        table.add(rows(file(1)))
    assert [row["error"] for row in rows_in(out)] == [None, None, "is no recording", None, None]


def test_one_program_at_a_time(tmp_path: Path) -> None:
    with open_table(tmp_path / "v.parquet"), pytest.raises(UsageError, match="another program"):
        VerdictTable(tmp_path / "v.parquet", DIGEST)


def test_what_is_no_table_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "file.parquet").write_bytes(b"x")
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos" / "a.jpg").write_bytes(b"x")
    (tmp_path / "bad").mkdir()
    (tmp_path / "bad" / "part-000001.parquet").write_bytes(b"x")
    for name, text in (("file.parquet", "is a file"), ("photos", "'a.jpg'"), ("bad", "not a valid file")):
        with pytest.raises(UsageError, match=text):
            VerdictTable(tmp_path / name, DIGEST)
    assert (tmp_path / "photos" / "a.jpg").exists()


def test_a_full_disk_leaves_no_half_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write = os.write
    with open_table(tmp_path / "v.parquet") as table:
        table.add(rows(file(1)))

        def full(descriptor: int, data: bytes) -> int:
            if len(data) > 20:
                return write(descriptor, data[:20])
            raise OSError(28, "No space left on device")

        monkeypatch.setattr(os, "write", full)
        # Shorten the file by twenty bytes at a time, until only a few bytes are left.
        with pytest.raises(FlteaError, match="No space left"):
            table.add(rows(file(2)))
        monkeypatch.undo()
        assert file(2) not in table
        table.add(rows(file(3)))
    assert [row["file"] for row in rows_in(tmp_path / "v.parquet")] == [
        *["s3://lab/1.csv"] * 2,
        *["s3://lab/3.csv"] * 2,
    ]
