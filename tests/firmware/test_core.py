"""Build and run the C++ tests of firmware/core, so that pytest shows them with the others."""

import shutil
import subprocess
from pathlib import Path

import pytest

from tests.rig.built import BUILD, make
from tests.rig.tiers import long

FOLDER = Path(__file__).parent

compilers = pytest.mark.parametrize("compiler", ["g++", long("clang++")])
"""Parameters that run a test with each of two compilers. Each compiler builds in a separate folder."""


LONG = ",".join(
    [
        *("recovery: lost one wrap*", "recovery: a sensor gone*", "noise fit: a board that was moved*"),
        *("edges: each is*", "random trouble*", "application: the ends of*"),
    ]
)
"""Names of the test cases that simulate hours. They take half of the total time.

They run only in the build by clang, which belongs to the third tier of tests.
"""


def made_by(compiler: str, goal: str) -> Path:
    """Build a target of the tests of firmware/core with a compiler, and return the build folder."""
    for tool in (compiler, "make"):
        assert shutil.which(tool), f"{tool} is missing: tools/setup.sh names the packages that the tests need"
    folder = BUILD / "tests-firmware" / compiler.rstrip("+")
    make(FOLDER, folder, f"CXX={compiler}", f"{folder}/{goal}" if goal == "tests" else goal)
    return folder


@compilers
def test_doctest_with_sanitizers(compiler: str) -> None:
    tests = made_by(compiler, "tests") / "tests"
    left_out = [f"--test-case-exclude={LONG}"] if compiler == "g++" else []
    done = subprocess.run([tests, *left_out], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


@compilers
def test_core_compiles_in_both_modes_with_the_flags_of_the_firmware(compiler: str) -> None:
    made_by(compiler, "strict")


@pytest.mark.long
def test_fuzzer_finds_nothing_in_a_fixed_number_of_inputs() -> None:
    made_by("clang++", "fuzz")
