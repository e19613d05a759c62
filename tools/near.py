"""Checks the files that were changed: their style and types, the generated files, and the tests for them.

It ends at the first of these that fails. The tests nearest to the change run first: those that were changed,
then those that import what was changed. After `TESTS_S` the rest is left out, and counted as skipped.

The changed files are those that differ from `origin/main` (without such a branch: from the commit before the
last one), and those that git does not track yet. Usage:
python -m tools.near [--since COMMIT] [--dry-run]; `make near`.
"""

import argparse
import re
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
CXX = {".cpp", ".hpp", ".h"}
ENGINE = ("native", "spectrum", "estimator", "wire")
"""Folders below tests/ with the tests of the native module and of the engine's headers."""
ALSO = {"cli": ("site",), "diagnostics": ("machine",), "settings": ("site", "cli")}
"""For some packages of the host: further folders below tests/ with tests of the package. For every package,
there may also be a folder tests/PACKAGE.
"""
TESTS_OF = {
    "host/native/": ENGINE,
    "firmware/core/engine/": ENGINE,
    "firmware/": ("firmware", "protocol"),
    "protocol/": ("protocol",),
    "host/fltea/__init__.py": ("api",),
    "host/fltea/__main__.py": ("cli/test_safe_path.py",),
    "host/fltea/_native.pyi": ("native/test_source_hash.py",),
    "tests/conftest.py": ("native/test_source_hash.py",),
    "host/notebooks/": ("api/test_notebooks.py",),
    "host/docs/": ("site/test_site_texts.py",),
    "pyproject.toml": ("dist",),
    "constraints.txt": ("dist",),
    "tools/hashes": ("dist",),
    "Makefile": ("native/test_source_hash.py",),
}
"""For the beginning of a file's path: the folders or files below tests/ that test this file. If several
beginnings match, the first decides.
"""
OF_OUTPUTS = {
    "host/fltea/settings/outputs.py": (
        "tests/e2e/test_rotation.py",
        "tests/service/test_output_losses.py",
        "tests/service/test_output_table.py",
        "tests/sinks/test_sink_contract.py",
        "tests/sources/test_source_table.py",
    )
}
"""The file with the table of outputs: the tests in other folders that go through its rows."""
OF_ALL_CODE = ("tests/tools/test_sizes.py", "tests/tools/test_unused.py")
"""Tests that check all code at once: the sizes of files and functions, and that no function is unused. They
run after every change of code.
"""

MOST_USERS = 8
"""Largest number of test files that `make near` runs for one changed module of `tools` or `tests/rig`. If
more test files use the module, none of them runs for it; `make test` runs them.
"""

TESTS_S = 75
"""Time after which no further test begins [s]. `make test` runs all of them."""

MOST_SAID = 4
"""Largest number of files of a command that are printed by name. If there are more, only their number is
printed.
"""

Users = Callable[[str], list[str]]


class Plan(NamedTuple):
    """What to check, and with which program.

    ruff and clang-format check files, mypy checks folders and files, and pytest runs tests.
    """

    python: list[str]
    cxx: list[str]
    types: list[str]
    tests: list[str]
    left_out: list[str]
    """Changed helper modules that more than MOST_USERS test files use. `make near` does not run these test
    files.
    """
    changed: list[str]
    """All changed and deleted files."""


def plan(files: Iterable[str], gone: Iterable[str] = (), users: Users = lambda _: []) -> Plan:
    """Return what to run for changed files and for deleted files (`gone`).

    `users`: function that returns, for the name of a module of `tools` or `tests/rig`, the test files that
    use it.
    """
    here, everything = sorted(files), sorted({*files, *gone})
    found = {name: tests_of(name, users) for name in everything}
    left_out = [name for name, tests in found.items() if name.endswith(".py") and len(tests) > MOST_USERS]
    tests = {test for name, tests in found.items() if name not in left_out for test in tests}
    python = [name for name in here if name.endswith(".py")]
    cxx = [name for name in here if Path(name).suffix in CXX]
    types = {typed(name) for name in python if name.startswith(("host/fltea/", "tools/", "tests/"))}
    return Plan(
        python,
        cxx,
        sorted(types),
        sorted(test for test in tests if str(Path(test).parent) not in tests),
        left_out,
        everything,
    )


def nearest_first(tests: Iterable[str], changed_files: Sequence[str]) -> list[str]:
    """Return test files, also those of folders: the changed ones, then those that import a changed file."""
    forms = [importing(name) for name in changed_files if name.endswith(".py")]
    imports = re.compile("|".join(forms) or "(?!)")
    files: set[Path] = set()
    for test in tests:
        path = ROOT / test
        files |= {*path.rglob("test_*.py")} if path.is_dir() else {path}

    def rank(path: Path) -> tuple[bool, bool, str]:
        name = path.relative_to(ROOT).as_posix()
        text = path.read_text(encoding="utf-8") if path.is_file() else ""
        return name not in changed_files, not imports.search(text), name

    return [path.relative_to(ROOT).as_posix() for path in sorted(files, key=rank)]


def importing(name: str) -> str:
    """Return a regular expression that finds an import of a Python file."""
    module = name.removeprefix("host/").removesuffix(".py").removesuffix("/__init__").replace("/", ".")
    package, _, last = module.rpartition(".")
    return rf"\b{re.escape(module)}\b|\bfrom {re.escape(package)} import .*\b{re.escape(last)}\b"


