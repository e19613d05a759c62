"""Fits of spectra: the search, known answers, invariances, nesting, intervals."""

from functools import cache

import numpy as np
import pytest
from fltea.noise import spectra as spectrum
from fltea.spectrum import models
from fltea.spectrum.likelihood_ratio import null_fits
from fltea.spectrum.periodogram import Binned, Periodogram, binned, periodogram, used_ordinates
from fltea.spectrum.profile import FractionalFit, below_by_chance, critical_value, fractional_fit
from fltea.spectrum.whittle import Fit, fit, negative_log_likelihood
from hypothesis import given, settings
from hypothesis import strategies as st
from identify_support import H, ar, drawn, long_recursion, white
from simplex import minimise
from slow_profile import NO_WHITE

NAMES = ("F", "alpha", "g", "f", "s2", "R")


def test_simplex_finds_the_minima_of_many_starts_at_once() -> None:
    """Rosenbrock's valley from all sides, each start with a valley of its own."""
    starts = np.random.default_rng(1).uniform(-2, 2, (30, 2))

    def valley(x: np.ndarray, rows: np.ndarray) -> np.ndarray:
        a = 1 + rows / 30
        return 100 * (x[:, 1] - x[:, 0] ** 2) ** 2 + (a - x[:, 0]) ** 2

    points, values = minimise(valley, starts, tolerance=1e-12, steps=2000)
    np.testing.assert_allclose(points[:, 0], 1 + np.arange(30) / 30, atol=1e-4)
    assert values.max() < 1e-8


def test_white_fit_in_closed_form() -> None:
    data = binned(periodogram(white(3000, 3, 2), H))
    found = fit(data, models.WHITE)
    mean = (data.power @ data.counts) / data.ordinates
    np.testing.assert_allclose(found.scale, mean)
    np.testing.assert_allclose(found.nll, data.ordinates * (np.log(mean) + 1))


def test_likelihood_by_the_sum_over_ordinates() -> None:
    """Single ordinates (short series), term by term."""
    lam = 2 * np.pi * np.arange(4, 40) / 80
    power = np.random.default_rng(1).exponential(size=len(lam))
    data = binned(Periodogram(lam, power, H, 80))
    s = 0.7 * spectrum.ar1(data.lam, 0.4)
    by_hand = sum(c * (np.log(si) + p / si) for c, si, p in zip(data.counts, s, data.power[0], strict=True))
    value, _ = negative_log_likelihood(data, s[np.newaxis], np.zeros(1, dtype=int), np.ones(1))
    assert value[0] == pytest.approx(by_hand)


@pytest.mark.parametrize(("phi", "noise"), [(0.9, 0.0), (0.5, 1.0), (-0.6, 0.5)])
def test_ar1_is_found(phi: float, noise: float) -> None:
    y = ar((phi,), 4000, 20, 3) + np.sqrt(noise) * white(4000, 20, 4)
    found = fit(binned(periodogram(y, H)), models.AR1)
    values = models.ar1_parameters(found.theta)[0]
    assert np.median(values) == pytest.approx(phi, abs=0.05)


@pytest.mark.parametrize(("alpha", "f", "near"), [(0.4, -1.0, 0.15), (0.6, -3.0, 0.07), (0.8, -1.0, 0.07)])
def test_fractional_noise_is_found(alpha: float, f: float, near: float) -> None:
    """α, and 2 log L of the truth below the best like χ² with four degrees."""
    y = np.array([long_recursion(alpha, H**alpha * f, 20_000, seed) for seed in range(16)])
    data = binned(periodogram(y, H))
    found = fit(data, models.FULL)
    assert np.median(models.parameters(found.theta).alpha) == pytest.approx(alpha, abs=near)
    truth = np.repeat(spectrum.fractional(data.lam, alpha, H**alpha * f)[np.newaxis], 16, axis=0)
    deviance = 2 * (negative_log_likelihood(data, truth, np.arange(16))[0] - found.nll)
    assert deviance.min() > 0
    assert 0.5 < np.median(deviance) < 6


@settings(max_examples=4)
@given(st.integers(0, 1000), st.floats(1e-6, 1e6))
def test_scale_multiplies_the_variances_and_nothing_else(seed: int, c: float) -> None:
    lam = 2 * np.pi * used_ordinates(1500, H) / 1500
    p = drawn(spectrum.fractional(lam, 0.6, -0.2) + 0.5, lam, 1500, seed)
    one = fit(binned(p), models.FULL)
    other = fit(binned(p._replace(power=p.power * c**2)), models.FULL)
    np.testing.assert_allclose(other.theta, one.theta, rtol=1e-3, atol=1e-3)
    assert other.scale[0] == pytest.approx(one.scale[0] * c**2, rel=1e-3)


