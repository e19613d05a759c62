"""The exact Gaussian likelihood of a stationary series, as a check of Whittle's approximation.

The autocovariances come from the spectrum by quadrature. The likelihood comes from the one-step prediction
errors of the Levinson–Durbin recursion (Brockwell & Davis, *Time Series: Theory and Methods*, section 5.2).
The unknown mean of the series is estimated by generalised least squares. The computing time grows with the
square of the length: a twentieth of a second for 3,000 samples.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from fltea.records.arrays import Array

CIRCLE = 1 << 17
"""The spectrum is used at this number of frequencies from 0 to 2π. A noise that remembers more samples than
this needs more frequencies.
"""
AVERAGED = 64
"""Each of the CIRCLE frequencies is the middle of a bin. In the AVERAGED lowest bins, the mean of the
spectrum over the bin is used in place of its value in the middle, since the spectrum has a cusp at 0.
"""
POINTS, POWER = 48, 6
"""POINTS: number of Gauss–Legendre points from which the mean of the spectrum over one bin is computed. They
are numbers u from 0 to 1, as proportions of the bin's width. In the lowest bin, u^POWER is taken in place of
u, so that the frequencies are dense near 0.
"""


class Innovations(NamedTuple):
    """One-step prediction errors of n samples, and their variances."""

    error: Array
    """(n, columns)"""
    variance: Array
    """(n,)"""


class Likelihood(NamedTuple):
    """The likelihood of one series, with the most likely mean and the most likely scale of the noise."""

    nll: float
    """-log L, including all constants."""
    mean: float
    scale: float
    """The series is most likely if the given autocovariances are multiplied by this factor."""


def frequencies() -> Array:
    """Return the frequencies at which `autocovariance` needs the spectrum [rad a sample]."""
    return np.concatenate([_averaged()[0].ravel(), _middles()[AVERAGED:]])


def autocovariance(values: Array, n: int) -> Array:
    """Return the autocovariances γ(0) ... γ(n - 1) of a spectrum. `values`: the spectrum at `frequencies()`.

    Raises:
        ValueError: n is more than an eighth of CIRCLE, for which the quadrature is too coarse.
    """
    if not 0 < n <= CIRCLE // 8:
        raise ValueError(f"n must be 1 to {CIRCLE // 8} samples, got {n}")
    weight = _averaged()[1]
    low = (values[: weight.size].reshape(weight.shape) * weight).sum(axis=1)
    half = np.zeros(CIRCLE)
    half[: CIRCLE // 2] = np.concatenate([low, values[weight.size :]])
    turn = np.exp(-1j * np.pi / CIRCLE * np.arange(n))
    return np.asarray((np.fft.rfft(half)[:n] * turn).real * (2 / CIRCLE))


def innovations(gamma: Array, y: Array) -> Innovations:
    """Predict every sample of y (n, columns) from the samples before it.

    `gamma`: autocovariances (n,) of each column of y.

    Raises:
        ValueError: the values in `gamma` cannot be autocovariances.
    """
    n = len(y)
    variance, weights = np.empty(n), np.zeros(n)
    error = np.array(y, dtype=np.float64)
    lags, before = np.ascontiguousarray(gamma[::-1]), np.ascontiguousarray(y[::-1])
    left = float(gamma[0])
    for k in range(n):
        if k:
            known = weights[: k - 1]
            partial = (float(gamma[k]) - float(known @ lags[n - k : n - 1])) / left
            known -= partial * known[::-1].copy()
            weights[k - 1] = partial
            left *= 1 - partial * partial
            error[k] -= weights[:k] @ before[n - k :]
        if not left > 0:
            raise ValueError("these are not the autocovariances of a stationary series")
        variance[k] = left
    return Innovations(error, variance)


def likelihood(gamma: Array, y: Array) -> Likelihood:
    """Return the likelihood of one series y (n,) whose autocovariances are proportional to `gamma` (n,).

    Raises:
        ValueError: the values in `gamma` cannot be autocovariances.
    """
    n = len(y)
    error, variance = innovations(gamma, np.column_stack([y, np.ones(n)]))
    of_y, of_one = (error / np.sqrt(variance)[:, np.newaxis]).T
    mean = float(of_y @ of_one / (of_one @ of_one))
    rest = of_y - mean * of_one
    scale = float(rest @ rest) / n
    nll = 0.5 * (n * (math.log(2 * math.pi * scale) + 1) + float(np.log(variance).sum()))
    return Likelihood(nll, mean, scale)


def of_spectrum(spectrum: Callable[[Array], Array], y: Array) -> Likelihood:
    """Return the likelihood of one series y (n,).

    `spectrum`: function that returns, for frequencies λ (m,) [rad a sample], values (m,) proportional to the
    spectrum of the noise.
    """
    return likelihood(autocovariance(spectrum(FREQUENCIES), len(y)), y)


def _middles() -> Array:
    return np.asarray(2 * np.pi / CIRCLE * (np.arange(CIRCLE // 2) + 0.5))


def _averaged() -> tuple[Array, Array]:
    """Return frequencies in the lowest bins, and their weights; both have the shape (AVERAGED, POINTS).

    A row belongs to one bin. The weighted sum of the spectrum at its frequencies is the mean over the bin.
    """
    u, weight = np.polynomial.legendre.leggauss(POINTS)
    u, weight = (u + 1) / 2, weight / 2
    inside, weights = np.tile(u, (AVERAGED, 1)), np.tile(weight, (AVERAGED, 1))
    inside[0], weights[0] = u**POWER, weight * POWER * u ** (POWER - 1)
    points: Array = 2 * np.pi / CIRCLE * (np.arange(AVERAGED)[:, np.newaxis] + inside)
    return points, weights


FREQUENCIES = frequencies()
