"""Recursions and impulse responses by scipy's filters. They share no code with the fits."""

import math
from typing import Any

import numpy as np
from fltea.records.arrays import Array
from scipy.signal import lfilter, oaconvolve


class Stream:
    """The filter b(z) / a(z) for an input that comes in pieces.

    With each piece, the filter continues where the piece before ended.
    """

    def __init__(self, b: Any, a: Any, state: float = 0.0) -> None:
        self._b, self._a = b, a
        self._zi = np.full(max(len(a), len(b)) - 1, state)

    def run(self, e: Array) -> Array:
        """Return the output for one piece (n,) of the input."""
        if not len(e):
            return e  # an empty piece is not passed to scipy, which would forget the filter's state
        y, self._zi = lfilter(self._b, self._a, e, zi=self._zi)
        return np.asarray(y)


def fractional_difference(d: float, n: int) -> Array:
    """Return n coefficients of (1 - B)^-d, where B delays by one sample.

    The coefficients are the impulse response of fractional integration.

    If d < 0, they are the impulse response of a fractional difference.
    """
    k = np.arange(1.0, n)
    return np.concatenate([[1.0], np.cumprod((k - 1 + d) / k)])


def state_response(alpha: float, g: float, n: int) -> Array:
    """Return the impulse response x_1 ... x_n of the state, if ω_0 = 1 and all other ω are 0.

    The state is x_{k+1} = g x_k - sum_j c_j(α) x_{k+1-j} + ω_k, where c_j(α) are the coefficients of the
    difference of order α, g = h^α f, and h is the sampling period.
    """
    series = fractional_difference(-alpha, n)
    series[1] -= g
    return inverse_series(series)


def inverse_series(c: Array) -> Array:
    """Return the coefficients (n,) of 1 / c(z), for a power series with c[0] = 1, by Newton's method."""
    found = np.ones(1)
    while len(found) < len(c):
        m = min(2 * len(found), len(c))
        size = 4 * (1 << (m - 1).bit_length())
        a, b = np.fft.rfft(c[:m], size), np.fft.rfft(found, size)
        found = np.asarray(np.fft.irfft(b * (2 - a * b), size)[:m])
    return found


def convolved(e: Array, response: Array, n: int) -> Array:
    """Return the last `n` samples of `e` filtered by `response`; len(e) >= n + len(response) - 1."""
    return np.asarray(oaconvolve(e, response, mode="valid")[-n:])


class FractionalState:
    """Draws samples of the state D^α x = f x + ω of order α, with steps of variance 1.

    g = h^α f, where h is the sampling period.

    Each sample x depends on at least `PAST` steps before it, so the series is stationary from the first
    sample.
    """

    PAST = 1 << 16

    def __init__(self, alpha: float, g: float, n: int) -> None:
        self._n = n
        self._size = 1 << (n + self.PAST - 1).bit_length()
        self._response = state_response(alpha, g, self._size - n)
        self.power = float(self._response @ self._response)
        """Variance of x."""

    def draw(self, rng: np.random.Generator) -> Array:
        """Return n new samples of x."""
        return convolved(rng.standard_normal(self._size), self._response, self._n)


def fractional_noise(d: float, n: int, rng: np.random.Generator) -> Array:
    """Return n samples of ARFIMA(0, d, 0) with |d| < 1/2.

    They have exactly the autocovariance of this process.
    """
    k = np.arange(1.0, n + 1)
    variance = math.exp(math.lgamma(1 - 2 * d) - 2 * math.lgamma(1 - d))
    covariance = variance * np.concatenate([[1.0], np.cumprod((k - 1 + d) / (k - d))])
    return circulant_noise(covariance, rng)


def fractional_gaussian_noise(hurst: float, n: int, rng: np.random.Generator) -> Array:
    """Return n samples of fractional Gaussian noise of variance 1.

    They have exactly the autocovariance of this noise.
    """
    k = np.arange(n + 1.0)
    power = 2 * hurst
    return circulant_noise((np.abs(k - 1) ** power - 2 * k**power + (k + 1) ** power) / 2, rng)


def circulant_noise(covariance: Array, rng: np.random.Generator) -> Array:
    """Return n samples of Gaussian noise with a given autocovariance (n + 1,).

    The method is that of Davies and Harte (1987).
    """
    n = len(covariance) - 1
    eigenvalues = np.maximum(np.fft.rfft(np.concatenate([covariance, covariance[-2:0:-1]])).real, 0.0)
    z = np.empty(n + 1, dtype=np.complex128)
    z.real = rng.standard_normal(n + 1)
    z.imag = rng.standard_normal(n + 1)
    z *= np.sqrt(eigenvalues * n)
    z[[0, -1]] = z[[0, -1]].real * math.sqrt(2)
    return np.asarray(np.fft.irfft(z, 2 * n)[:n])
