"""Builds and runs the C++ tests of firmware/core, so that pytest shows them beside the others."""

import subprocess
from pathlib import Path

import pytest

FOLDER = Path(__file__).parent
BUILD = FOLDER.parents[1] / "build/tests-firmware"


def make(*goals: str) -> None:
    done = subprocess.run(
        ["make", "-C", FOLDER, f"BUILD={BUILD}", *goals],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.timeout(300)  # a first build with sanitizers on a small machine
def test_doctest_with_sanitizers() -> None:
    make(f"{BUILD}/tests")
    done = subprocess.run([BUILD / "tests"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.timeout(300)
def test_core_compiles_with_the_flags_of_the_firmware() -> None:
    make("strict")
