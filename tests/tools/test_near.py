"""Tests which commands `make near` runs for which changed files."""

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from tools import near
from tools.near import plan

ROOT = Path(__file__).parents[2]


def test_a_room_is_checked_typed_and_its_tests_run() -> None:
    found = plan(["host/fltea/recording/kind.py", "host/fltea/recording/bag/of.py"])
    assert found.python == ["host/fltea/recording/bag/of.py", "host/fltea/recording/kind.py"]
    assert found.types == ["host/fltea/recording"]
    assert (found.tests, found.cxx) == (["tests/recording"], [])


@pytest.mark.parametrize(
    ("name", "tests"),
    [
        ("host/native/engine.cpp", ["tests/estimator", "tests/native", "tests/spectrum", "tests/wire"]),
        (
            "firmware/core/engine/pack.hpp",
            ["tests/estimator", "tests/native", "tests/spectrum", "tests/wire"],
        ),
        ("firmware/core/link.h", ["tests/firmware", "tests/protocol"]),
        ("host/fltea/diagnostics/finding.py", ["tests/machine"]),
        ("host/fltea/settings/how.py", ["tests/cli", "tests/settings", "tests/site"]),
        ("host/fltea/recording/dialects.toml", ["tests/recording"]),
        ("host/docs/guide/bias.md", ["tests/site/test_site_texts.py"]),
        ("host/notebooks/a.ipynb", ["tests/api/test_notebooks.py"]),
        ("tests/api/test_api.py", ["tests/api/test_api.py"]),
        ("tests/recording/corpus/a.csv", ["tests/recording"]),
        ("tools/due_emulator/bus.py", ["tests/due_emulator"]),
        ("pyproject.toml", ["tests/dist"]),
        ("LICENSE", []),
    ],
)
def test_tests_mirror_files(name: str, tests: list[str]) -> None:
    assert plan([name]).tests == tests
    assert all((ROOT / one).exists() for one in tests)


def test_the_tests_that_go_through_the_rows_of_outputs_are_near_to_these() -> None:
    uses = re.compile(r"\bOUTPUTS\b|\bEACH_OUTPUT\b")
    files = [path for path in (ROOT / "tests").glob("*/test_*.py") if path != Path(__file__)]
    found = {f"{path.relative_to(ROOT)}" for path in files if uses.search(path.read_text(encoding="utf-8"))}
    (name,) = near.OF_OUTPUTS
    tests = plan([name]).tests
    far = {test for test in found if test not in tests and str(Path(test).parent) not in tests}
    assert not far, f"tools/near.py: OF_OUTPUTS has no {far}"


def test_what_is_gone_is_neither_formatted_nor_typed_but_its_tests_run() -> None:
    found = plan([], ["host/fltea/recording/kind.py", "host/native/old.hpp"])
    assert (found.python, found.cxx, found.types) == ([], [], [])
    assert "tests/recording" in found.tests


def test_a_file_of_a_folder_that_is_run_is_not_run_twice() -> None:
    assert plan(["tests/wire/test_x.py", "host/fltea/wire/ports.py"]).tests == ["tests/wire"]


def test_a_stand_in_runs_the_tests_that_use_it_unless_they_are_many() -> None:
    files = [f"tests/wire/test_{i}.py" for i in range(near.MOST_USERS)]
    found = plan(["tests/rig/few.py"], users=lambda module: files if module == "few" else [])
    assert (found.tests, found.left_out, found.types) == (files, [], ["tests/rig/few.py"])
    found = plan(["tests/rig/many.py"], users=lambda _: [*files, "tests/wire/test_more.py"])
    assert (found.tests, found.left_out) == ([], ["tests/rig/many.py"])


def test_the_nearest_tests_run_first_and_each_file_once() -> None:
    changed = ["host/fltea/wire/ports.py", "tests/wire/test_words.py"]
    files = near.nearest_first(plan(changed).tests, changed)
    assert files[:2] == ["tests/wire/test_words.py", "tests/wire/test_ports.py"]
    assert {*files} == {path.relative_to(ROOT).as_posix() for path in (ROOT / "tests/wire").glob("test_*.py")}
    assert len(files) == len({*files})
    last = near.commands(plan(changed))[-1][-1].split()
    assert last[3:5] == ["tests/tools/test_sizes.py", "tests/tools/test_unused.py"]
    assert last[5:] == files


def test_no_test_begins_after_the_time_for_tests() -> None:
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-q",
        "-rs",
        "--no-test-after",
        "0",
        "tests/tools/test_collected.py",
    ]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0
    assert "more than 0 s have passed; `make test` runs this test" in done.stdout
    assert "passed in" not in done.stdout


def test_users_are_found_by_what_they_import() -> None:
    assert "tests/tools/test_near.py" in near.users_of("near")
    assert "tests/recording/test_corpus.py" in near.users_of("corpus_files")
    assert near.users_of("no_such_module") == []


def test_every_python_file_is_type_checked() -> None:
    """The folders with type-checked files stand in pyproject.toml. Only one Python file is outside of them;
    only the build reads this file.
    """
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["mypy"]
    listed = subprocess.run(["git", "ls-files", "*.py"], cwd=ROOT, capture_output=True, text=True, check=True)
    folders = tuple(f"{folder}/" for folder in settings["files"])
    checked = [name for name in listed.stdout.split() if name.startswith(folders)]
    assert {*listed.stdout.split()} - {*checked} == {"host/native/source_hash.py"}
    assert [name for name in checked if not name.startswith(near.typed(name))] == []


def test_it_says_what_it_runs() -> None:
    command = [sys.executable, "-m", "tools.near", "--dry-run", "--since", "HEAD"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    assert "near: python -m tools.generated --check" in done.stdout
    assert re.match(r"near: \d+ files differ from HEAD\n", done.stdout)
    done = subprocess.run([*command[:-1], "no-such"], cwd=ROOT, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (1, "")
    assert "near: git diff" in done.stderr


def test_nothing_is_run_after_a_failure_which_is_told_at_the_end(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(near, "changed", lambda _: ("HEAD", ["tools/near.py"]))
    monkeypatch.setattr(near, "commands", lambda _: [["true"], ["false", "it"], ["echo", "went on"]])
    monkeypatch.setattr(near, "_git", lambda *_: ["+++ b/CHANGELOG.md", "-old"])
    assert near.main([]) == 1
    out, err = capfd.readouterr()
    assert (err, "warning: CHANGELOG.md has no new line" in out) == ("near: failed: false it\n", True)
    assert "went on" not in out
    monkeypatch.setattr(near, "commands", lambda _: [["true"]])
    monkeypatch.setattr(near, "_git", lambda *_: ["+++ b/CHANGELOG.md", "+- new"])
    assert near.main([]) == 0
    assert "warning" not in capfd.readouterr().out
