"""`fltea identify --out`: what it refuses and says, its exit codes, and how it goes on after a stop."""

import json
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any
from unittest import mock

import pytest
from fltea.cli import many
from fltea.cluster.listing import JOURNAL
from fltea.cluster.run import Progress
from fltea.records.errors import UsageError

from tests.rig.cluster_support import command, rows_in
from tests.rig.host_support import wait_until
from tests.rig.identify_files import counts, npz

Command = Callable[..., tuple[int, str]]
QUICK = ("--shuffles", "0", "--window", "100", "--startup", "100", "--jobs", "1")


@pytest.mark.parametrize(
    ("files", "out", "others", "text"),
    [
        (
            ["a.npz", "s3://lab/a.npz"],
            None,
            [],
            r"s3://lab/a.npz: files by URL need a table .* --out verdicts.parquet",
        ),
        (["a.npz"], "report", [], r"call it NAME\.parquet\. For a page use --report DIR"),
        (["a.npz"], "v.parquet", ["--json"], "--json and --out do not go together"),
        (["a.npz", ""], "v.parquet", [], r"a file name is empty"),
        ([""], None, [], "a file name is empty"),
    ],
)
def test_what_does_not_go_together(files: list[str], out: str | None, others: list[str], text: str) -> None:
    with pytest.raises(UsageError, match=text):
        many.check(files, Path(out) if out else None, others)


def test_a_summary() -> None:
    progress = Progress(listed=1206, skipped=3, done=1203, failed=2, read=2_500_000_000)
    assert many._line(progress, 50.0) == (
        "1,203 files done, 2 of them with a failure, 3 were done before, 2,500.0 MB in 50 s (50.0 MB/s)"
    )


@pytest.fixture
def here(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Command:
    """Run the command in this process; return its exit code and stderr."""

    def run(*arguments: object, jobs: int = 1) -> tuple[int, str]:
        code = command(monkeypatch, *arguments, "--jobs", jobs)
        said = capsys.readouterr()
        assert said.out == ""
        return code, said.err

    return run


def journal_rows(journal: Path) -> list[dict[str, Any]]:
    return [row for line in journal.read_text().splitlines() for row in json.loads(line)]


@pytest.mark.slow
def test_a_client_that_is_killed_and_called_again(here: Command, tmp_path: Path) -> None:
    """Rows that were finished before stay unchanged, with their durations. Every file has one row."""
    (tmp_path / "in").mkdir()
    for i in range(8):
        npz(tmp_path / "in" / f"{i}.npz", counts(2000, 1, seed=i))
    out = tmp_path / "v.parquet"
    line = [sys.executable, "-m", "fltea", "identify", str(tmp_path / "in"), "--out", str(out), *QUICK]
    client = subprocess.Popen(line, stderr=subprocess.DEVNULL)
    journal = out / JOURNAL
    wait_until(lambda: journal.exists() and journal.read_bytes().count(b"\n") >= 2, "two files")
    client.send_signal(signal.SIGKILL)
    client.wait()
    done = journal.read_bytes().count(b"\n")
    assert done < 8
    first = {row["file"]: row["seconds"] for row in journal_rows(journal)}
    code, said = here(tmp_path / "in", "--out", out)
    assert code == 0
    assert f"{8 - done} files done, {done} were done before" in said
    found = {row["file"]: row["seconds"] for row in rows_in(out)}
    assert len(rows_in(out)) == len(found) == 8
    assert {name: found[name] for name in first} == first
    assert here(tmp_path / "in", "--out", out)[0] == 0
    assert len(rows_in(out)) == 8


def test_a_failure_ends_with_one_in_whichever_run_it_was_found(here: Command, tmp_path: Path) -> None:
    """The exit code is 1 if the table has a failure of a file that the command was asked for, even if an
    earlier run found this failure.

    Failures of other files in the table do not count.
    """
    (tmp_path / "in").mkdir()
    bad, out = tmp_path / "in" / "bad.npz", tmp_path / "v.parquet"
    bad.write_bytes(b"PK none")
    npz(tmp_path / "in" / "good.npz", counts(1000, 1))
    for done in ("2 files done, 1 of", "0 files done, 2 were done before, 1 of"):
        code, said = here(tmp_path / "in", "--out", out)
        assert code == 1
        assert f"{done} them with a failure" in said
        first = f"{bad}: cannot be read as .npz"
        assert f"error: 1 of 2 files have a failure in the table (column error). The first: {first}" in said
    assert here(tmp_path / "in" / "good.npz", "--out", out)[0] == 0
    npz(bad, counts(1000, 1, seed=2))
    assert here(tmp_path / "in", "--out", out)[0] == 0


def test_ctrl_c_says_how_to_go_on(here: Command, tmp_path: Path) -> None:
    path, out = npz(tmp_path / "a.npz", counts(1000, 1)), tmp_path / "v.parquet"
    with mock.patch("fltea.cluster.run.run", side_effect=KeyboardInterrupt):
        code, said = here(path, "--out", out)
    assert code == 130
    assert f"{out}: stopped. The same command goes on" in said
    assert here(path, "--out", out)[0] == 0


def test_a_file_that_is_named_twice_is_done_once(here: Command, tmp_path: Path) -> None:
    """A file that is named twice is identified once, even if its first task is not finished when it is named
    again.
    """
    path, out = npz(tmp_path / "a.npz", counts(1000, 1)), tmp_path / "v.parquet"
    assert here(path, f"{tmp_path}/*.npz", "--out", out, jobs=2)[0] == 0
    assert [row["axis"] for row in rows_in(out)] == ["gyro_x"]


def test_nothing_there(here: Command, tmp_path: Path) -> None:
    code, said = here(f"{tmp_path}/**/*.mcap", "--out", tmp_path / "v.parquet")
    assert code == 2
    assert "no recording is there" in said
