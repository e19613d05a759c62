"""The error of a heading, predicted from the samples of a sensor at rest."""

import numpy as np
import pytest
from fltea.noise.filters import LowPass
from fltea.noise.heading import (
    drive_for,
    heading_std,
    heading_stds,
    mean_ahead,
    means_ahead,
    rest_for,
    rested,
)
from fltea.noise.linear_system import System
from fltea.noise.parts import Order, Relaxation, Resonance, Walk, White
from fltea.noise.system import system

H = 0.01
NOISES = {
    "white": (White(0.01),),
    "walk": (White(0.01), Walk(0.02)),
    "relaxation": (White(0.01), Relaxation(0.05, 2.0)),
}
MORE = NOISES | {
    "resonance": (White(0.01), Resonance(0.5, 12.0, 3.0), Relaxation(0.05, 0.2)),
    "low-pass": (White(0.01), LowPass(20.0, 2.0), Relaxation(0.05, 0.1)),
    "order": (White(0.01), Order(0.8, -1.0, 3e-4)),
}


def _system(name: str) -> System:
    found = system(MORE[name], H, 60000)
    return found if found.walks else found.with_offset()


def _filtered(s: System, samples: int) -> np.ndarray:
    P = s.P0
    for k in range(samples):
        gain = P @ s.c
        after = P - np.outer(gain, gain) / (gain @ s.c + s.R)
        P = s.A @ after @ s.A.T + s.Q if k < samples - 1 else after
    return P


@pytest.mark.parametrize("name", NOISES)
@pytest.mark.parametrize("samples", [1, 7, 1000])
def test_the_covariance_after_a_rest_is_that_of_one_sample_after_another(name: str, samples: int) -> None:
    s = _system(name)
    assert rested(s, samples) == pytest.approx(_filtered(s, samples), rel=1e-5, abs=1e-9)


@pytest.mark.parametrize("name", NOISES)
def test_headings_of_many_simulated_sensors_spread_as_is_said(name: str) -> None:
    s, rest, more, many = _system(name), 300, 137, 4000
    rng = np.random.default_rng(29)
    root = np.linalg.cholesky(s.Q + 1e-30 * np.eye(len(s.a)))
    # The true initial states are drawn from the filter's prior distribution (variances `P0`), so the bias may
    # be large.
    x = rng.normal(size=(many, len(s.a))) * np.sqrt(np.diag(s.P0))
    mean, P, angle = np.zeros_like(x), s.P0, np.zeros(many)
    for k in range(rest + more):
        y = x @ s.c + rng.normal(size=many) * np.sqrt(s.R)
        if k < rest:
            gain = P @ s.c / (s.c @ P @ s.c + s.R)
            mean = mean + np.outer(y - mean @ s.c, gain)
            P = P - np.outer(gain, s.c @ P)
        else:
            angle += H * (y - mean @ s.c)
        x = x @ s.A.T + rng.normal(size=x.shape) @ root.T
        mean, P = mean @ s.A.T, s.A @ P @ s.A.T + s.Q
    expected = heading_std(s, rested(s, rest), H, more * H)
    # The tolerance is 3.5 standard errors of the standard deviation, which is estimated from 4000 values.
    assert angle.std() == pytest.approx(expected, rel=0.04)


def test_the_heading_of_white_noise_is_its_random_walk_and_that_of_its_mean() -> None:
    s, n, t = _system("white"), 6000, 60.0
    expected = np.sqrt(0.01 * H * t + t**2 * 0.01 / n)
    assert heading_std(s, rested(s, n), H, t) == pytest.approx(expected, rel=1e-3)


def test_a_rest_is_as_long_as_the_heading_needs() -> None:
    s = _system("white")
    found = rest_for(s, H, 60.0, 0.1)
    n = found.rest_s / H
    assert heading_std(s, rested(s, round(n)), H, 60.0) <= 0.1
    assert heading_std(s, rested(s, round(n / 1.05)), H, 60.0) > 0.1


def test_no_rest_is_enough_for_a_heading_better_than_the_noise_of_its_own_minute() -> None:
    found = rest_for(_system("walk"), H, 60.0, 0.1)
    assert found.rest_s is None
    assert "No rest is enough: after 60 s the heading is good to ± " in found.reason
    assert "° (95 %) at best" in found.reason
    assert " m/s (95 %) at best" in rest_for(_system("walk"), H, 60.0, 0.1, " m/s").reason
    wild = _system("walk")
    wild = wild._replace(Q=1e12 * wild.Q)
    assert rest_for(wild, H, 60.0, 0.1).reason == "No rest is enough: after 60 s no heading is left."


