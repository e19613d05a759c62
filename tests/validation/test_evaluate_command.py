"""The evaluation as a user calls it, on a plan that is over in a second."""

import functools
import json
import os
from collections.abc import Callable
from pathlib import Path

import pytest
from fltea.identification import workers
from validation_support import TINY, Backwards

from tools.validation.evaluate import figures, run
from tools.validation.evaluate.run import Result
from tools.validation.evaluate.summaries import to_csv, to_json

Call = Callable[..., tuple[int, str, str]]
PNGS = ("coverage", "error", "live", "settings")


@pytest.fixture
def evaluate(validate: Call, monkeypatch: pytest.MonkeyPatch) -> Call:
    """Call the command with TINY for --quick."""
    monkeypatch.setattr(run, "quick_plan", lambda seeds: TINY)
    return functools.partial(validate, "evaluate")


@pytest.mark.slow
def test_table_and_files(
    evaluate: Call, tiny: Result, drawn: dict[str, bytes], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The same arguments give the same numbers, whoever works in whatever order."""
    monkeypatch.setattr(workers, "open_local", lambda jobs: Backwards() if jobs == 3 else None)
    monkeypatch.setattr(figures, "draw", lambda result: drawn if result == tiny else {})
    code, out, err = evaluate("--quick", "--jobs", "3")
    folder = tmp_path / "build/validation"
    names = ["evaluation.csv", "evaluation.json", *(f"evaluation_{name}.png" for name in PNGS)]
    assert code == 0
    assert err == "validation: 6 files in build/validation\n"
    assert sorted(path.name for path in folder.iterdir()) == names
    assert (folder / "evaluation.json").read_bytes() == to_json(tiny)
    assert (folder / "evaluation.csv").read_text() == to_csv(tiny)
    assert (folder / "evaluation_error.png").read_bytes() == drawn["error"]
    for words in ("estimator", "on white noise", "setting", "joint, Q and R fitted", "After 1,500 samples"):
        assert words in out


@pytest.fixture
def at_once(monkeypatch: pytest.MonkeyPatch, tiny: Result) -> None:
    """The evaluation has been made before."""
    monkeypatch.setattr(run, "evaluate", lambda plan, workers, progress: tiny)


@pytest.mark.usefixtures("at_once")
def test_json_without_figures(evaluate: Call, tiny: Result, tmp_path: Path) -> None:
    code, out, _ = evaluate("--quick", "--jobs", "1", "--json", "--no-figures", "--out", "here")
    assert code == 0
    assert json.loads(out) == json.loads(to_json(tiny))
    assert len(list((tmp_path / "here").iterdir())) == 2


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--seeds", "1"), "--seeds"),
        (("--jobs", "0"), "--jobs"),
        (("--quick", "--out", "taken"), "--out taken: cannot be written to"),
        (("--nonsense",), "--nonsense"),
    ],
)
def test_mistakes(evaluate: Call, tmp_path: Path, arguments: tuple[str, ...], words: str) -> None:
    (tmp_path / "taken").write_text("a file")
    code, out, err = evaluate(*arguments)
    assert (code, out) == (2, "")
    assert words in err


@pytest.mark.usefixtures("at_once")
def test_a_full_disk_leaves_no_half_file(
    evaluate: Call, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The file that was there stays."""
    folder = tmp_path / "out"
    folder.mkdir()
    (folder / "evaluation.json").write_text("old")

    def full(descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)  # a disk may say so only when it has to have it all
    code, _, err = evaluate("--quick", "--jobs", "1", "--no-figures", "--out", "out")
    assert code == 1
    assert "evaluation.json: cannot be written" in err
    assert [(path.name, path.read_text()) for path in folder.iterdir()] == [("evaluation.json", "old")]
