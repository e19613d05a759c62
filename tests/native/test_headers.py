"""Builds and runs the C++ tests of host/native, so that pytest shows them beside the others."""

import subprocess
from pathlib import Path

import pytest

FOLDER = Path(__file__).parent
BUILD = FOLDER.parents[1] / "build/tests-native"


def make(*goals: str) -> None:
    command = ["make", "-C", FOLDER, f"BUILD={BUILD}", *goals]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.timeout(600)  # a first build with sanitizers on a small machine
def test_doctest_with_sanitizers() -> None:
    make("tests")
    done = subprocess.run([BUILD / "tests"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_headers_compile_with_the_flags_of_the_device() -> None:
    make("strict")


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_fuzzer_finds_nothing_in_a_fixed_number_of_inputs() -> None:
    make("fuzz")
