"""The null test asks whether white noise describes the samples as well as the models with more parts do. Its
table of quantiles is right, and for white noise its p-values are uniform.
"""

import math

import numpy as np
import pytest
from fltea.spectrum.last_refit import null_ratio
from fltea.spectrum.likelihood_ratio import critical_values, p_value
from fltea.spectrum.null_constants import ORDER_COEFFICIENTS, PROBABILITIES
from fltea.spectrum.periodogram import periodogram
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import lfilter

from tests.rig.identify_support import H, long_recursion, white
from tests.rig.spectrum_probe import board_quantile


def p_values(y: np.ndarray) -> np.ndarray:
    several = [periodogram(one, H) for one in y]
    return np.array([p_value(null_ratio(one), one.ordinates) for one in several])


@pytest.mark.parametrize(
    "y",
    [white(600, 200, 1), np.rint(white(600, 200, 7)), np.random.default_rng(11).standard_t(4, (200, 600))],
    ids=["Gaussian", "one LSB per σ", "t4 tails"],
)
def test_p_values_of_white_noise_are_uniform(y: np.ndarray) -> None:
    """Of 200 series of white noise, about 5 % have a p-value below 0.05, and about 50 % one below 0.5.

    The tolerances 4.6 % and 10.6 % are three standard deviations of a binomial. The p-values are computed as
    for Gaussian samples, but are right for other samples, too.
    """
    found = p_values(y)
    assert (found < 0.05).mean() == pytest.approx(0.05, abs=0.046)
    assert (found < 0.5).mean() == pytest.approx(0.5, abs=0.106)


@pytest.mark.parametrize(("alpha", "f"), [(0.3, -1.8), (0.6, -3.0)])
def test_power(alpha: float, f: float) -> None:
    """If the state of a fractional noise has a third of the power, the null test rejects white noise for
    nearly all records of 3,000 samples.
    """
    x = np.array([long_recursion(alpha, H**alpha * f, 3000, seed) for seed in range(20)])
    y = x / x.std() * np.sqrt(0.3) + np.sqrt(0.7) * white(3000, 20, 4)
    assert (p_values(y) < 0.05).mean() >= 0.7


@given(st.floats(0, 2000), st.floats(0, 50), st.integers(64, 10**6))
def test_p_value_falls(ratio: float, more: float, ordinates: int) -> None:
    p, q = p_value(ratio, ordinates), p_value(ratio + more, ordinates)
    assert 0 <= q <= p <= 1


@pytest.mark.parametrize("ordinates", [60, 500, 1500, 30_000, 10**7])
def test_p_value_at_the_table(ordinates: int) -> None:
    """The null test has a table of quantiles. The p-value of each of them is the probability that the table
    states for it. The quantiles hardly depend on the length of the record.
    """
    values = critical_values(ordinates)
    assert 5 < values[PROBABILITIES.index(0.05)] < 8 < values[PROBABILITIES.index(0.01)] < 12
    for probability, value in zip(PROBABILITIES, values.tolist(), strict=True):
        # For a fifth of all white series, neither alternative of the null test fits better than white noise.
        # The test's value is then 0, and its p-value 1.
        assert p_value(value, ordinates) == (pytest.approx(probability) if value > 0 else 1)
    assert p_value(-1e-9, ordinates) == 1


@pytest.mark.parametrize("ordinates", [60, 1500, 30_000, 10**6])
def test_the_board_has_the_same_quantiles(ordinates: int) -> None:
    """The board's quantiles of the null test differ from the host's by at most 4 %. This is the error of a
    simulation such as the one from which the quantiles come.
    """
    for level, p in enumerate((0.05, 0.01, 0.001)):
        c, b, a = ORDER_COEFFICIENTS[PROBABILITIES.index(p)]
        ours = np.polyval([a, b, c], np.log10(ordinates))
        assert board_quantile(level, ordinates) == pytest.approx(ours, rel=0.04)


def through_high_pass(n: int, corner_hz: float, seed: int) -> np.ndarray:
    """Return white noise minus its exponential average."""
    gain = -math.expm1(-2 * math.pi * corner_hz * H)
    y = white(n, 1, seed)[0]
    return np.asarray(y - lfilter([gain], [1, gain - 1], y))


@pytest.mark.parametrize(("n", "corner_hz"), [(60_000, 0.1), (20_000, 0.3), (3_000, 3.0)])
def test_missing_power_is_rejected_too(n: int, corner_hz: float) -> None:
    y = np.array([through_high_pass(n, corner_hz, seed) for seed in range(12)])
    assert (p_values(y) < 1e-3).mean() >= 0.9
