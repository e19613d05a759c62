"""Intervals counted over many series, and the noise that they are counted on."""

import numpy as np
import pytest
from fltea.noise import spectra
from fltea.noise.weights import weights

from tools.validation.evaluate.cases import POWER, H
from tools.validation.evaluate.coverage import POINTS, Coverage, Point, count_coverage, together
from tools.validation.evaluate.fits import QUANTITIES
from tools.validation.evaluate.impulse import Filter, impulse_response


@pytest.mark.parametrize("point", POINTS, ids=lambda one: one.name)
def test_impulse_response_is_the_recursion_in_time(point: Point) -> None:
    g, n = H**point.alpha * point.f, 300
    c, x = weights(point.alpha, n), np.zeros(n)
    for k in range(n):
        x[k] = (k == 0) + (g * x[k - 1] if k else 0) - c[1 : k + 1] @ x[:k][::-1]
    np.testing.assert_allclose(impulse_response(point.alpha, g, n), x, atol=1e-12)


@pytest.mark.parametrize("point", POINTS, ids=lambda one: one.name)
def test_it_has_the_spectrum_that_is_fitted(point: Point) -> None:
    g, n = H**point.alpha * point.f, 1 << 17
    power = np.abs(np.fft.rfft(impulse_response(point.alpha, g, n))) ** 2
    at = np.array([50, 500, 5_000, 50_000])
    np.testing.assert_allclose(power[at], spectra.fractional(2 * np.pi * at / n, point.alpha, g), rtol=0.01)


@pytest.mark.slow
def test_what_is_drawn_is_stationary_from_its_first_sample_on() -> None:
    one = Filter(0.6, -0.02, 64)
    rng = np.random.default_rng(1)
    x = np.array([one.draw(rng) for _ in range(400)])
    assert x.shape == (400, 64)
    assert x[:, 0].var() == pytest.approx(one.power, rel=0.3)
    assert x[:, -1].var() == pytest.approx(one.power, rel=0.3)


def test_points() -> None:
    """Eight, stationary, with and without white noise."""
    assert len(set(POINTS)) == 8
    assert all(spectra.stationary(one.alpha, H**one.alpha * one.f) for one in POINTS)
    assert [one.name for one in POINTS if one.white == 0] == ["α = 0.4, f = -1, R = 0"]
    assert POINTS[3].name == "α = 0.5, f = -2, s2/R = 1"


@pytest.mark.parametrize("point", POINTS[1:4], ids=lambda one: one.name)
def test_intervals_hold_the_truth(point: Point) -> None:
    """60 series: 95 % give 57, and 51 or fewer one time in a hundred."""
    found = count_coverage(point, 3_000, 60, 1)
    assert [one.quantity for one in found] == list(QUANTITIES)
    assert min(one.held for one in found) >= 52, found
    assert POWER == 0.02


def test_sums_and_their_interval() -> None:
    one = Coverage(POINTS[0], 3_000, "f", 600, 560, 30)
    other = Coverage(POINTS[0], 3_000, "f", 400, 390, 10)
    (both,) = together([[one], [other]])
    assert (both.series, both.held, both.undefined, both.share) == (1_000, 950, 40, 0.95)
    assert both.share_of_defined == pytest.approx(910 / 960)
    assert Coverage(POINTS[0], 3_000, "f", 10, 10, 10).share_of_defined is None
    assert both.interval == pytest.approx((0.93470, 0.96187), abs=1e-4)  # Wilson's, 950 of 1,000
    low, high = Coverage(POINTS[0], 3_000, "f", 10, 10, 0).interval
    assert (low, high) == pytest.approx((0.722, 1.0), abs=1e-3)
