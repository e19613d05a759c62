"""Tests the drift rate of a record, and the drift rate's interval, whose width depends on the noise."""

from functools import partial

import numpy as np
import pytest
from fltea.spectrum.candidate_models import CandidateModels
from fltea.spectrum.drift_rate import drift_rate, slope_variance
from fltea.spectrum.periodogram import binned, periodogram

from tests.rig.identify_support import H, Truth, composite, white


def test_a_ramp() -> None:
    y = 3.0 + 0.02 * H * np.arange(5000, dtype=np.float64)
    found = drift_rate(y, H, np.zeros_like)
    assert (found.value, found.low, found.high) == pytest.approx((0.02,) * 3)


def test_variance_of_white_noise() -> None:
    assert slope_variance(5000, H, np.ones_like) == pytest.approx(12 / (5000**3 * H**2), rel=0.01)


@pytest.mark.parametrize("kind", ["walk", "gauss_markov"])
def test_variance_of_coloured_noise(kind: str) -> None:
    n, series = 2000, 1500
    truth = Truth(0.0, K=1.0) if kind == "walk" else Truth(0.0, ((1.0, 3.0),))
    y = np.array([composite(truth, n, H, seed) for seed in range(series)])
    t = H * (np.arange(n) - (n - 1) / 2)
    slopes = (y - y.mean(axis=1, keepdims=True)) @ t / (t @ t)
    phi = np.exp(-H / 3.0)

    def spectrum(lam: np.ndarray) -> np.ndarray:
        if kind == "walk":
            return np.asarray(H / (2 - 2 * np.cos(lam)))
        return np.asarray((1 - phi**2) / (1 - 2 * phi * np.cos(lam) + phi**2))

    assert np.var(slopes) == pytest.approx(slope_variance(n, H, spectrum), rel=0.15)


@pytest.mark.slow
def test_interval_holds_the_rate_of_white_noise() -> None:
    n, held = 4000, 0
    for y in white(n, 50, 5):
        model = CandidateModels(binned(periodogram(y, H)), H, n).plain
        found = drift_rate(y + 0.01 * H * np.arange(n), H, partial(model.spectrum, h=H))
        held += found.low < 0.01 < found.high
    assert held >= 43
