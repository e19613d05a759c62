"""Reference and engine against golden/: examples 1 to 3 in 50-digit arithmetic, by tools/make_golden.py."""

from pathlib import Path

import numpy as np
import pytest
from engine_cases import EXAMPLE, columns, reference_run, run, with_
from fltea.estimator.engine import instruction_sets
from fltea.estimator.lane_settings import LaneSettings
from fltea.records.arrays import Array

ROOT = Path(__file__).resolve().parents[2]
# Columns of the files in the order of engine_cases.ESTIMATES; without the walks' Q.
COLUMNS = [4, 5, 7, 8, 2, 3]


def golden(number: int) -> tuple[Array, Array, Array]:
    """y, u and the expected estimates, (200, 6)."""
    table = np.loadtxt(ROOT / f"tests/estimator/golden/example_{number}.txt")
    return table[:, 0], table[:, 1], table[:, COLUMNS]


@pytest.mark.parametrize("number", [1, 2, 3])
def test_reference_equals_the_formulas(number: int) -> None:
    y, u, expected = golden(number)
    got = reference_run(EXAMPLE, y, u, np.zeros(len(y), dtype=bool))[:, :6]
    np.testing.assert_allclose(got, expected, rtol=1e-10, atol=1e-13)


COMPRESSED = with_(EXAMPLE, memory="compressed", accuracy=9)


@pytest.mark.parametrize("instruction_set", instruction_sets())
@pytest.mark.parametrize(("tuning", "rtol", "atol"), [(EXAMPLE, 1e-10, 1e-13), (COMPRESSED, 1e-4, 1e-5)])
@pytest.mark.parametrize("number", [1, 2, 3])
def test_engine_equals_the_formulas(
    number: int, tuning: LaneSettings, rtol: float, atol: float, instruction_set: str
) -> None:
    y, u, expected = golden(number)
    estimates = run(tuning, y[:, np.newaxis], u[:, np.newaxis], instruction_set=instruction_set)
    np.testing.assert_allclose(columns(estimates)[:, :6], expected, rtol=rtol, atol=atol)
