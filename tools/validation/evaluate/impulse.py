"""Noise drawn from the model's recursion in time; it shares nothing with the spectra that are fitted (pure).

x_{k+1} = g x_k - sum_{j>=1} c_j(α) x_{k+1-j} + ω_k is ω through a filter, whose impulse response is the
inverse of the power series 1 - g z + c_1 z + c_2 z² + ...
"""

import numpy as np
from fltea.noise.weights import weights
from numpy.typing import NDArray

Array = NDArray[np.float64]

PAST = 1 << 16
"""Samples of ω, at least, that each x knows of."""


class Filter:
    """Draws x of α and g, n samples at a time, with innovations of variance 1."""

    def __init__(self, alpha: float, g: float, n: int) -> None:
        self._n = n
        self._size = 1 << (n + PAST - 1).bit_length()
        response = impulse_response(alpha, g, self._size - n)
        self.power = float(response @ response)
        """variance of x"""
        self._response = np.fft.rfft(response, self._size)

    def draw(self, rng: np.random.Generator) -> Array:
        """Another x, (n,)."""
        waves = np.fft.rfft(rng.standard_normal(self._size))
        return np.asarray(np.fft.irfft(waves * self._response, self._size)[-self._n :])


def impulse_response(alpha: float, g: float, n: int) -> Array:
    """What x_1 ... x_n are after ω_0 = 1 alone."""
    series = weights(alpha, n)[:n].copy()
    series[1] -= g
    return _inverse(series)


def _inverse(series: Array) -> Array:
    """The power series b with a b = 1 to the order of a, by Newton's b (2 - a b), which doubles the order."""
    found, n = np.array([1 / series[0]]), len(series)
    while len(found) < n:
        order = min(2 * len(found), n)
        size = 1 << (2 * order).bit_length()
        b = np.fft.rfft(found, size)
        rest = -np.fft.irfft(np.fft.rfft(series[:order], size) * b, size)[:order]
        rest[0] += 2
        found = np.fft.irfft(np.fft.rfft(rest, size) * b, size)[:order]
    return found
