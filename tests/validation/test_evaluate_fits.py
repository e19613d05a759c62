"""The fits beside the filters: the same fit of the whole record and of what is kept of it live."""

import numpy as np
import pytest

from tools.validation.evaluate.cases import POWER, Case, H, samples
from tools.validation.evaluate.fits import (
    QUANTITIES,
    fitted_variances,
    live_readings,
    truths,
    whole_reading,
)

STRONG = Case(0.8, -1.0, 30.0)
"""Its bound is 0.036 for α and 0.41 for f after 3,000 samples."""


def test_truths() -> None:
    assert truths(Case()) == {}
    found = truths(STRONG)
    assert tuple(found) == QUANTITIES
    assert found["s2"] / found["R"] == pytest.approx(30)
    assert found["F"] == pytest.approx(0.8 - 0.01**0.8)


def test_up_to_three_thousand_samples_live_is_the_whole_record() -> None:
    """The accumulators still hold every sample then."""
    y = samples(STRONG, 3, 3_000)
    truth = truths(STRONG)
    (live,), whole = live_readings(y, H, (3_000,), truth), whole_reading(y, H, truth)
    # Above the tenth ordinate f is known to a factor of two, and moves by a fifth of itself.
    for name, most in (("alpha", 0.03), ("F", 0.03), ("s2", 0.1), ("f", 0.25)):
        np.testing.assert_allclose(live.estimates[name], whole.estimates[name], rtol=most, atol=1e-3)
    for name in QUANTITIES:
        np.testing.assert_array_equal(live.covered[name], whole.covered[name])
    np.testing.assert_array_equal(live.published, whole.published)


def test_strong_noise_is_found_and_its_intervals_hold() -> None:
    """60 series of 20,000 samples: 95 % of the intervals hold the truth; 51 or fewer have a chance of 1 %."""
    truth = truths(STRONG)
    _, found = live_readings(samples(STRONG, 60, 20_000), H, (3_000, 20_000), truth)
    assert found.published.all()
    assert found.estimates["alpha"].mean() == pytest.approx(0.8, abs=0.02)
    assert np.median(found.estimates["f"]) == pytest.approx(-1, abs=0.3)
    for name in QUANTITIES:
        assert found.covered[name].sum() >= 51, name
    (wrong,) = live_readings(samples(STRONG, 2, 3_000), H, (3_000,), truth | {"alpha": 0.1, "f": -30.0})
    assert not wrong.covered["alpha"].any()
    assert not wrong.covered["f"].any()


def test_white_noise_has_no_order_and_no_truth() -> None:
    found = whole_reading(samples(Case(), 12, 1_000), H, {})
    assert found.published.sum() <= 1
    assert found.covered == {}


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
