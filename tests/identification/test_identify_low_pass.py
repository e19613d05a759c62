"""Tests of noise after a low-pass, for which FLTEA's α has no meaning: if α is given with a small σ, there
is always a warning.
"""

import math

import numpy as np
import pytest
from fltea.records.fit import Interval
from fltea.settings.estimator import EstimatorConfig
from fltea.spectrum.innovation_whiteness import describes, describes_order
from scipy.signal import butter, lfilter

from tests.rig.identify_files import identify_axis
from tests.rig.identify_support import H, white
from tests.rig.one_fltea import fltea_fit

FILTERS = {"one pole, 5 Hz": (1, 5.0), "two poles, 20 Hz": (2, 20.0), "two poles, 41 Hz": (2, 41.0)}
N = 6_000


def behind(name: str, seed: int, std: float = 0.14) -> np.ndarray:
    """Return white noise after the low-pass filter `name` of FILTERS. The sampling rate is 100 Hz."""
    b, a = butter(*FILTERS[name], fs=1 / H)
    y = lfilter(b, a, white(N + 500, 1, seed)[0])[500:]
    return np.asarray(y * (std / y.std()))


@pytest.mark.parametrize("name", FILTERS)
def test_no_alpha_behind_a_low_pass_goes_unmarked(name: str) -> None:
    for seed in range(4):
        found = fltea_fit(behind(name, seed), H, EstimatorConfig(variant="joint"))[0]
        assert found.describes_noise is False


def test_what_the_filter_describes_is_not_marked() -> None:
    """FLTEA's filter describes an AR(1) process: it is a state of order 1, driven by white noise."""
    phi, rng = 0.6, np.random.default_rng(3)
    ar1 = lfilter([1.0], [1.0, -phi], 0.14 * rng.standard_normal(20_000))
    one = Interval(1.0, 0.9, 1.1)
    assert fltea_fit(ar1, H, EstimatorConfig(variant="joint"), order=one)[0].describes_noise is True


@pytest.mark.parametrize("walk", [0.0, 2e-4])
def test_white_innovations_do_not_make_an_order(walk: float) -> None:
    """White noise, alone or with an offset that does a random walk, has no order α. FLTEA's innovations are
    white for this noise, but they do not prove that it has an order.
    """
    y, rng = 0.14 * white(20_000, 1, 4)[0], np.random.default_rng(3)
    y = y + walk * rng.standard_normal(len(y)).cumsum()
    found, innovations = fltea_fit(y, H, EstimatorConfig(variant="joint"))
    assert describes(innovations.samples, innovations.ljung_box)
    assert found.describes_noise is None, "nobody says whether there is one"
    judged = identify_axis(y, H).fltea
    assert judged.describes_noise is False


def test_an_order_that_is_not_the_fits_does_not_describe_the_noise() -> None:
    fit = Interval(0.5, 0.4, 0.6)
    for alpha, allowed in ((0.5, True), (0.38, True), (0.35, False), (0.62, True), (0.65, False)):
        assert describes_order(True, alpha, 0.02, fit) is allowed
    assert describes_order(True, math.nan, math.nan, fit) is None
    for order in (None, fit):
        assert describes_order(False, 0.5, 0.02, order) is False
        assert describes_order(None, 0.5, 0.02, order) is None
    assert describes_order(True, 0.5, 0.02, None) is None
    assert describes_order(True, 0.5, 0.02, Interval()) is False


def test_both_are_needed() -> None:
    """Correlated innovations count as evidence against FLTEA's filter only if the correlation is both
    significant and large.

    In a record of a day, every correlation is significant. In 200 samples, correlations by chance are large.
    """
    assert describes(8_000_000, 8_000_000 * 0.05**2)
    assert not describes(8_000_000, 8_000_000 * 0.11**2)
    assert describes(200, 200 * 0.4**2)
    assert not describes(200, 200 * 0.5**2)
