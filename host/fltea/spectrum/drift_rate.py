"""The rate at which a record drifts: its straight line, and how far noise alone tilts one (pure).

The line is that of least squares. Its variance is the integral of the noise's spectrum over the response of
the slope, 36/T² j1(x)² with x half a record's angle. A random walk tilts a line far more than white noise,
and a Gauss–Markov part tilts that of a short record too.
"""

from collections.abc import Callable

import numpy as np

from fltea.noise.distributions import NORMAL_95
from fltea.records.arrays import Array
from fltea.records.fit import Interval

AT_ONCE = 1 << 18
FINE, COARSE = 4000, 1000
"""Points of the integral, where the response has its waves and beyond, where their mean counts."""
WAVES_TO = 100.0


def drift_rate(y: Array, h: float, spectrum: Callable[[Array], Array]) -> Interval:
    """Return the slope of y (n,) in its unit a second, with the 95 % interval.

    spectrum: of the noise, at λ in rad a sample, normalised like `periodogram`. h: sampling period in s.
    """
    n = len(y)
    total, mean = 0.0, float(y.mean())
    for begin in range(0, n, AT_ONCE):
        part = y[begin : begin + AT_ONCE]
        total += float((np.arange(begin, begin + len(part)) - (n - 1) / 2) @ (part - mean))
    slope = total * 12 / (n * (n * n - 1.0)) / h
    deviation = float(np.sqrt(slope_variance(n, h, spectrum)))
    return Interval(slope, slope - NORMAL_95 * deviation, slope + NORMAL_95 * deviation)


def slope_variance(n: int, h: float, spectrum: Callable[[Array], Array]) -> float:
    """Return the variance of the slope of n samples of noise, in the square of the unit a second."""
    highest = n * np.pi / 2
    x = np.linspace(0, min(WAVES_TO, highest), FINE + 1)[1:] - min(WAVES_TO, highest) / FINE / 2
    response = (np.sin(x) / x**2 - np.cos(x) / x) ** 2
    found = float(spectrum(2 * x / n) @ response) * min(WAVES_TO, highest) / FINE
    if highest > WAVES_TO:
        edges = np.geomspace(WAVES_TO, highest, COARSE + 1)
        middle = np.sqrt(edges[1:] * edges[:-1])
        found += float(spectrum(2 * middle / n) @ (np.diff(edges) / (2 * middle**2)))
    return 72 / (np.pi * n**3 * h**2) * found
