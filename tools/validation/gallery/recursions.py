"""Recursions in the time domain, by numpy alone: nothing here is shared with the fits.

A recursion of millions of samples is cut into rows that run side by side; what a row hands to the next is put
in afterwards. So no compiled filter is needed, and a record can be drawn in pieces.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class OnePole:
    """x_k = pole x_{k-1} + e_k, with real or complex pole, |pole| < 1; goes on where the last piece ended."""

    def __init__(self, pole: complex, state: complex = 0.0) -> None:
        self._pole = pole if isinstance(pole, complex) else float(pole)
        self._state: complex = state

    def run(self, e: Array) -> Any:
        """The x of one piece, (n,)."""
        n = len(e)
        columns = max(1, math.isqrt(n))
        rows = -(-n // columns)
        kind = np.complex128 if isinstance(self._pole, complex) else np.float64
        x = np.zeros((columns, rows), dtype=kind)
        padded = np.zeros(rows * columns)
        padded[:n] = e
        x[:] = padded.reshape(rows, columns).T
        for j in range(1, columns):
            x[j] += self._pole * x[j - 1]
        powers = self._pole ** np.arange(1, columns + 1)
        starts = np.empty(rows, dtype=kind)
        state = self._state
        for i, end in enumerate(x[-1].tolist()):
            starts[i] = state
            state = powers[-1] * state + end
        x += powers[:, np.newaxis] * starts
        out = x.T.reshape(-1)[:n]
        self._state = out[-1].item() if n else self._state
        return out


class Relaxing:
    """A relaxation of unit density at low frequencies (S(0) = 1), stationary from its first sample on."""

    def __init__(self, hz: float, rate_hz: float, rng: np.random.Generator) -> None:
        pole = math.exp(-2 * math.pi * hz / rate_hz)
        self._gain = 1 - pole
        start = self._gain * rng.standard_normal() / math.sqrt(1 - pole * pole)
        self._recursion = OnePole(pole, start)
        self._rng = rng

    def next(self, n: int) -> Array:
        """The next n samples."""
        return np.asarray(self._recursion.run(self._gain * self._rng.standard_normal(n)), dtype=np.float64)


class TwoPoles:
    """A pair of complex poles, DC gain 1, as the sum of two complex recursions."""

    def __init__(self, pole: complex) -> None:
        self._recursion = OnePole(complex(pole))
        self._pole = complex(pole)

    def run(self, e: Array) -> Array:
        """The output of one piece."""
        p = self._pole
        # 1 / ((1 - p/z)(1 - p*/z)) = Re(A / (1 - p/z)) with A = 2 p / (p - p*)
        gain = abs(1 - p) ** 2
        return np.asarray(gain * (2 * p / (p - p.conjugate()) * self._recursion.run(e)).real)


def convolved(e: Array, response: Array, n: int) -> Array:
    """The last n samples of e filtered by `response`; each sees all of it (len(e) >= n + len - 1)."""
    if len(response) <= 64:
        return np.asarray(np.convolve(e, response, mode="valid")[-n:])
    size = 1 << (len(e) - 1).bit_length()
    if size > 1 << 23 and len(response) < 1 << 22:
        return _in_pieces(e, response, n)
    spectrum = np.fft.rfft(e, size)
    spectrum *= np.fft.rfft(response, size)
    # What wraps around falls on the beginning, which is left out.
    return np.asarray(np.fft.irfft(spectrum, size)[len(e) - n : len(e)])


def _in_pieces(e: Array, response: Array, n: int) -> Array:
    """The same by overlapping pieces, so that little is in memory."""
    size = 4 * (1 << (len(response) - 1).bit_length())
    step = size - len(response) + 1
    transfer = np.fft.rfft(response, size)
    begin, out = len(e) - n - len(response) + 1, np.empty(n)
    for at in range(0, n, step):
        part = e[begin + at : begin + at + size]
        full = np.fft.irfft(np.fft.rfft(part, size) * transfer, size)[len(response) - 1 :]
        count = min(step, n - at)
        out[at : at + count] = full[:count]
    return out


def fractional_difference(d: float, n: int) -> Array:
    """Coefficients of (1 - B)^-d, (n,): the response of an order d; d < 0 differences."""
    k = np.arange(1.0, n)
    return np.concatenate([[1.0], np.cumprod((k - 1 + d) / k)])


def stationary_order(d: float, n: int, rng: np.random.Generator) -> Array:
    """ARFIMA(0, d, 0), -1/2 < d < 1/2, exactly: Davies and Harte's circle of its autocovariance."""
    k = np.arange(1.0, n + 1)
    variance = math.exp(math.lgamma(1 - 2 * d) - 2 * math.lgamma(1 - d))
    covariance = variance * np.concatenate([[1.0], np.cumprod((k - 1 + d) / (k - d))])
    circle = np.concatenate([covariance, covariance[-2:0:-1]])
    eigenvalues = np.maximum(np.fft.rfft(circle).real, 0.0)
    del circle, covariance
    size = 2 * n
    z = np.empty(n + 1, dtype=np.complex128)
    z.real = rng.standard_normal(n + 1)
    z.imag = rng.standard_normal(n + 1)
    z *= np.sqrt(eigenvalues * size / 2)
    z[[0, -1]] = z[[0, -1]].real * math.sqrt(2)
    return np.asarray(np.fft.irfft(z, size)[:n])


def inverse_series(c: Array) -> Array:
    """1 / c(z) of a power series with c[0] = 1, by Newton's doubling."""
    found = np.ones(1)
    while len(found) < len(c):
        m = min(2 * len(found), len(c))
        size = 4 * (1 << (m - 1).bit_length())
        a, b = np.fft.rfft(c[:m], size), np.fft.rfft(found, size)
        found = np.asarray(np.fft.irfft(b * (2 - a * b), size)[:m])
    return found
