"""The scores of a few estimates equal those that are computed by hand.

The Cramér–Rao bound is compared with closed forms and with numerical derivatives.
"""

import math

import numpy as np
import pytest
from fltea.noise import spectra as spectrum
from hypothesis import given, settings
from hypothesis import strategies as st

from tools.validation.evaluate.cramer_rao import LAM, bound, fisher, mean
from tools.validation.evaluate.score import score


def test_by_hand() -> None:
    estimate = np.array([1.0, 2.0, 3.0, 6.0])
    found = score(
        estimate, np.ones(4, dtype=bool), truth=2.0, reported=np.array([0.4, 0.1, 2.0, 2.0]), bound=0.5
    )
    assert (found["seeds"], found["without"], found["mean"], found["bias"]) == (4, 0, 3.0, 1.0)
    assert (found["q05"], found["q95"]) == (1.15, 5.55)
    assert found["sd"] == pytest.approx(math.sqrt(14 / 3), rel=1e-5)
    assert found["rmse"] == pytest.approx(math.sqrt(18 / 4), rel=1e-5)
    assert found["median_error"] == 1.0
    assert found["reported_sd"] == 1.2
    assert found["coverage"] == 0.5  # 2 of 4: the intervals of estimates 2 and 3 contain the true value
    # 3 of 4 are significantly not 0: all but estimate 3, which is 1.5 σ from 0
    assert found["beyond_zero"] == 0.75
    assert found["cramer_rao_sd"] == 0.5
    assert found["sd_over_bound"] == pytest.approx(2 * math.sqrt(14 / 3), rel=1e-5)


def test_what_has_no_value_is_counted_and_left_out() -> None:
    estimate = np.array([0.5, 0.7, 99.0, np.nan])
    valid = np.array([True, True, False, True])
    found = score(estimate, valid, truth=0.6, reported=np.array([1.0, 1.0, 50.0, 1.0]))
    assert (found["seeds"], found["without"], found["mean"], found["coverage"]) == (4, 2, 0.6, 1.0)
    nothing = score(estimate, np.zeros(4, dtype=bool), truth=0.6, reported=np.ones(4), bound=0.1)
    assert (nothing["without"], nothing["mean"], nothing["sd"], nothing["rmse"], nothing["coverage"]) == (
        4,
        *[None] * 4,
    )


def test_given_intervals_win_and_without_a_truth_there_is_no_error() -> None:
    inside = np.array([True, False, False, False])
    found = score(np.zeros(4), np.ones(4, dtype=bool), truth=0.0, reported=np.ones(4), covered=inside)
    assert found["coverage"] == 0.25
    white = score(np.arange(4.0), np.ones(4, dtype=bool), reported=np.ones(4))
    assert (white["bias"], white["rmse"], white["median_error"], white["coverage"]) == (None,) * 4
    assert (white["mean"], white["beyond_zero"]) == (1.5, 0.5)


N, H = 3000, 0.01
CASES = [(0.3, -0.4, 2.0, 0.5), (0.6, -0.19, 1.0, 3.0), (0.8, -0.025, 0.03, 1.0), (1.4, -1.1, 1.0, 0.2)]


@settings(max_examples=25)
@given(phi=st.floats(-0.95, 0.95))
def test_ar1(phi: float) -> None:
    """For α = 1, the state is an autoregression AR(1) with coefficient φ = 1 + g and steps of variance s2,
    where g = h^α f and h is the sampling period. For n samples, its Cramér–Rao bounds are known:
    var φ = (1 - φ²)/n and var log s2 = 2/n.
    """
    information = fisher(1.0, phi - 1, 2.5, 0.0, N)
    assert information[1, 1] == pytest.approx(N / (1 - phi**2), rel=1e-6)
    assert information[2, 2] == pytest.approx(N / 2, rel=1e-9)
    assert information[1, 2] == pytest.approx(0, abs=1e-6 * N)


@pytest.mark.parametrize("d", [0.05, 0.3, 0.45])
def test_fractional_noise(d: float) -> None:
    """For f = 0, noise of order α is ARFIMA(0, d, 0) with d = α. The Cramér–Rao bound of d is known: from n
    samples, the variance of an estimate of d is at least 6/(π² n).
    """
    assert fisher(d, 0.0, 1.0, 0.0, N)[0, 0] == pytest.approx(N * math.pi**2 / 6, rel=1e-6)


@pytest.mark.parametrize("case", CASES)
def test_total_power_is_known_to_two_over_n(case: tuple[float, float, float, float]) -> None:
    """A common factor of the variances s2 and R scales the whole spectrum. From n samples, the variance of an
    estimate of the factor's logarithm is at least 2/n.
    """
    assert fisher(*case, N)[2:, 2:].sum() == pytest.approx(N / 2, rel=1e-9)


def log_spectrum(p: np.ndarray) -> np.ndarray:
    alpha, f, log_s2, log_R = p
    g = spectrum.g_of(alpha, f, H)
    return np.log(math.exp(log_s2) * spectrum.fractional(LAM, alpha, g) + math.exp(log_R))


@pytest.mark.parametrize("case", CASES)
def test_bound_of_alpha_and_f_by_differences(case: tuple[float, float, float, float]) -> None:
    """The Cramér–Rao bound for α and f agrees with one that is computed by finite differences.

    The tested bound is computed with the parameter g = h^α f instead of f, where h is the sampling period.
    The other bound is computed with f, from numerical derivatives of the spectrum that the Whittle fit uses.
    """
    alpha, g, s2, R = case
    here = np.array([alpha, spectrum.f_of(alpha, g, H), math.log(s2), math.log(R)])
    slopes = []
    for i, step in enumerate(1e-5 * np.eye(4)):
        step = step * max(1.0, abs(here[i]))
        slopes.append((log_spectrum(here + step) - log_spectrum(here - step)) / (2 * step[i]))
    information = N / 2 * mean(np.array(slopes)[:, np.newaxis] * np.array(slopes))
    expected = np.sqrt(np.diag(np.linalg.inv(information)))
    found = bound(alpha, g, s2, R, N, H)
    assert found.alpha == pytest.approx(expected[0], rel=1e-4)
    assert found.f == pytest.approx(expected[1], rel=1e-4)


@pytest.mark.parametrize(
    ("shape", "expected"),
    [
        *(
            (1 / ((1 - phi) ** 2 + 4 * phi * np.sin(LAM / 2) ** 2), 1 / (1 - phi**2))
            for phi in (-0.9, 0.5, 0.999, 0.99999)
        ),
        *(
            (spectrum.fractional(LAM, d, 0.0), math.gamma(1 - 2 * d) / math.gamma(1 - d) ** 2)
            for d in (0.1, 0.3)
        ),
    ],
)
def test_means_over_the_frequencies(shape: np.ndarray, expected: float) -> None:
    """The mean of a spectrum over all frequencies is right even if the spectrum is sharp. Examples: that of
    an autoregression AR(1) with a memory of up to 100,000 samples, and one that is infinite at frequency 0.
    """
    assert mean(shape) == pytest.approx(expected, rel=1e-5)
