"""Drift rate of a record: the slope of its straight line, and its uncertainty from the noise.

The line is fitted by least squares. A wave of amplitude 1 in the noise changes the slope by up to 6/T j1(x).
T is the length of the record, j1 a spherical Bessel function, and 2 x the phase [rad] through which the wave
turns in the time T. So the variance of the slope is the noise's spectrum, multiplied by the square of this
and integrated over the frequencies.

A random walk changes the slope far more than white noise does, and so does a relaxation (a Gauss–Markov
process) in a short record. If it is not certain which of these noises is present, each model gives a
variance. The interval then contains the slope with 95 % probability on the average over the models, where
each counts by its own probability.
"""

import math
from collections.abc import Callable, Sequence
from statistics import NormalDist

import numpy as np

from fltea.records.arrays import Array
from fltea.records.fit import Interval
from fltea.records.plus_minus import NORMAL_95

AT_ONCE = 1 << 18
FINE, COARSE = 4000, 1000
"""Numbers of frequencies at which the integral for the variance of the slope is computed. At low frequencies,
where the oscillations of the squared Bessel function j1² matter, FINE frequencies are used. At higher
frequencies, COARSE frequencies are used, and j1² is replaced by its mean over an oscillation.
"""
WAVES_TO = 100.0
OUTSIDE = 0.05
NEAR = 1e-4
"""The half-width of the 95 % interval of the slope is found by a search, up to this relative error."""


def drift_rate(y: Array, h: float, spectrum: Callable[[Array], Array]) -> Interval:
    """Return the slope of `y` (n,), in the unit of `y` per second, with its 95 % interval.

    `spectrum`: function that returns the noise's power spectrum at frequencies [rad a sample], normalised as
    in `periodogram`. `h`: sampling period [s].
    """
    return around(slope(y, h), [slope_variance(len(y), h, spectrum)], [1.0])


def slope(y: Array, h: float) -> float:
    """Return the slope of the least-squares line through `y` (n,), in the unit of `y` per second."""
    n = len(y)
    total, mean = 0.0, float(y.mean())
    for begin in range(0, n, AT_ONCE):
        part = y[begin : begin + AT_ONCE]
        total += float((np.arange(begin, begin + len(part)) - (n - 1) / 2) @ (part - mean))
    return total * 12 / (n * (n * n - 1.0)) / h


def around(value: float, variances: Sequence[float], weights: Sequence[float]) -> Interval:
    """Return the 95 % interval of a value whose error has one of `variances`. It is not known which one.

    `weights`: the probability of each variance; their sum is 1.
    """
    normal = NormalDist()
    stds = [math.sqrt(variance) for variance in variances]
    low, high = 0.0, NORMAL_95 * max(stds)
    while high - low > NEAR * high:
        half = (low + high) / 2
        outside = sum(
            2 * weight * normal.cdf(-half / std) for weight, std in zip(weights, stds, strict=True) if std > 0
        )
        low, high = (half, high) if outside > OUTSIDE else (low, half)
    return Interval(value, value - high, value + high)


def slope_variance(n: int, h: float, spectrum: Callable[[Array], Array]) -> float:
    """Return the variance of the slope of n samples of noise, in the square of the unit per second."""
    highest = n * np.pi / 2
    x = np.linspace(0, min(WAVES_TO, highest), FINE + 1)[1:] - min(WAVES_TO, highest) / FINE / 2
    response = (np.sin(x) / x**2 - np.cos(x) / x) ** 2
    found = float(spectrum(2 * x / n) @ response) * min(WAVES_TO, highest) / FINE
    if highest > WAVES_TO:
        edges = np.geomspace(WAVES_TO, highest, COARSE + 1)
        middle = np.sqrt(edges[1:] * edges[:-1])
        found += float(spectrum(2 * middle / n) @ (np.diff(edges) / (2 * middle**2)))
    return 72 / (np.pi * n**3 * h**2) * found
