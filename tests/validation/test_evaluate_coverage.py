"""Intervals counted over many series, and the noise that they are counted on."""

import msgspec
import pytest
from fltea.noise import spectra

from tools.validation.evaluate.cases import POWER, H
from tools.validation.evaluate.coverage import POINTS, Coverage, Point, count_coverage
from tools.validation.evaluate.fits import QUANTITIES
from tools.validation.evaluate.run import add_up


def test_points() -> None:
    """Eight, stationary, with and without white noise."""
    assert len(set(POINTS)) == 8
    assert all(spectra.stationary(one.alpha, H**one.alpha * one.f) for one in POINTS)
    assert [one.name for one in POINTS if one.white == 0] == ["α = 0.4, f = -1, R = 0"]
    assert POINTS[3].name == "α = 0.5, f = -2, s2/R = 1"


@pytest.mark.parametrize("point", POINTS[1:4], ids=lambda one: one.name)
def test_intervals_hold_the_truth(point: Point) -> None:
    """60 series: 95 % give 57, and 51 or fewer one time in a hundred."""
    found = [msgspec.convert(row["found"], Coverage) for row in count_coverage(point, 3_000, 60, 1)]
    assert [one.quantity for one in found] == list(QUANTITIES)
    assert min(one.held for one in found) >= 52, found
    assert POWER == 0.02


def test_sums() -> None:
    one = Coverage(POINTS[0], 3_000, "f", 600, 560, 30)
    other = Coverage(POINTS[0], 3_000, "f", 400, 390, 10)
    (both,) = add_up([one, other], ("series", "held", "undefined"))
    assert (both.series, both.held, both.undefined, both.share) == (1_000, 950, 40, 0.95)
    assert both.share_of_defined == pytest.approx(910 / 960)
    assert Coverage(POINTS[0], 3_000, "f", 10, 10, 10).share_of_defined is None
