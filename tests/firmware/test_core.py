"""Builds and runs the C++ tests of firmware/core, so that pytest shows them beside the others."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest
from tiers import slow

FOLDER = Path(__file__).parent
BUILD = FOLDER.parents[1] / "build/tests-firmware"

compilers = pytest.mark.parametrize("compiler", ["g++", slow("clang++")])
"""Each builds in a folder of its own."""


LONG = ",".join(
    [
        *("recovery: lost one wrap*", "recovery: a sensor gone*", "noise fit: a board that was moved*"),
        *("edges: each is*", "random trouble*"),
    ]
)
"""Hours of virtual time, half of all test cases' time: only clang's build runs them, in the second tier."""


def make(compiler: str, *goals: str | Path) -> None:
    for tool in (compiler, "make"):
        assert shutil.which(tool), f"{tool} is missing: tools/setup.sh names the packages that the tests need"
    build = BUILD / compiler.rstrip("+")
    done = subprocess.run(
        ["make", f"-j{os.cpu_count()}", "-C", FOLDER, f"CXX={compiler}", f"BUILD={build}", *goals],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr


@compilers
@pytest.mark.timeout(600)  # a first build with sanitizers on a small machine
def test_doctest_with_sanitizers(compiler: str) -> None:
    tests = BUILD / compiler.rstrip("+") / "tests"
    make(compiler, tests)
    left_out = [f"--test-case-exclude={LONG}"] if compiler == "g++" else []
    done = subprocess.run([tests, *left_out], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


@compilers
@pytest.mark.timeout(300)
def test_core_compiles_in_both_modes_with_the_flags_of_the_firmware(compiler: str) -> None:
    make(compiler, "strict")


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_clang_tidy_and_cppcheck_find_nothing() -> None:
    make("clang++", "check")


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_fuzzer_finds_nothing_in_a_fixed_number_of_inputs() -> None:
    make("clang++", "fuzz")
