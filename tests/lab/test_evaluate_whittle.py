"""The Whittle fit beside the filters: the cheap test of an interval is the interval."""

import numpy as np
import pytest
from fltea.lab.evaluate.cases import POWER, Case, H, samples
from fltea.lab.evaluate.offline import (
    covered,
    fitted_variances,
    whittle_reading,
)
from fltea.spectrum.models import FULL, held, parameters
from fltea.spectrum.periodogram import binned, periodogram
from fltea.spectrum.profile import fractional_fit
from fltea.spectrum.whittle import fit

STRONG = Case(0.8, -1.0, 30.0)
"""Its bound is 0.036 for α and 0.41 for f after 3,000 samples."""


def test_covered_is_within_the_profile_interval() -> None:
    """A little inside either end of the interval that `identify` publishes, and a little outside."""
    data = binned(periodogram(samples(STRONG, 1, 3_000).T, H))
    found = fit(data, FULL)
    profile = fractional_fit(data, found, H)
    order, parameter = found.theta[:, 1:], np.zeros((1, 2))
    low, high = profile.alpha.low, profile.alpha.high
    margin = 0.1 * (high - low)
    for alpha, inside in ((low - margin, 0), (low + margin, 1), (high - margin, 1), (high + margin, 0)):
        assert covered(data, found, held("alpha", alpha), order)[0] == bool(inside)
    # f = 0 is not excluded, so there is one end only.
    low = profile.f.low
    for f, inside in ((1.15 * low, 0), (0.87 * low, 1), (1e-3 * low, 1)):
        assert covered(data, found, held("f", f, H), parameter)[0] == bool(inside)


def test_strong_noise_is_found_and_its_intervals_hold() -> None:
    """20 series: 95 % of the intervals hold the truth; 16 or fewer have a chance of 2 % then."""
    y = samples(STRONG, 20, 3_000)
    found = whittle_reading(y, H, STRONG.alpha, STRONG.f)
    assert found.rejected.all()
    assert found.alpha.mean() == pytest.approx(0.8, abs=0.03)
    assert np.median(found.f) == pytest.approx(-1, abs=0.7)
    assert found.alpha_covered.mean() >= 0.85
    assert found.f_covered.mean() >= 0.85
    wrong = whittle_reading(y[:, :4], H, 0.1, -30.0)
    assert not wrong.alpha_covered.any()
    assert not wrong.f_covered.any()


def test_white_noise_is_not_rejected_and_has_no_truth() -> None:
    found = whittle_reading(samples(Case(), 12, 1_000), H, None, None)
    assert found.rejected.sum() <= 3
    assert found.alpha_covered is None
    assert found.f_covered is None


def test_fitted_variances() -> None:
    """Those of the noise; for white noise the default Q and the power; never 0."""
    noise = Case(0.8, -10.0, 3.0)
    Q, R = fitted_variances(samples(noise, 3, 10_000), H, 0.15, POWER)
    assert np.median(Q) == pytest.approx(noise.noise.s2, rel=0.1)
    assert np.median(R) == pytest.approx(noise.noise.R, rel=0.2)
    Q, R = fitted_variances(samples(Case(), 3, 2_000), H, 0.15, POWER)
    assert np.median(Q) == 0.15
    assert np.median(R) == POWER
    Q, R = fitted_variances(samples(Case(0.4, -1.0, 1e6), 3, 2_000), H, 0.15, POWER)
    assert R.min() >= POWER / 1000


def test_the_held_models_hold() -> None:
    """f near the edge of what is stationary, too."""
    lam = np.linspace(0.05, 3, 40)
    theta = np.array([[0.3, -1.0], [1.9, 2.0]])
    for f in (-0.3, -10.0, -150.0):
        shape = held("f", f, H).shape(lam, theta)
        assert np.isfinite(shape).all()
    full = np.array([[0.7, 0.3, -1.0]])
    np.testing.assert_allclose(held("alpha", 0.7).shape(lam, theta[:1]), FULL.shape(lam, full))
    assert parameters(full).alpha[0] == pytest.approx(0.7)
