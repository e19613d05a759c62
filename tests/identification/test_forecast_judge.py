"""Tests that the check of forecasts accepts right models and rejects wrong ones."""

import math

import numpy as np
import pytest
from fltea.identification.forecast_judge import Judgement, fitted_system, judged
from fltea.noise.filters import LowPass
from fltea.noise.parts import Part, Relaxation, Walk, White
from fltea.records.arrays import Array
from scipy.signal import butter, lfilter

H, N = 0.02, 20_000
WHITE = White(0.01)


def white(seed: int, n: int = N) -> Array:
    return np.random.default_rng(seed).normal(3.0, 0.1, n)


def relaxing(seed: int, sigma: float, tau_s: float) -> Array:
    a = math.exp(-H / tau_s)
    driven = np.random.default_rng((seed, 1)).normal(0, sigma * math.sqrt(1 - a * a), N + 5000)
    return np.asarray(lfilter([1.0], [1.0, -a], driven)[5000:])


def of_half(y: Array, *parts: Part) -> Judgement:
    half = y[: len(y) // 2]
    return judged(fitted_system(parts, half, H), y, len(half), H)


def fails(found: Judgement) -> tuple[bool, bool]:
    return any(one.fails for one in found.heading), any(one.fails for one in found.bias)


@pytest.mark.slow
def test_right_models_hold() -> None:
    # K of the random walk that stands for a relaxation of σ 0.05 and correlation time 8 s in the second
    # model. Above the relaxation's corner frequency, both have the same spectrum.
    slow = 0.05 * math.sqrt(2 / 8)
    failed = 0
    for seed in range(12):
        failed += any(fails(of_half(white(seed), WHITE)))
        failed += any(fails(of_half(white(seed) + relaxing(seed, 0.05, 8.0), WHITE, Walk(slow))))
        failed += any(fails(of_half(white(seed) + relaxing(seed, 0.05, 0.4), WHITE, Relaxation(0.05, 0.4))))
    assert failed <= 1


@pytest.mark.parametrize("what", ["step", "ramp", "twice the noise", "half the noise"])
def test_what_the_first_half_has_not_shown_fails(what: str) -> None:
    y, after = white(3), np.arange(N) > 0.6 * N
    if what == "step":
        y[after] += 0.1
    elif what == "ramp":
        y += np.maximum(np.arange(N) - N // 2, 0) * H * 1e-3
    else:
        y[N // 2 :] = 3 + (y[N // 2 :] - 3) * (2 if what == "twice the noise" else 0.5)
    assert fails(of_half(y, WHITE)) == (True, True)


def test_jumps_that_the_first_half_has_shown_too_do_not_fail() -> None:
    failed = 0
    for seed in range(8):
        rng = np.random.default_rng((9, seed))
        level = 0.08 * (np.cumsum(rng.random(N) < H / 15) % 2)
        failed += any(fails(of_half(white(seed) + level, WHITE, Walk(0.03))))
    assert failed <= 1


def test_the_mean_of_the_rate_about_the_bias_is_of_both() -> None:
    for one in of_half(_filtered(4), White(0.01), LowPass(8.0, 2.0)).bias:
        assert one.said**2 == pytest.approx(one.bias_std**2 + one.noise_std**2, rel=0.1)
        assert one.noise_std == pytest.approx(0.1 * math.sqrt(H / one.t_s), rel=0.15)


def test_noise_that_a_filter_has_coloured_is_not_in_the_bias() -> None:
    """The samples are white noise after a low-pass of the sensor, so neighbouring samples are alike.

    So the tracker can predict a part of the next noise. Bias(T), the expected mean of the bias over the next
    T seconds, leaves this part out. The mean of the samples, with which Bias(T) is compared, contains it.
    """
    deviations = [
        [one.deviations for one in of_half(_filtered(seed), White(0.01), LowPass(8.0, 2.0)).bias[:4]]
        for seed in range(8)
    ]
    # the limit is three standard deviations of a mean of 8 values
    assert np.abs(np.mean(deviations, axis=0)).max() < 1.1


def _filtered(seed: int) -> Array:
    """Return white noise of variance 0.01 after a second-order low-pass, plus a constant 3."""
    b, a = butter(2, 8.0, fs=1 / H)
    return np.asarray(3 + lfilter(b, a, white(seed, N + 500) - 3)[500:])
