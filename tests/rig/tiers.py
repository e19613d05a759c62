"""Distribute the parameters of one test between the tiers of tests (tests/README.md)."""

import re
from collections.abc import Container, Iterable
from functools import cache
from pathlib import Path
from typing import Any

import pytest

LATER_TIERS = {"slow and not long": "slow", "long": "long"}
"""The mark of the second and of the third tier, by the expression that selects the tier (Makefile).

The first tier has the tests without a mark.
"""


def slow(*values: Any) -> Any:
    """Return a set of parameters with which a test runs only in the second tier of tests."""
    return pytest.param(*values, marks=pytest.mark.slow)


def long(*values: Any) -> Any:
    """Return a set of parameters that only the third tier tries."""
    return pytest.param(*values, marks=pytest.mark.long)


def slow_but(quick: Container[Any], values: Iterable[Any]) -> list[Any]:
    """Return all values of a parameter; the first tier tries only those in `quick`, the second the others."""
    return [value if value in quick else slow(value) for value in values]


def long_but(usual: Container[Any], values: Iterable[Any], *, quick: Container[Any] = ()) -> list[Any]:
    """Return all values of a parameter; the third tier tries those that are in neither `usual` nor `quick`.

    The first tier tries the values in `quick`, the second those in `usual`.
    """
    values = list(values)
    return [one if one in quick else slow(one) if one in usual else long(one) for one in values]


@cache
def names_a_tier(file: Path, tier: str) -> bool:
    """Return whether a test file names the mark `tier`, or a function of this module that gives it."""
    gives = {"slow": r"slow\(|slow_but\(|long_but\(", "long": r"long\(|long_but\("}[tier]
    return re.search(rf"mark\.{tier}\b|\b({gives})", file.read_text(encoding="utf-8")) is not None
