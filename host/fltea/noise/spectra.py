"""Compute the spectrum of the fractional state of a noise, and convert between its parameters.

The state of a gyroscope's noise is x_{k+1} = g x_k + α x_k - sum_{j>=2} c_j(α) x_{k+1-j} + noise of variance
s2, where g = h^α f, s2 = h^2α Q, and c_j are the weights of `fltea.noise.weights`. With unlimited memory, x
has the spectrum

    S_x(λ) = s2 / |(1 - e^{-iλ})^α - g e^{-iλ}|²,    λ in rad per sample

The measurement y = x + v, with white noise v of variance R, has the spectrum S_x + R. Spectra here are
normalised like `periodogram`: white noise of variance R has the spectrum R. The functions below return S_x /
s2. The geometric mean of this ratio is 1 wherever x is stationary, since s2 is the variance of x's
innovations.

Two pairs of parameters describe the same noise exactly: (α = 0, g = φ) and (α = 1, g = φ - 1) are both AR(1)
with the coefficient φ. For φ = 0, which is white noise, α has no meaning at all.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fltea.records.arrays import Array

HIGHEST_ORDER = 2.0
"""Upper limit of orders α: with an order of 2 or more, the state x is not stationary."""


def stationary(alpha: ArrayLike, g: ArrayLike) -> NDArray[np.bool_]:
    """Return for which α >= 0 and g = h^α f the state x with unlimited memory has a finite variance.

    The conditions are -2^α < g < 0 for 0 < α < 2; α < 1/2 for g = 0; |g| < 1 for α = 0.
    """
    a, b = np.asarray(alpha, dtype=np.float64), np.asarray(g, dtype=np.float64)
    inside = (a >= 0) & (a < HIGHEST_ORDER) & (b > -(2.0**a))
    return np.asarray(inside & ((b < 0) | ((b == 0) & (a < 0.5)) | ((a == 0) & (b < 1))))


def fractional(lam: Array, alpha: ArrayLike, g: ArrayLike) -> Array:
    """Return S_x / s2, the spectrum of the fractional state x for steps of variance 1 (see the module).

    The arrays α and g = h^α f broadcast, and λ becomes an additional last axis.
    """
    a = np.asarray(alpha, dtype=np.float64)[..., np.newaxis]
    b = np.asarray(g, dtype=np.float64)[..., np.newaxis]
    # Use that 1 - e^{-iλ} = 2 sin(λ/2) e^{i(π - λ)/2}. `size` is |1 - e^{-iλ}|^α.
    size = np.exp(a * np.log(2 * np.sin(lam / 2)))
    distance: Array = size * (size - 2 * b * np.cos(a * ((np.pi - lam) / 2) + lam)) + b * b
    return 1 / distance


def g_of(alpha: float, f: float, h: float) -> float:
    """Return g = h^α f, the parameter f [s^-α] for time in samples. `h`: sampling period [s]."""
    return float(h**alpha * f)


def f_of(alpha: float, g: float, h: float) -> float:
    """Return f [s^-α] from g = h^α f, the same parameter for time in samples. `h`: sampling period [s]."""
    return float(g * h**-alpha)


def step_variance(alpha: float, Q: float, h: float) -> float:
    """Return s2 = h^2α Q, the variance that one step of h seconds adds to the state. `Q`: variance of ω."""
    return float(h ** (2 * alpha) * Q)


def noise_variance(alpha: float, s2: float, h: float) -> float:
    """Return Q = h^-2α s2, the variance of ω. `s2`: variance that one step of h seconds adds to the state."""
    return float(s2 * h ** (-2 * alpha))
