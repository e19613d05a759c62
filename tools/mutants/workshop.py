"""Single bugs of the firmware, as a list, and private copies of it in which one is put, built and judged."""

import os
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import msgspec

REPOSITORY = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(REPOSITORY / "tools"))

from build_firmware import BuildError, build  # noqa: E402

LIST = Path(__file__).with_name("mutants.toml")
PARTS = (
    "firmware",
    "tests/firmware",
    "tests/native",
    "host/native",
    "tests/conftest.py",
    "tests/rig",
    "protocol/vectors",
    "pyproject.toml",
)
PATIENCE_S = 300.0
"""Only keeps a mutant that never ends from holding up the others."""

DUE_TESTS = ("tests/e2e/test_due.py", "tests/e2e/test_due_faults.py")
"""Of the emulated Due; all but those that build an image themselves, or are of the committed one."""
EDGE_TESTS = ("tests/e2e/test_due_edges.py", "-o", "timeout=200")
"""Of the same, slow: they look into the program."""
OF_ITS_IMAGE = ("-m", "not slow", "-k", "not data_ready", "-o", "timeout=100")
DOCTEST, NATIVE = "build/doctest", "build/native"
# Neither sanitizers nor optimisation: a mutant is built in seconds. $(VECTORS) is make's.
DOCTEST_FLAGS = "FLAGS=-std=gnu++11 -O0 -DVECTORS='\"$(VECTORS)\"'"
ARDUINO = {"MAKEFLAGS": "SANITIZE="}
ARDUINO_TESTS = ("tests/firmware/test_arduino.py", "-k", "g++ and not clang")


class Mutant(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One bug. file: below firmware/. old: what stands there exactly once. breaks: what the bug does."""

    name: str
    file: str
    old: str
    new: str
    breaks: str

    def applied_to(self, text: str) -> str:
        """The source with the bug.

        Raises:
            ValueError: the old text does not stand there exactly once, or nothing changes.
        """
        if text.count(self.old) != 1 or self.old == self.new:
            raise ValueError(
                f"{self.name}: the old text stands {text.count(self.old)} times in firmware/{self.file}, "
                "not once: the source has changed, so mutants.toml has to follow"
            )
        return text.replace(self.old, self.new)

    def apply(self, root: Path) -> None:
        """Put the bug into the copy of the repository at `root`. Raises ValueError as `applied_to`."""
        source = root / "firmware" / self.file
        source.write_text(self.applied_to(source.read_text(encoding="utf-8")), encoding="utf-8")


def read_mutants() -> list[Mutant]:
    """All of them, in the order of the list."""
    tree = tomllib.loads(LIST.read_text(encoding="utf-8"))
    return msgspec.convert(tree["mutant"], list[Mutant])


ASSERTED = "static assertion failed"


class Invalid(Exception):
    """The mutant does not build, so it says nothing about the tests."""


class Verdict(NamedTuple):
    """judge: who. noticed: the first thing that failed; None if nothing did."""

    judge: str
    noticed: str | None


def copy_parts(to: Path) -> None:
    """Copy from the repository what the judges need."""
    for part in PARTS:
        source, target = REPOSITORY / part, to / part
        target.parent.mkdir(parents=True, exist_ok=True)
        if source.is_dir():
            shutil.copytree(source, target, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy2(source, target)


def forget_build(root: Path) -> None:
    """Leave of what is built in `root` only what make finds out of date by itself in a copy of it."""
    (root / DOCTEST / "tests").unlink()
    shutil.rmtree(root / NATIVE)  # likewise with absolute paths
    shutil.rmtree(root / "build/tests-arduino")  # its dependencies are noted with absolute paths


def judge(root: Path, file: str, *, everyone: bool = False) -> list[Verdict]:
    """Build the copy at `root` and ask those whom a change of firmware/`file` concerns, the likeliest first.

    everyone: also when one has noticed something; else the others are left out.

    Raises:
        Invalid: it does not build.
    """
    verdicts = []
    for name, ask in _judges(file):
        verdicts.append(Verdict(name, ask(root)))
        if verdicts[-1].noticed and not everyone:
            break
    return verdicts


def _judges(file: str) -> list[tuple[str, Callable[[Path], str | None]]]:
    """Names and functions of those who can notice a bug in firmware/`file`."""
    emulator, doctest = ("emulator", on_the_emulator), ("doctest", by_doctest)
    arduino, spectrum = ("arduino", on_the_stub), ("spectrum", by_spectrum)
    if file.startswith("core/engine/"):
        return [spectrum, doctest, emulator]
    if file.startswith("core/"):
        return [doctest, emulator, arduino]
    return [emulator] if file.startswith("due/") else [arduino]


def on_the_emulator(root: Path) -> str | None:
    """Build the image and run the tests of the emulated Due on it; the first that fails."""
    folder = root / "build/firmware"
    try:
        build(root, "timer", folder)
    except BuildError as error:
        return _asserted(str(error))
    image = {"FLTEA_DUE_IMAGE": str(folder / "fltea_due.bin")}
    found = _by_pytest([*DUE_TESTS, *OF_ITS_IMAGE], REPOSITORY, image)
    return found or _by_pytest(EDGE_TESTS, REPOSITORY, image)


def _asserted(output: str) -> str:
    """The static assertion that kept a mutant from being built. Raises Invalid if it was something else."""
    if ASSERTED not in output:
        raise Invalid(output)
    return _first(output, ASSERTED, "")


def by_doctest(root: Path) -> str | None:
    """Build and run the C++ tests of the core; the first case that fails."""
    here = root / "tests/firmware"
    program = root / DOCTEST / "tests"
    # Relative, so that what a copy has built already fits the next one.
    goal = os.path.relpath(program, here)
    command = ["make", f"BUILD={Path(goal).parent}", DOCTEST_FLAGS, goal]
    code, output = run(command, here)
    if code:
        return _asserted(output)
    code, output = run([str(program), "--abort-after=1", "--no-colors=true"], here)
    return _first(output, "TEST CASE:", f"exit code {code}") if code else None


def by_spectrum(root: Path) -> str | None:
    """Build and run the C++ tests of the device's spectrum and fit; the first case that fails."""
    program = root / NATIVE / "board_tests"
    flags = "FLAGS=-std=gnu++11 -O1 -ffp-contract=off"
    here = root / "tests/native"
    code, output = run(["make", f"BUILD={program.parent}", flags, str(program)], here)
    if code:
        return _asserted(output)
    code, output = run([str(program), "--abort-after=1", "--no-colors=true"], here)
    return _first(output, "TEST CASE:", f"exit code {code}") if code else None


def on_the_stub(root: Path) -> str | None:
    """Run the tests of the Arduino sketch, which build it themselves; the first that fails."""
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
    """Run `command` in `folder`; exit code and output."""
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
        return 1, "it does not come to an end"
    return done.returncode, done.stdout
