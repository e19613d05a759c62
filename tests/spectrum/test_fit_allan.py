"""The Allan deviation of the record `fit`."""

import numpy as np
import pytest
from fltea._native import AllanSums
from fltea.noise.spectra import fractional, g_of, step_variance
from fltea.sources.synthetic import NoiseGenerator, NoiseSettings
from fltea.spectrum.fit_allan import fit_allan
from identify_support import H, white


def test_the_curve_of_the_true_model_goes_through_its_intervals():
    settings = NoiseSettings(alpha=0.8, f=-1.0, Q=95.09, R=0.02, lsb_per_dps=0.0)
    noise = NoiseGenerator(settings)
    sums = AllanSums()
    sums.add(np.array([noise.step()[0] for _ in range(12_000)]))
    s2, g = step_variance(0.8, settings.Q, H), g_of(0.8, -1.0, H)
    found = fit_allan(
        sums.points(), sums.span, H, "deg/s", lambda lam: s2 * fractional(lam, 0.8, g) + settings.R
    )
    assert found is not None
    assert found.tau_s[0] == H
    low, model, high = (np.array(one) for one in (found.low, found.model, found.high))
    assert ((low < model) & (model < high)).mean() > 0.7
    assert np.abs(np.log(model / found.adev))[:6].max() < 0.1
    assert found.N is None


def test_white_noise_and_its_model():
    sums = AllanSums()
    sums.add(white(20_000, 1, 1)[0])
    found = fit_allan(sums.points(), sums.span, H, "deg/s", np.ones_like)
    assert found is not None
    assert pytest.approx(0.1, rel=0.02) == found.N
    assert found.model == pytest.approx(np.sqrt(H / np.array(found.tau_s)), rel=1e-6)
    assert found.B is None
    assert found.K is None


@pytest.mark.parametrize("y", [np.empty(0), np.ones(99), np.ones(5000)])
def test_nothing_where_there_is_no_curve(y):
    sums = AllanSums()
    sums.add(y)
    assert fit_allan(sums.points(), sums.span, H, "deg/s", np.ones_like) is None