@pytest.mark.parametrize("name", ["white", "relaxation", "order"])
def test_a_drive_is_the_inverse_of_a_rest(name: str) -> None:
    s = _system(name)
    within = 1.2 * heading_std(s, rested(s, 3000), H, 30.0)
    drive_s = drive_for(s, H, 30.0, within)
    assert drive_s is not None
    assert drive_s > 30.0
    P = rested(s, 3000)
    assert heading_std(s, P, H, drive_s) <= within < heading_std(s, P, H, 1.02 * drive_s)
    assert rest_for(s, H, drive_s, within).rest_s == pytest.approx(30.0, rel=0.05)


def test_a_drive_ends_when_the_heading_is_off_for_the_first_time() -> None:
    """With a resonance at 1 Hz the error of the heading oscillates. It exceeds the permitted error after half
    a period, and is small again after a whole period.
    """
    s = system((White(1e-8), Resonance(1.0, 1.0, 0.02)), H, 60000)
    half, whole = heading_stds(s, rested(s, 1), H, [0.5, 1.0])
    assert whole < 0.5 * half
    drive_s = drive_for(s, H, H, 0.7 * half)
    assert drive_s is not None
    assert 0.2 < drive_s < 0.5


def test_a_drive_may_be_none_and_may_have_no_end() -> None:
    s = _system("white")
    assert drive_for(s, H, 30.0, 1e-9) == 0.0
    assert drive_for(s, H, 30.0, 1e9) is None
    assert drive_for(_system("walk"), 7200.0, 7200.0, 1e9) is None, "one sample is longer than an hour"


def _summed(s: System, samples: int) -> tuple[np.ndarray, float]:
    """Return the expectation and the variance of the mean of the biases at the next `samples` samples.

    The expectation is a row vector: its product with the present state is the expected mean. Both are summed
    sample by sample; the tested code uses powers of matrices.
    """
    rows = [s.bias]
    for _ in range(samples):
        rows.append(rows[-1] @ s.A)
    # Noise that drives the state j samples before the last sample changes j + 1 of the biases. Its effects on
    # these are summed first.
    to_come = np.cumsum(rows[:-1], axis=0)
    variance = sum(float(one @ s.Q @ one) for one in to_come)
    return np.sum(rows[1:], axis=0) / samples, variance / samples**2


@pytest.mark.parametrize("name", MORE)
def test_the_mean_of_the_bias_ahead_is_the_sum_of_its_samples(name: str) -> None:
    s, counts = _system(name), [1, 2, 10, 137, 1000]
    for samples, one in zip(counts, means_ahead(s, counts), strict=True):
        row, variance = _summed(s, samples)
        assert one.row == pytest.approx(row, rel=1e-9, abs=1e-12)
        assert one.variance == pytest.approx(variance, rel=1e-9, abs=1e-18)
        alone = mean_ahead(s, samples)
        assert alone.row == pytest.approx(one.row)
        assert alone.variance == pytest.approx(one.variance)


@pytest.mark.parametrize("name", ["walk", "resonance", "low-pass"])
def test_simulated_means_of_the_bias_spread_as_is_said(name: str) -> None:
    s, more, many = _system(name), 50, 4000
    at = mean_ahead(s, more)
    rng = np.random.default_rng(31)
    values, vectors = np.linalg.eigh(s.Q)
    root = vectors * np.sqrt(np.maximum(values, 0))
    start = rng.normal(size=(many, len(s.a))) * 0.1
    x, mean = start, np.zeros(many)
    for _ in range(more):
        x = x @ s.A.T + rng.normal(size=x.shape) @ root.T
        mean += x @ s.bias / more
    off = mean - start @ at.row
    assert off.std() == pytest.approx(np.sqrt(at.variance), rel=0.04)
    assert abs(off.mean()) < 4 * np.sqrt(at.variance / many)


def test_a_mean_of_no_samples_is_refused() -> None:
    with pytest.raises(ValueError, match="at least one sample"):
        mean_ahead(_system("walk"), 0)
