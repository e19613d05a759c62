"""Noise that has gone through filters, by another hand: an oversampled chain of scipy's, as in a chip."""

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, lfilter

Array = NDArray[np.float64]

OVERSAMPLED = 20
RATE_HZ = 100.0


def low_passed(n: int, corner_hz: float, poles: int, seed: int) -> Array:
    """White noise of density 1 through a Butterworth filter, sampled at RATE_HZ, (n,)."""
    b, a = butter(poles, corner_hz / (OVERSAMPLED * RATE_HZ / 2))
    rng = np.random.default_rng(seed)
    waves = rng.standard_normal((n + 200) * OVERSAMPLED) * np.sqrt(OVERSAMPLED)
    return np.asarray(lfilter(b, a, waves)[::OVERSAMPLED][-n:])


def averaged(n: int, count: int, seed: int) -> Array:
    """Moving average of white noise, (n,)."""
    waves = np.random.default_rng(seed).standard_normal(n + count - 1)
    return np.convolve(waves, np.ones(count) / count, "valid")


def relaxations(n: int, corners_hz: tuple[float, ...], seed: int, sigma: float = 0.7) -> Array:
    """A sum of Gauss-Markov processes, sigma each, in white noise of variance 1, (n,)."""
    rng = np.random.default_rng(seed)
    total = rng.standard_normal(n)
    for hz in corners_hz:
        phi = np.exp(-2 * np.pi * hz / RATE_HZ)
        total += lfilter([sigma * np.sqrt(1 - phi**2)], [1, -phi], rng.standard_normal(3 * n))[-n:]
    return total


def fractionally_integrated(n: int, d: float, seed: int) -> Array:
    """ARFIMA(0, d, 0) by its moving average of 2 n steps, (n,)."""
    k = np.arange(1, 2 * n)
    weights = np.concatenate([[1.0], np.cumprod((k - 1 + d) / k)])
    waves = np.random.default_rng(seed).standard_normal(2 * n)
    size = 1 << (4 * n).bit_length()
    return np.fft.irfft(np.fft.rfft(weights, size) * np.fft.rfft(waves, size), size)[n : 2 * n]
