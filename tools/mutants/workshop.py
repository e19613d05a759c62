"""Applies single bugs from a list to copies of the firmware, builds the copies and runs tests on them."""

import os
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import msgspec

from tools.build_firmware import BuildError, build

REPOSITORY = Path(__file__).resolve().parents[2]

LIST = Path(__file__).with_name("mutants.toml")
PARTS = (
    "firmware",
    "tests/firmware",
    "tests/native",
    "host/native",
    "tests/__init__.py",
    "tests/conftest.py",
    "tests/rig",
    "protocol/vectors",
    "pyproject.toml",
)
PATIENCE_S = 300.0
"""Time limit of one command [s]: a mutant (a copy with a bug) that never ends must not delay the other
mutants.
"""

DUE_TESTS = ("tests/e2e/test_due.py", "tests/e2e/test_due_faults.py")
"""Tests of the emulated Due. They run on the image of the mutant."""
EDGE_TESTS = ("tests/e2e/test_due_edges.py", "-o", "timeout=200")
"""Slow tests of the emulated Due that read the program's variables and code."""
OF_ITS_IMAGE = ("-m", "not slow", "-k", "not data_ready", "-o", "timeout=100")
DOCTEST, NATIVE = "build/doctest", "build/native"
# These flags contain no sanitizers and no optimisation, so that a mutant is built in seconds. $(VECTORS) is a
# variable of tests/firmware/Makefile.
DOCTEST_FLAGS = "FLAGS=-std=gnu++11 -O0 -DVECTORS='\"$(VECTORS)\"'"
ARDUINO = {"MAKEFLAGS": "SANITIZE="}
ARDUINO_TESTS = ("tests/firmware/test_arduino.py", "-k", "g++ and not clang")