def tests_of(name: str, users: Users) -> list[str]:
    """Return the folders and files with the tests of a file."""
    path = Path(name)
    match path.parts:
        case ("host", "fltea", room, _, *_):
            folders = [f"tests/{one}" for one in (room, *ALSO.get(room, ()))]
            return [folder for folder in folders if (ROOT / folder).is_dir()] + [*OF_OUTPUTS.get(name, ())]
        case ("tests", "rig", _, *_):
            return users(path.stem)
        case ("tests", folder, file, *_):
            return [name if file.startswith("test_") else f"tests/{folder}"]
        case ("tools", module) if module.endswith(".py"):
            return users(path.stem)
        case ("tools", package, _, *_) if package not in ("hashes", "templates"):
            return [f"tests/{package}"] if (ROOT / "tests" / package).is_dir() else users(package)
    begin = next((begin for begin in TESTS_OF if name.startswith(begin)), None)
    if begin is None:
        return ["tests/site/test_site_texts.py"] if path.suffix == ".md" else []
    return [f"tests/{one}" for one in TESTS_OF[begin]]


def typed(name: str) -> str:
    """Return what mypy checks after a change of a file.

    mypy checks the file's package in host/fltea, or its folder in tools or tests. A helper, such as a file in
    tests/rig, is checked alone.
    """
    match Path(name).parts:
        case ("host", "fltea", _, _, *_) as parts:
            return "/".join(parts[:3])
        case ("tools" | "tests", folder, _, *_) as parts if folder != "rig":
            return "/".join(parts[:2])
    return name


def users_of(module: str) -> list[str]:
    """Return the test files that use a module of `tools` or `tests/rig`."""
    package = r"(?:tools|tests[./]rig)"
    uses = re.compile(
        rf"\b{package}[./]{module}\b|\bfrom {package} import .*\b{module}\b|\b{module}\.(?:py|sh)\b"
    )
    tests = (ROOT / "tests").glob("*/test_*.py")
    return sorted(
        path.relative_to(ROOT).as_posix() for path in tests if uses.search(path.read_text(encoding="utf-8"))
    )


def changed(since: str | None) -> tuple[str, list[str]]:
    """Return the commit with which the tree is compared, and the files that differ from that commit."""
    if since is None:
        upstream = _git("rev-parse", "--verify", "--quiet", "origin/main", check=False)
        base = upstream and _git("merge-base", "HEAD", "origin/main", check=False)
        base = base or _git("rev-parse", "--verify", "--quiet", "HEAD~1", check=False)
        since = base[0] if base else "HEAD"
    differ = _git("diff", "--name-only", "--no-renames", since, "--")
    return since, differ + _git("ls-files", "--others", "--exclude-standard")


def _git(*words: str, check: bool = True) -> list[str]:
    done = subprocess.run(["git", *words], cwd=ROOT, check=False, capture_output=True, text=True)
    if check and done.returncode:
        sys.exit(f"near: git {' '.join(words)}: {done.stderr.strip()}")
    return done.stdout.splitlines()


def commands(wanted: Plan) -> list[list[str]]:
    """Return the commands to run, the quick ones first."""
    ruff, clang = [sys.executable, "-m", "ruff"], str(Path(sys.executable).with_name("clang-format"))
    found = [[sys.executable, "-m", "tools.generated", "--check"]]
    if wanted.python:
        found = [[*ruff, "format", "--check", *wanted.python], [*ruff, "check", *wanted.python], *found]
    if wanted.cxx:
        found.append([clang, "--dry-run", "-Werror", *wanted.cxx])
    if wanted.types:
        found.append([sys.executable, "-m", "mypy", *wanted.types])
    tests = [
        *(OF_ALL_CODE if wanted.python or wanted.cxx else ()),
        *nearest_first(wanted.tests, wanted.changed),
    ]
    if tests:
        words = " ".join(dict.fromkeys(tests))
        found.append(["make", "--no-print-directory", "test", f"ARGS=-q --no-test-after {TESTS_S} {words}"])
    return found


def said(command: Sequence[str]) -> str:
    """Return a command as text for people.

    If the command has many files, the text only says how many.
    """
    words = [Path(word).name if word.startswith("/") else word for one in command for word in one.split()]
    files = [word for word in words if "/" in word and (ROOT / word).is_file()]
    if len(files) > MOST_SAID:
        words = [word for word in words if word not in files] + [f"({len(files)} files)"]
    return " ".join(words)


def main(words: Sequence[str] | None = None) -> int:
    """Run the command line up to the first command that fails; return the exit code, 1 if one failed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--since", metavar="COMMIT", help="compare with this commit; default: origin/main, or else HEAD~1"
    )
    parser.add_argument("--dry-run", action="store_true", help="only print what would be run")
    given = parser.parse_args(words)
    since, names = changed(given.since)
    here = [name for name in names if (ROOT / name).is_file()]
    wanted = plan(here, set(names) - set(here), users_of)
    print(f"near: {len(names)} files differ from {since}", flush=True)
    for name in wanted.left_out:
        print(f"near: not run: the many tests that use {name}; make test runs them", flush=True)
    failed = None
    for command in commands(wanted):
        begin = time.monotonic()
        print(f"near: {said(command)}", flush=True)
        if given.dry_run:
            continue
        code = subprocess.run(command, cwd=ROOT, check=False).returncode
        print(f"near: {time.monotonic() - begin:.0f} s", flush=True)
        if code:
            failed = said(command)
            break
    if names and not any(re.match(r"\+[^+]", line) for line in _git("diff", since, "--", "CHANGELOG.md")):
        print("near: warning: CHANGELOG.md has no new line", flush=True)
    if failed is not None:
        print(f"near: failed: {failed}", file=sys.stderr)
    return int(failed is not None)


if __name__ == "__main__":
    sys.exit(main())
