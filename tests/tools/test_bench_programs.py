"""Tests the benchmark's build of the program of another commit. This program has its own code, uses the
packages that are installed now, and is built only once.
"""

import subprocess
import sys
from pathlib import Path

import pytest

from tools.bench import programs
from tools.bench.programs import PRESENT, Program, at_commit, commit_of, imported_from

PROJECT = """
[build-system]
requires = ["scikit-build-core"]
build-backend = "scikit_build_core.build"
[project]
name = "fltea"
version = "0.1.0"
[tool.scikit-build]
wheel.cmake = false
wheel.packages = ["host/fltea"]
"""


def git(root: Path, *arguments: str) -> None:
    said = ("-c", "user.name=bench", "-c", "user.email=bench@localhost", "-c", "commit.gpgsign=false")
    subprocess.run(["git", "-C", str(root), *said, *arguments], check=True, capture_output=True)


@pytest.fixture(scope="module")
def repository(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Make a repository with two commits of a program. The program prints which commit it is."""
    root = tmp_path_factory.mktemp("repository")
    package = root / "host/fltea"
    package.mkdir(parents=True)
    (root / "pyproject.toml").write_text(PROJECT)
    (package / "__init__.py").touch()
    (package / "_native.py").touch()
    git(root, "init", "-q")
    for name in ("first", "second"):
        (package / "__main__.py").write_text(f"import numpy, sys; print('{name}', *sys.argv[1:])\n")
        git(root, "add", ".")
        git(root, "commit", "-q", "-m", name)
    return root


def said_by(program: Program) -> str:
    return subprocess.run(
        program.command("run", 1), capture_output=True, text=True, check=True
    ).stdout.strip()


@pytest.mark.slow
def test_a_commit_is_built_once_and_says_what_it_said_then(
    repository: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = at_commit("HEAD~1", repository, tmp_path)
    assert (first.name, said_by(first)) == ("HEAD~1", "first run 1")
    assert all(path.is_relative_to(tmp_path) for path in imported_from(first))
    here = Path(sys.prefix).parent
    assert not any(path.is_relative_to(here) for path in imported_from(first))

    commit, built = commit_of("HEAD~1", repository), list[str]()
    monkeypatch.setattr(programs, "_build", lambda commit, root, folder: built.append(commit))
    assert at_commit(commit[:10], repository, tmp_path).python == first.python
    assert built == []
    (tmp_path / commit / programs.READY).unlink()
    at_commit("HEAD~1", repository, tmp_path)
    assert built == [commit]


def test_a_program_that_imports_another_one_is_refused(
    repository: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def build(commit: str, root: Path, folder: Path) -> None:
        (folder / "bin").mkdir(parents=True)
        python = folder / "bin/python"
        python.write_text(f'#!/bin/sh\nexec {sys.executable} "$@"\n')
        python.chmod(0o755)

    monkeypatch.setattr(programs, "_build", build)
    with pytest.raises(SystemExit, match="does not import the program that was built there"):
        at_commit("HEAD", repository, tmp_path)


def test_the_present_program_is_that_of_this_clone() -> None:
    assert PRESENT.command("run", "--once", 3) == [sys.executable, "-m", "fltea", "run", "--once", "3"]
    assert (programs.ROOT / "host/fltea/__init__.py") in imported_from(PRESENT)


def test_what_is_no_commit_is_said(repository: Path, tmp_path: Path) -> None:
    with pytest.raises(SystemExit, match="HEAD~9 is no commit of this repository"):
        at_commit("HEAD~9", repository, tmp_path)
