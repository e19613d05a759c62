"""The list of bugs of `make mutants` fits the sources, and its trial on the emulator judges as it should."""

import shutil
import subprocess
from collections import defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path

import msgspec
import pytest
from build_firmware import FLAGS
from due_support import IMAGE, ROOT, image
from toolchain import arm_compiler

from tools.mutants.mutation import Mutant, read_mutants
from tools.mutants.trial import first_failure

MUTANTS = read_mutants()


@pytest.mark.parametrize("mutant", MUTANTS, ids=lambda mutant: mutant.name)
def test_each_bug_has_its_place_in_the_present_sources(mutant) -> None:
    text = (ROOT / "firmware" / mutant.file).read_text()
    assert mutant.applied_to(text) != text
    with pytest.raises(ValueError, match="stands 0 times"):
        msgspec.structs.replace(mutant, old="no such text").applied_to(text)


def test_the_list_is_long_enough_and_names_each_bug_once() -> None:
    assert len({mutant.name for mutant in MUTANTS}) == len(MUTANTS) >= 30


# --- each of them compiles ---

WARNINGS = ("-Wall", "-Wextra", "-Wconversion", "-Wpedantic", "-Werror")
STRICT = ("g++", "-std=gnu++11", "-fno-exceptions", "-fno-rtti", *WARNINGS, "-fsyntax-only")


def together(mutants: Sequence[Mutant]) -> Iterator[tuple[list[Mutant], str]]:
    """Bugs of one file in as few texts as their places allow."""
    left = list(mutants)
    while left:
        text = (ROOT / "firmware" / left[0].file).read_text()
        taken, later = [], []
        for mutant in left:
            try:
                text = mutant.applied_to(text)
                taken.append(mutant)
            except ValueError:
                later.append(mutant)
        assert taken, f"{left[0].name} has no place in its source"
        yield taken, text
        left = later


def commands(root: Path, file: str) -> list[list[str]]:
    """What compiles a source, or all that includes it."""
    firmware = root / "firmware"
    if file.startswith("due/"):
        return [["arm-none-eabi-g++", *FLAGS, "-fsyntax-only", str(firmware / file)]]
    if file.startswith("arduino/"):
        stub = ROOT / "tests/firmware/arduino_stub"
        folders = [f"-I{stub}", f"-I{firmware / 'core'}", f"-I{firmware / 'arduino/fltea'}"]
        sketch = str(firmware / "arduino/fltea/fltea.ino")
        return [[*STRICT, *folders, "-include", "Arduino.h", "-x", "c++", sketch]]
    core = f"-I{firmware / 'core'}"
    users = ["noise_fit.cpp"] if file.startswith("core/engine/") else ["axis_estimator.cpp", "noise_fit.cpp"]
    sources = [str(firmware / "core" / user) for user in users]
    strict = [] if file.startswith("core/engine/") else [str(ROOT / "tests/firmware/strict.cpp")]
    return [[*STRICT, core, *strict, *sources]]


def complaint(mutants: Sequence[Mutant], text: str, folder: Path) -> str:
    """What the compiler has against these bugs, all at once; empty if nothing."""
    root = folder / mutants[0].name
    shutil.copytree(ROOT / "firmware", root / "firmware", ignore=shutil.ignore_patterns("image", "*.png"))
    file = mutants[0].file
    (root / "firmware" / file).write_text(text)
    for command in commands(root, file):
        done = subprocess.run(command, cwd=root / "firmware", capture_output=True, text=True, check=False)
        if done.returncode:
            return done.stderr
    return ""


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_each_bug_compiles(tmp_path: Path) -> None:
    """Else `make mutants` could not say whether anybody would notice it."""
    arm_compiler()
    by_file = defaultdict(list)
    for mutant in MUTANTS:
        by_file[mutant.file].append(mutant)
    wrong = {}
    for mutants in by_file.values():
        for group, text in together(mutants):
            if not complaint(group, text, tmp_path / "all"):
                continue
            for one in group:
                source = (ROOT / "firmware" / one.file).read_text()
                if said := complaint([one], one.applied_to(source), tmp_path / "one"):
                    wrong[one.name] = said
    assert wrong == {}


def test_a_bug_that_does_not_compile_is_found(tmp_path: Path) -> None:
    mutant = msgspec.structs.replace(MUTANTS[0], new="no such thing")
    text = mutant.applied_to((ROOT / "firmware" / mutant.file).read_text())
    assert "error" in complaint([mutant], text, tmp_path)


@pytest.mark.slow
def test_the_committed_image_passes_the_trial() -> None:
    assert first_failure(image()) is None


def test_the_trial_notices_another_instruction() -> None:
    """The reset vector leads astray: nothing of what the trial states can be true."""
    broken = bytearray(image())
    broken[4:8] = (0).to_bytes(4, "little")
    failure = first_failure(bytes(broken))
    assert failure is not None
    assert failure.startswith("it runs")
    assert IMAGE.read_bytes() == image()
