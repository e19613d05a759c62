"""Build and run the C++ tests of host/native, so that pytest shows them with the others."""

import subprocess

import pytest

from tests.rig.built import BUILD, NATIVE, make
from tests.rig.tiers import long

TESTS = BUILD / "tests-native"


LONG = ",".join(
    [
        *("sliced fit: answers*", "sliced fit: the interval*", "sliced fit: from the last*", "searches end*"),
        *("octaves: snapshots of strangers*", "octaves: a merge of any two*", "count spectrum: its lines*"),
        *("tracker: snapshots*", "tracker: what was saved*"),
    ]
)
"""Names of test cases that take four fifths of the total time. They run in the third tier of tests."""


@pytest.mark.parametrize(
    "cases", [f"--test-case-exclude={LONG}", long(f"--test-case={LONG}")], ids=["short", "long"]
)
def test_doctest_with_sanitizers(cases: str) -> None:
    make(NATIVE, TESTS, "tests")
    done = subprocess.run([TESTS / "tests", cases], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.long
def test_the_reader_of_ports_has_no_races() -> None:
    make(NATIVE, TESTS, "thread_tests")
    done = subprocess.run([TESTS / "thread_tests"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.slow
def test_headers_compile_with_the_flags_of_the_device() -> None:
    make(NATIVE, TESTS, "strict")


@pytest.mark.long
def test_fuzzer_finds_nothing_in_a_fixed_number_of_inputs() -> None:
    make(NATIVE, TESTS, "fuzz")
