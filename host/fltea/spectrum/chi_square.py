"""Quantiles of the chi-squared distribution, of any real number of degrees of freedom (pure)."""

import math
from statistics import NormalDist

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

MANY = 150.0
"""Degrees of freedom from which on Wilson and Hilferty's approximation is right to 1e-5."""
TERMS = 240
STEPS = 12


def quantile(probability: float, degrees: ArrayLike) -> Array:
    """Return the value that a chi-squared figure of each of `degrees` > 0 stays below with this probability.

    Raises:
        ValueError: probability is not between 0 and 1, or a number of degrees is not positive.
    """
    k = np.asarray(degrees, dtype=np.float64)
    if not 0 < probability < 1:
        raise ValueError(f"a probability lies between 0 and 1, not at {probability}")
    if not (np.isfinite(k) & (k > 0)).all():
        raise ValueError("degrees of freedom must be positive numbers")
    # Wilson and Hilferty: the cube root of chi² over k is nearly normal.
    spread = 2 / (9 * k)
    root = 1 - spread + NormalDist().inv_cdf(probability) * np.sqrt(spread)
    found = k * np.maximum(root, 0.0) ** 3
    few = k < MANY
    if few.any():
        found[few] = _few(probability, k[few], found[few])
    return np.asarray(found)


def _few(probability: float, k: Array, start: Array) -> Array:
    """Solve by Newton's method on the logarithms of x = chi²/2 and of its distribution, from a start."""
    a = k / 2
    log_gamma = np.array([math.lgamma(one) for one in (a + 1).tolist()])
    # x^a / Γ(a + 1) is above the distribution, so this is below the quantile.
    least = (math.log(probability) + log_gamma) / a
    log_x = np.maximum(least, np.log(np.maximum(start / 2, np.finfo(np.float64).tiny)))
    rising = a[:, np.newaxis] + np.arange(1.0, TERMS + 1)
    for _ in range(STEPS):
        x = np.exp(log_x)
        # P(a, x) = x^a e^-x / Γ(a + 1) (1 + x/(a + 1) + x²/((a + 1)(a + 2)) + ...)
        series = 1 + np.cumprod(x[:, np.newaxis] / rising, axis=1).sum(axis=1)
        log_p = a * log_x - x - log_gamma + np.log(series)
        log_x = log_x - (log_p - math.log(probability)) * series / a
    return np.asarray(2 * np.exp(log_x))
