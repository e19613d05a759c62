"""Provides the present fltea, and that of another commit, for benchmarks that compare both.

A commit is built once, into build/against/COMMIT: its Python files and its native module are in a virtual
environment of their own, which takes all other packages from .venv. The two programs therefore differ only in
fltea.
"""

import json
import os
import subprocess
import sys
import sysconfig
import tempfile
import venv
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from tools.bench.measured import ROOT

BUILT = ROOT / "build/against"
READY = "ready"
"""Name of a file that is written at the end of a build. A build without this file was interrupted, and is
repeated.
"""


class Program(NamedTuple):
    """A version of fltea: its name in tables, and the interpreter that imports it."""

    name: str
    python: str

    def command(self, *arguments: object) -> list[str]:
        """Return the command line of `fltea` with these arguments."""
        return [self.python, "-m", "fltea", *map(str, arguments)]


PRESENT = Program("present", sys.executable)
"""The program of the working tree, including uncommitted changes."""


def commit_of(revision: str, root: Path = ROOT) -> str:
    """Return the commit of a revision as 40 digits; an unknown revision raises SystemExit."""
    command = ["git", "-C", str(root), "rev-parse", "--verify", "--quiet", f"{revision}^{{commit}}"]
    found = subprocess.run(command, capture_output=True, text=True, check=False)
    if found.returncode:
        raise SystemExit(f"{revision} is no commit of this repository: git log --oneline shows them.")
    return found.stdout.strip()


def at_commit(revision: str, root: Path = ROOT, built: Path = BUILT) -> Program:
    """Return the program of a commit, built first if necessary. Its name in tables is `revision`."""
    commit = commit_of(revision, root)
    folder = built / commit
    program = Program(revision, str(folder / "bin/python"))
    if not (folder / READY).exists() or not _is_own(program, folder):
        print(f"bench: building {revision} in {folder}, a minute or two", file=sys.stderr, flush=True)
        _build(commit, root, folder)
        if not _is_own(program, folder):
            raise SystemExit(f"{folder}: this interpreter does not import the program that was built there.")
        (folder / READY).touch()
    return program


def imported_from(program: Program) -> list[Path]:
    """Return the paths of the package and the native module that a program imports.

    The list is empty if the program does not start.
    """
    code = "import json, fltea, fltea._native as n; print(json.dumps([fltea.__file__, n.__file__]))"
    command = [program.python, "-c", code]
    try:
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return []
    return [Path(name) for name in json.loads(done.stdout)]


def _is_own(program: Program, folder: Path) -> bool:
    found = imported_from(program)
    return bool(found) and all(path.is_relative_to(folder) for path in found)


def _build(commit: str, root: Path, folder: Path) -> None:
    """Fill the folder with a virtual environment that has this commit's fltea."""
    with tempfile.TemporaryDirectory() as name:
        source, wheels = Path(name, "source"), Path(name, "wheels")
        source.mkdir()
        # The commit's files are unpacked, and not checked out as a git worktree, so that an interrupted build
        # leaves nothing behind in .git.
        archive = _done(["git", "-C", str(root), "archive", commit])
        _done(["tar", "-x", "-C", str(source)], input=archive)
        # The build uses the tools of .venv, such as cmake and ninja.
        _pip("wheel", "--no-deps", "--no-build-isolation", "--wheel-dir", str(wheels), str(source))
        _make_environment(folder)
        python = str(folder / "bin/python")
        _pip("--python", python, "install", "--no-deps", "--no-index", *map(str, wheels.glob("*.whl")))
        # This .pth file makes the packages of .venv available. It is written after the commit's fltea is
        # installed, since pip would otherwise see the fltea of .venv and take it for installed. Python
        # searches the folders named in a .pth file last, so the commit's fltea comes first. The clone's own
        # fltea is not found at all. Only a .pth file inside .venv names its folder, and Python ignores .pth
        # files inside folders that were named by a .pth file.
        (_packages(folder) / "of_the_clone.pth").write_text(
            sysconfig.get_path("purelib") + "\n", encoding="utf-8"
        )


def _make_environment(folder: Path) -> None:
    venv.create(folder, clear=True, symlinks=True)


def _packages(folder: Path) -> Path:
    return Path(sysconfig.get_path("purelib", "venv", {"base": str(folder)}))


def _pip(*arguments: str) -> None:
    paths = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])
    environment = os.environ | {"PATH": paths, "PIP_DISABLE_PIP_VERSION_CHECK": "1"}
    _done([sys.executable, "-m", "pip", "-q", *arguments], env=environment)


def _done(command: Sequence[str], **options: Any) -> bytes:
    """Return the output of a command. If it fails, SystemExit is raised with its error output."""
    done = subprocess.run(command, capture_output=True, check=False, **options)
    if done.returncode:
        raise SystemExit(f"{' '.join(command[:6])} …: {done.stderr.decode(errors='replace')[-2000:]}")
    return bytes(done.stdout)
