"""`make validate` as a user calls it, on records at 5 Hz.

Finished results are kept and not computed again.
"""

import functools
import json
import os
import sys
import threading
from collections.abc import Callable
from concurrent.futures import BrokenExecutor, Future
from pathlib import Path
from typing import Any

import pytest
from fltea.identification.workers import Here
from fltea.records.errors import FlteaError

from tools.validation import __main__ as program
from tools.validation.gallery import records
from tools.validation.runner import Row, Task, run
from tools.validation.tables import Table, interval, share_within

Call = Callable[..., tuple[int, str, str]]


@pytest.fixture
def validate(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Call:
    """Run the command in an empty folder; return exit code, stdout, stderr."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(records, "QUICK", (5.0, 30.0))

    def call(*arguments: str) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["validation", *arguments])
        try:
            code = program.main()
        except SystemExit as end:
            code = int(end.code or 0)
        return code, *capsys.readouterr()

    return functools.partial(call, "gallery", "--quick", "--jobs", "1")


def test_tables_and_files(validate: Call, tmp_path: Path) -> None:
    code, out, err = validate("--only", "white", "--only", "outliers", "--no-figures")
    assert code == 0
    assert "verdicts are right" in out
    assert err.endswith("2 files of gallery in build/validation\n")
    folder = tmp_path / "build/validation"
    assert sorted(file.name for file in folder.iterdir()) == ["gallery.md", "gallery.ndjson"]
    assert len((folder / "gallery.ndjson").read_text().splitlines()) == 4
    assert "### Truth against verdict" in (folder / "gallery.md").read_text()


def test_json_and_resumed(validate: Call, tmp_path: Path) -> None:
    """If the last line of the file was cut off, its result is computed again. Complete lines are kept."""
    first = validate("--only", "white", "--no-figures", "--json")
    kept = tmp_path / "build/validation/gallery.ndjson"
    lines = kept.read_text().splitlines(keepends=True)
    assert first[1] == "".join(lines)
    changed = json.loads(lines[0])
    changed["rows"][0]["text"] = "as it was kept"
    kept.write_text(json.dumps(changed) + "\n" + lines[1][:20])
    code, out, _ = validate("--only", "white", "--no-figures", "--json", "--resume")
    assert code == 0
    again = out.splitlines(keepends=True)
    assert "as it was kept" in again[0]
    assert again[1:] == lines[1:]


def test_a_run_against_an_earlier_one(validate: Call, tmp_path: Path) -> None:
    validate("--only", "outliers", "--no-figures", "--out", "before")
    only = "--only", "outliers", "--no-figures", "--against", "before/gallery.ndjson"
    assert "Of 1 cells of both runs: 0 better, 0 worse, 0 other, as good, 1 same." in validate(*only)[1]
    assert "Of 0 cells" in validate(*only, "--first", "1")[1]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--only", "pink elephants"), "no name contains pink elephants"),
        (("--seeds", "0"), "--seeds"),
        (("--out", "taken"), "--out taken: cannot be written to"),
        (("--resume", "--only", "white", "--no-figures"), "was not written by this program"),
        (("--nonsense",), "--nonsense"),
        (("--against", "nowhere.ndjson"), "nowhere.ndjson: there is no such file"),
    ],
)
def test_mistakes(validate: Call, tmp_path: Path, arguments: tuple[str, ...], words: str) -> None:
    (tmp_path / "taken").write_text("a file")
    (tmp_path / "build/validation").mkdir(parents=True)
    (tmp_path / "build/validation/gallery.ndjson").write_text("{}\n")
    code, out, err = validate(*arguments)
    assert (code, out) == (2, "")
    assert words in err


def test_a_full_disk_leaves_no_half_file(
    validate: Call, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """If the disk is full, the table of the earlier run is kept."""
    folder = tmp_path / "build/validation"
    folder.mkdir(parents=True)
    (folder / "gallery.md").write_text("old")

    def full(descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)  # a disk may report the error only when data are flushed
    code, _, err = validate("--only", "outliers", "--no-figures")
    assert code == 1
    assert "cannot be written" in err
    assert (folder / "gallery.md").read_text() == "old"


class Backwards(Here):
    """Workers for the validation. They have up to three tasks at a time, and always finish the newest of
    these first.
    """

    slots = 4

    def __init__(self) -> None:
        self._tasks: list[tuple[Future[Any], Callable[..., Any], tuple[Any, ...]]] = []

    def submit(self, task: Callable[..., Any], *arguments: Any) -> Future[Any]:
        future: Future[Any] = Future()
        self._tasks.append((future, task, arguments))
        threading.Timer(0.02, self._work).start()
        return future

    def _work(self) -> None:
        future, task, arguments = self._tasks.pop()
        future.set_result(task(*arguments))


class Dies(Here):
    def submit(self, task: Callable[..., Any], *arguments: Any) -> Future[Any]:
        raise BrokenExecutor("died")


def count(number: int) -> list[Row]:
    return [{"number": number, "pair": (number, float("nan"))}]


def test_a_process_that_died_is_told(tmp_path: Path) -> None:
    with pytest.raises(FlteaError, match="--jobs 1"):
        run([Task("one", count, (1,))], Dies(), tmp_path / "kept.ndjson")


def test_nothing_depends_on_the_workers(tmp_path: Path) -> None:
    wanted = [Task(str(i), count, (i,), samples=i % 3) for i in range(8)]
    here = run(wanted, Here(), tmp_path / "here.ndjson")
    assert [row["number"] for row in here] == list(range(8))
    assert here[3]["pair"] == [3, None]
    assert run(wanted, Backwards(), tmp_path / "backwards.ndjson") == here
    assert (tmp_path / "here.ndjson").read_bytes() == (tmp_path / "backwards.ndjson").read_bytes()


def test_a_table_and_shares() -> None:
    assert Table("A", ("b", "c"), [("1", "2")]).markdown() == "### A\n\n| b | c |\n| --- | --- |\n| 1 | 2 |\n"
    # the interval of a proportion by Wilson's formula
    assert interval(950, 1_000) == pytest.approx((0.93470, 0.96187), abs=1e-4)
    assert share_within(10, 10) == "100.0% (72…100)"