@settings(max_examples=5)
@given(st.integers(0, 10_000), st.sampled_from([500, 3000]))
def test_models_are_nested(seed: int, n: int) -> None:
    """White within AR(1) within the alternative; none may be worse than what it contains."""
    fits = null_fits(binned(periodogram(white(n, 4, seed), H)))
    assert (fits.ar1.nll <= fits.white.nll + 1e-2).all()
    assert (fits.ratio_to_ar1 >= -1e-3).all()
    assert (fits.likelihood_ratio >= -1e-2).all()


def test_series_do_not_influence_each_other() -> None:
    y = np.stack(
        [long_recursion(0.6, -0.2, 1000, 1), long_recursion(0.3, -0.5, 1000, 2), white(1000, 1, 1)[0]]
    )
    together = fit(binned(periodogram(y, H)), models.FULL)
    for i in range(3):
        alone = fit(binned(periodogram(y[i : i + 1], H)), models.FULL)
        assert alone.nll[0] == pytest.approx(together.nll[i], abs=1e-6)


@cache
def _profiled(alpha: float, f: float, n: int, seed: int) -> tuple[Binned, Fit, FractionalFit]:
    """Noise of s2 = 1 and R = 0.3, fitted; it takes a second, and tests share it."""
    lam = 2 * np.pi * used_ordinates(n, H) / n
    data = binned(drawn(spectrum.fractional(lam, alpha, H**alpha * f) + 0.3, lam, n, seed))
    found = fit(data, models.FULL)
    return data, found, fractional_fit(data, found, H)


def test_intervals_cover_the_truth() -> None:
    """95 % intervals of all parameters over 2 series: 12, of which few may miss."""
    g = H**0.6 * -3.0
    truth = dict(zip(NAMES, (g + 0.6, 0.6, g, -3.0, 1.0, 0.3), strict=True))
    missed = []
    for seed in range(2):
        found = _profiled(0.6, -3.0, 10_000, seed)[2]
        for name, true in truth.items():
            p = getattr(found, name)
            assert p.defined, name
            assert p.low <= p.value <= p.high, name
            if not p.low <= true <= p.high:
                missed.append((seed, name))
    assert len(missed) <= 2, missed
    assert pytest.approx(found.s2.value * H ** (-2 * found.alpha.value)) == found.Q


def test_intervals_shrink_with_the_record() -> None:
    short, long = (_profiled(0.6, -3.0, n, 1)[2] for n in (10_000, 1_000_000))
    for name in NAMES:
        a, b = getattr(short, name), getattr(long, name)
        assert b.high - b.low < 0.4 * (a.high - a.low), name


def test_interval_of_F_below_minus_one() -> None:
    """A resonance near half the rate: α near 2 and F = 2 cos θ, as α - 2^α < F < α allows."""
    radius, angle = 0.9, 2.4
    data = binned(periodogram(ar((2 * radius * np.cos(angle), -(radius**2)), 2000, 1, 1), H))
    F = fractional_fit(data, fit(data, models.FULL), H).F
    assert F.low is not None
    assert F.high is not None
    assert F.value < -1.2
    assert F.low < F.value - 0.003
    assert F.value + 0.003 < F.high < F.value + 0.1


def test_interval_by_a_fine_search() -> None:
    """The ends of α's interval are where the likelihood has fallen by 3.84, on a grid of its own."""
    data, found, fitted = _profiled(0.6, -3.0, 10_000, 0)
    interval = fitted.alpha
    assert interval.low is not None
    assert interval.high is not None
    for end in (interval.low, interval.high):
        g, w = np.meshgrid(np.linspace(-0.32, -0.08, 121), np.linspace(0.4, 0.999, 120))
        shape = models.FULL.shape(data.lam, models.coordinates(end, g.ravel(), w.ravel()))
        nll, _ = negative_log_likelihood(data, shape, np.zeros(g.size, dtype=int))
        assert 2 * (nll.min() - found.nll[0]) == pytest.approx(3.84, abs=0.4)


def test_intervals_where_there_is_no_white_noise() -> None:
    """R = 0 is at the end of what is possible; the fit with R = 0 has 2 log L only 0.5 less than the best."""
    alpha, g = 0.4, -(H**0.4)
    data = binned(periodogram(long_recursion(alpha, g, 3000, 6), H))
    found = fractional_fit(data, fit(data, models.FULL), H)
    assert found.R.value > 0.3
    assert found.R.low == 0
    assert found.F.low is not None
    assert found.F.low < 0.27
    assert found.s2.high is not None
    assert found.s2.high > 0.95


