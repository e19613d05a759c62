"""Distribute the parameters of one test between the tiers of tests (tests/README.md)."""

import re
from collections.abc import Container, Iterable
from functools import cache
from pathlib import Path
from typing import Any

import pytest

LATER_TIERS = {"slow and not long": "slow", "long": "long"}
"""The pytest marks of the tests of the second and the third tier.

The key of a mark is the expression by which the Makefile selects that tier. The first tier has no mark.
"""


def slow(*values: Any) -> Any:
    """Return a parameter set for pytest. Only the second tier runs the test with these values."""
    return pytest.param(*values, marks=pytest.mark.slow)


def long(*values: Any) -> Any:
    """Return a parameter set for pytest. Only the third tier runs the test with these values."""
    return pytest.param(*values, marks=pytest.mark.long)


def slow_but(quick: Container[Any], values: Iterable[Any]) -> list[Any]:
    """Return all values of a parameter; the first tier tries only those in `quick`, the second the others."""
    return [value if value in quick else slow(value) for value in values]


def long_but(usual: Container[Any], values: Iterable[Any], *, quick: Container[Any] = ()) -> list[Any]:
    """Return all values of a parameter.

    The first tier tries those in `quick`, the second those in `usual`, and the third all others.
    """
    values = list(values)
    return [one if one in quick else slow(one) if one in usual else long(one) for one in values]


@cache
def names_a_tier(file: Path, tier: str) -> bool:
    """Return whether a test file names the mark `tier`, or a function of this module that gives it."""
    gives = {"slow": r"slow\(|slow_but\(|long_but\(", "long": r"long\(|long_but\("}[tier]
    return re.search(rf"mark\.{tier}\b|\b({gives})", file.read_text(encoding="utf-8")) is not None
