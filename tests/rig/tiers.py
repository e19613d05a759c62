"""Distribute the parameters of one test between the two tiers of tests (tests/README.md)."""

from collections.abc import Container, Iterable
from functools import cache
from pathlib import Path
from typing import Any

import pytest


def slow(*values: Any) -> Any:
    """Return a set of parameters that only the second tier tries."""
    return pytest.param(*values, marks=pytest.mark.slow)


def slow_but(quick: Container[Any], values: Iterable[Any]) -> list[Any]:
    """Return all values of a parameter; the first tier of tests tries only the values in `quick`."""
    return [value if value in quick else slow(value) for value in values]


@cache
def may_be_slow(file: Path) -> bool:
    """Return whether a test file contains the name of the mark `slow`; otherwise none of its tests has it."""
    return "slow" in file.read_text(encoding="utf-8")