class Mutant(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One bug. `file`: path below firmware/. `old`: text that `new` replaces. `breaks`: effect of the bug."""

    name: str
    file: str
    old: str
    new: str
    breaks: str

    def applied_to(self, text: str) -> str:
        """Return a source text with the bug in it.

        Raises:
            ValueError: `old` does not occur exactly once in `text`, or `new` equals `old`.
        """
        if text.count(self.old) != 1 or self.old == self.new:
            raise ValueError(
                f"{self.name}: the old text stands {text.count(self.old)} times in firmware/{self.file}, "
                "not once: the source has changed, so mutants.toml has to be updated"
            )
        return text.replace(self.old, self.new)

    def apply(self, root: Path) -> None:
        """Put the bug into the copy of the repository at `root`.

        Raises:
            ValueError: `old` does not occur exactly once in the file, or `new` equals `old`.
        """
        source = root / "firmware" / self.file
        source.write_text(self.applied_to(source.read_text(encoding="utf-8")), encoding="utf-8")


def read_mutants() -> list[Mutant]:
    """Return all mutants, in the order of the list."""
    tree = tomllib.loads(LIST.read_text(encoding="utf-8"))
    return msgspec.convert(tree["mutant"], list[Mutant])


ASSERTED = "static assertion failed"


class Invalid(Exception):
    """Raised when a mutant does not build, so that it cannot be judged."""


class Verdict(NamedTuple):
    """Result of one judge, which is a group of tests.

    `noticed`: the first test or check that failed, or None.
    """

    judge: str
    noticed: str | None


def copy_parts(to: Path) -> None:
    """Copy the files of the repository that building and testing need."""
    for part in PARTS:
        source, target = REPOSITORY / part, to / part
        target.parent.mkdir(parents=True, exist_ok=True)
        if source.is_dir():
            shutil.copytree(source, target, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy2(source, target)


def forget_build(root: Path) -> None:
    """Remove built files from `root`. In a copy of `root`, make would wrongly take these for up to date."""
    (root / DOCTEST / "tests").unlink()
    # Files in both folders contain absolute paths into `root`. In a copy, make would follow these paths, and
    # would not see the files that were changed in the copy.
    shutil.rmtree(root / NATIVE)
    shutil.rmtree(root / "build/tests-arduino")


def judge(root: Path, file: str, *, everyone: bool = False) -> list[Verdict]:
    """Build the copy at `root`, and run the judges (groups of tests) of firmware/`file`.

    The judge that is most likely to notice a bug comes first.

    `everyone`: run the other judges even if one has noticed the bug.

    Raises:
        Invalid: the copy does not build.
    """
    verdicts = []
    for name, ask in _judges(file):
        verdicts.append(Verdict(name, ask(root)))
        if verdicts[-1].noticed and not everyone:
            break
    return verdicts


def _judges(file: str) -> list[tuple[str, Callable[[Path], str | None]]]:
    """Return the judges (groups of tests) that can notice a bug in firmware/`file`.

    Each judge has a name, and a function that runs the tests.
    """
    emulator, doctest = ("emulator", on_the_emulator), ("doctest", by_doctest)
    arduino, spectrum = ("arduino", on_the_stub), ("spectrum", by_spectrum)
    if file.startswith("core/engine/"):
        return [spectrum, doctest, emulator]
    if file.startswith("core/"):
        return [doctest, emulator, arduino]
    return [emulator] if file.startswith("due/") else [arduino]


def on_the_emulator(root: Path) -> str | None:
    """Build the firmware image, and run the tests of the emulated Due on it.

    Return the first failure or None.
    """
    folder = root / "build/firmware"
    try:
        build(root, "timer", folder)
    except BuildError as error:
        return _asserted(str(error))
    image = {"FLTEA_DUE_IMAGE": str(folder / "fltea_due.bin")}
    found = _by_pytest([*DUE_TESTS, *OF_ITS_IMAGE], REPOSITORY, image)
    return found or _by_pytest(EDGE_TESTS, REPOSITORY, image)


def _asserted(output: str) -> str:
    """Return the line about the static assertion that kept a mutant from being built.

    `output`: the compiler's output.

    Invalid is raised if no static assertion failed.
    """
    if ASSERTED not in output:
        raise Invalid(output)
    return _first(output, ASSERTED, "")


def by_doctest(root: Path) -> str | None:
    """Build and run the C++ tests of the core; return the first test case that fails, or None."""
    here = root / "tests/firmware"
    program = root / DOCTEST / "tests"
    # The path is relative, so it is the same in every copy. Make can therefore use what was built before the
    # copy was made.
    goal = os.path.relpath(program, here)
    command = ["make", f"BUILD={Path(goal).parent}", DOCTEST_FLAGS, goal]
    code, output = run(command, here)
    if code:
        return _asserted(output)
    code, output = run([str(program), "--abort-after=1", "--no-colors=true"], here)
    return _first(output, "TEST CASE:", f"exit code {code}") if code else None


def by_spectrum(root: Path) -> str | None:
    """Build and run the C++ tests of the board's spectrum and fit; return the first failing case or None."""
    program = root / NATIVE / "board_tests"
    flags = "FLAGS=-std=gnu++11 -O1 -ffp-contract=off"
    here = root / "tests/native"
    code, output = run(["make", f"BUILD={program.parent}", flags, str(program)], here)
    if code:
        return _asserted(output)
    code, output = run([str(program), "--abort-after=1", "--no-colors=true"], here)
    return _first(output, "TEST CASE:", f"exit code {code}") if code else None


def on_the_stub(root: Path) -> str | None:
    """Run the tests of the Arduino sketch, which build it; return the first failure or None."""
    return _by_pytest([*ARDUINO_TESTS, "-o", "timeout=300"], root, ARDUINO)


def _by_pytest(tests: Sequence[str], root: Path, environment: dict[str, str]) -> str | None:
    options = ["-x", "-q", "-p", "no:cacheprovider", "--no-header", "--tb=line"]
    code, output = run([sys.executable, "-m", "pytest", *options, *tests], root, environment)
    if "make: ***" in output or code > 1:
        raise Invalid(output)
    return _first(output, "FAILED ", _first(output, "ERROR ", f"exit code {code}")) if code else None


def _first(output: str, word: str, otherwise: str) -> str:
    lines = [line.strip() for line in output.splitlines() if word in line]
    return lines[0].replace(word, "").strip() if lines else otherwise


def run(
    command: list[str],
    folder: Path,
    environment: dict[str, str] | None = None,
    *,
    patience_s: float = PATIENCE_S,
) -> tuple[int, str]:
    """Run `command` in `folder`; return exit code and output."""
    try:
        done = subprocess.run(
            command,
            cwd=folder,
            env={**os.environ, **(environment or {})},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            encoding="utf-8",
            errors="replace",
            timeout=patience_s,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return 1, "it does not end within the time limit"
    return done.returncode, done.stdout
