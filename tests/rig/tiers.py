"""Parameters of one test in both tiers (tests/README.md)."""

from collections.abc import Container, Iterable
from typing import Any

import pytest


def slow(*values: Any) -> Any:
    """One set of parameters that only the second tier tries."""
    return pytest.param(*values, marks=pytest.mark.slow)


def slow_but(quick: Container[Any], values: Iterable[Any]) -> list[Any]:
    """Values of one parameter: those in `quick` for the first tier, the others for the second."""
    return [value if value in quick else slow(value) for value in values]