def test_white_noise_leaves_the_order_undefined() -> None:
    data = binned(periodogram(white(3000, 1, 2), H))
    found = fit(data, models.FULL)
    free = fractional_fit(data, found, H)
    assert not free.alpha.defined
    assert not free.f.defined
    told = fractional_fit(data, found, H, white=True)
    assert not any(getattr(told, name).defined for name in NAMES)


@pytest.mark.parametrize(("name", "at_bound"), [("F", 5.1), ("alpha", 4.8), ("f", 4.6)])
def test_critical_value_where_there_is_no_white_noise(name: str, at_bound: float) -> None:
    """An end is where 2 log L has fallen by 3.84, or by more if the spectrum there has R = 0.

    With 4.6 for all of them F was held in 92 % of 1,000 series, with 3.84 in 90 %.
    """
    alpha, g = 0.4, -(H**0.4)
    lam = 2 * np.pi * used_ordinates(3_000, H) / 3_000
    fallen: dict[bool, list[float]] = {True: [], False: []}
    for seed in range(16):
        data = binned(drawn(spectrum.fractional(lam, alpha, g), lam, 3_000, seed))
        found = fit(data, models.FULL)
        interval = getattr(fractional_fit(data, found, H), name)
        for end in (interval.low, interval.high):
            if end == 0:  # all that is possible
                continue
            there = fit(data, models.held(name, end, H))
            no_white = float(np.exp(-there.theta[0, -1])) < NO_WHITE
            fallen[no_white].append(2 * float(there.nll[0] - found.nll[0]))
    assert np.median(fallen[True]) == pytest.approx(at_bound, abs=0.05)
    assert np.median(fallen[False]) == pytest.approx(3.841, abs=0.05)
    assert max(fallen[True]) < at_bound + 0.2
    assert max(fallen[False]) < at_bound  # where R falls to 0 at once
    assert min(map(len, fallen.values())) >= 4


def test_a_peak_that_may_be_chance_leaves_the_rest_in_the_interval() -> None:
    """Nearly white noise of 30 s, whose best order is above 1 in 4 of 10 series: F, s2 and R of 0.3 remain.

    Without it they were held in 92 % of 1,000 series.
    """
    alpha, g = 0.3, -3 * H**0.3
    lam = 2 * np.pi * used_ordinates(3_000, H) / 3_000
    shape = 0.3 * spectrum.fractional(lam, alpha, g) + 1
    peaks = 0
    for seed in range(30):
        data = binned(drawn(shape, lam, 3_000, seed))
        found = fit(data, models.FULL)
        below = below_by_chance(data, found)
        if below < 0.5:
            continue
        peaks += 1
        F, best = fractional_fit(data, found, H).F, fit(data, models.UP_TO_ONE)
        p = models.parameters(best.theta[0])
        assert 0 < 2 * float(best.nll[0] - found.nll[0]) == below <= 6
        assert F.low is not None
        assert F.high is not None
        assert F.low <= float(p.alpha + p.g) <= F.high
        there = fit(data, models.held("F", F.high, H))
        critical = critical_value("F", float(np.exp(-there.theta[0, -1])) < NO_WHITE)
        assert 2 * float(there.nll[0] - found.nll[0]) == pytest.approx(critical + below, abs=0.1)
    assert peaks >= 4


def test_neither_a_resonance_nor_an_order_a_little_above_one_is_by_chance() -> None:
    """Of α = 1 the best order is above 1 in half of the series; the best up to 1 is 1: no other maximum."""
    resonance = binned(periodogram(ar((1.9 * 0.95, -(0.95**2)), 3_000, 1, 1), H))
    lam = 2 * np.pi * used_ordinates(3_000, H) / 3_000
    shape = spectrum.fractional(lam, 1.0, -5 * H) + 10
    above = []
    for data in (resonance, *(binned(drawn(shape, lam, 3_000, seed)) for seed in range(20))):
        found, other = fit(data, models.FULL), fit(data, models.UP_TO_ONE)
        order, below_one = (float(models.parameters(one.theta[0]).alpha) for one in (found, other))
        if order > 1 and (data is resonance or below_one > 0.9999):
            above.append(below_by_chance(data, found))
    assert above == [0] * len(above)
    assert len(above) >= 5
