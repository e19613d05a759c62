"""Intervals counted over many series, and the noise that they are counted on."""

import pytest
from fltea.noise import spectra

from tools.validation.evaluate.cases import H
from tools.validation.evaluate.coverage import POINTS, Point, count_coverage
from tools.validation.evaluate.fits import QUANTITIES


def test_points() -> None:
    """Eight, stationary, with and without white noise."""
    assert len(set(POINTS)) == 8
    assert all(spectra.stationary(one.alpha, H**one.alpha * one.f) for one in POINTS)
    assert [one.name for one in POINTS if one.white == 0] == ["α = 0.4, f = -1, R = 0"]
    assert POINTS[3].name == "α = 0.5, f = -2, s2/R = 1"


@pytest.mark.parametrize(("point", "least"), [(POINTS[1], 52), (POINTS[2], 48), (POINTS[3], 52)])
def test_intervals_hold_the_truth(point: Point, least: int) -> None:
    """60 series: 95 % give 57, and 51 or fewer one time in a hundred; without white noise it is some 92 %."""
    found = count_coverage(point, 3_000, 60, 1)
    assert [row["quantity"] for row in found] == list(QUANTITIES)
    assert min(row["held"] for row in found) >= least, found
