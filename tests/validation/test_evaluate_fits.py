"""The fits beside the filters: the same fit of the whole record and of what is kept of it live."""

import numpy as np
import pytest
from fltea.spectrum.models import FULL
from fltea.spectrum.profile import fractional_fit
from fltea.spectrum.whittle import fit

from tools.validation.evaluate.cases import POWER, Case, H, samples
from tools.validation.evaluate.fits import (
    QUANTITIES,
    fitted_variances,
    live_readings,
    live_spectra,
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
    for name in QUANTITIES:
        np.testing.assert_allclose(live.estimates[name], whole.estimates[name], rtol=0.03, atol=1e-3)
        np.testing.assert_array_equal(live.covered[name], whole.covered[name])
    np.testing.assert_array_equal(live.rejected, whole.rejected)


def test_strong_noise_is_found_and_its_intervals_hold() -> None:
    """20 series of 20,000 samples: 95 % of the intervals hold the truth; 16 or fewer have a chance of 2 %."""
    truth = truths(STRONG)
    _, found = live_readings(samples(STRONG, 20, 20_000), H, (3_000, 20_000), truth)
    assert found.rejected.all()
    assert found.estimates["alpha"].mean() == pytest.approx(0.8, abs=0.02)
    assert np.median(found.estimates["f"]) == pytest.approx(-1, abs=0.3)
    for name in QUANTITIES:
        assert found.covered[name].mean() >= 0.85, name
    (wrong,) = live_readings(samples(STRONG, 2, 3_000), H, (3_000,), truth | {"alpha": 0.1, "f": -30.0})
    assert not wrong.covered["alpha"].any()
    assert not wrong.covered["f"].any()


def test_ends_stay_within_what_is_possible() -> None:
    """A series of faint noise on which the search for an end once left its bracket."""
    y = samples(Case(0.2, -0.3, 0.03), 10, 60_000)[:, 9:]
    ((data,),) = live_spectra(y, H, (60_000,))
    found = fractional_fit(data, fit(data, FULL), H)
    for one in (found.F, found.alpha, found.g, found.f, found.s2, found.R):
        assert one.low is None or one.low <= one.value <= one.high


def test_white_noise_is_not_rejected_and_has_no_truth() -> None:
    found = whole_reading(samples(Case(), 12, 1_000), H, {})
    assert found.rejected.sum() <= 3
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
