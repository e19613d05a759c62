"""The Cramér–Rao bound of α and f for y = x + v. It says how well α and f can be known at best.

For long records the Fisher information of Gaussian noise with the spectrum S is (Whittle, *Ark. Mat.* 2,
1953)

    I = n / (4π) ∫ (∂ log S) (∂ log S)ᵀ dλ,    -π < λ < π

Here the four unknown parameters are α, g = h^α f, log s2 (s2: variance of the steps of x) and log R (R:
variance of v). The bound holds for unbiased estimators. It does not hold for biased ones: an estimator that
always returns its start value has no spread at all, even where the bound is as wide as the range of possible
values.

Spectra of noise with long memory have a cusp at λ = 0 with a width of about |g|^(1/α). The points at which
integrals are evaluated must be dense there. They are Gauss–Legendre points in u, where λ = π u^6.
"""

import math
from typing import NamedTuple

import numpy as np
from fltea.records.arrays import Array

PANELS, POINTS = 30, 50
"""Integrals over the frequency λ = π u^6 are computed over u, from 0 to 1. PANELS: number of panels into
which this range is divided. POINTS: number of Gauss–Legendre points in each panel. To compute as many points
for a single panel would take seconds at each import.
"""
POWER = 6


def _points() -> tuple[Array, Array]:
    node, share = np.polynomial.legendre.leggauss(POINTS)
    u = ((node + 1) / 2 + np.arange(PANELS)[:, None]).ravel() / PANELS
    weight = np.tile(share / 2 / PANELS, PANELS)
    return np.pi * u**POWER, weight * POWER * u ** (POWER - 1)


LAM, WEIGHTS = _points()
"""Frequencies between 0 and π [rad a sample], and the weight of each frequency in a mean."""


def mean(values: Array) -> Array:
    """Return the mean of a function over the frequencies from 0 to π.

    `values`: values of the function at the frequencies `LAM`, along the last axis.
    """
    return np.asarray(values @ WEIGHTS)


class Bound(NamedTuple):
    """Smallest possible standard deviations of unbiased estimates."""

    alpha: float
    f: float
    """Smallest standard deviation of an estimate of f [s^-α]."""
    F: float
    """Smallest standard deviation of an estimate of F = g + α, where g = h^α f."""
    s2: float
    R: float


def log_slopes(lam: Array, alpha: float, g: float, s2: float, R: float) -> Array:
    """Return the derivatives of the log spectrum, as an array (4, len(lam)).

    They are the derivatives with respect to α, g = h^α f (h: sampling period), log s2 and log R, where s2 is
    the variance of the steps of x and R the variance of v.

    `lam`: frequencies [rad a sample].
    """
    z = np.exp(-1j * lam)
    difference = -np.expm1(-1j * lam)  # 1 - z, without loss of digits near frequency 0
    order = difference**alpha
    inverse = 1 / (order - g * z)
    x = s2 * np.abs(inverse) ** 2
    share = x / (x + R)
    by_alpha = -2 * (np.log(difference) * order * inverse).real
    by_g = 2 * (z * inverse).real
    return np.stack([share * by_alpha, share * by_g, share, 1 - share])


def fisher(alpha: float, g: float, s2: float, R: float, n: int) -> Array:
    """Return the Fisher information of n samples on α, g = h^α f, log s2 and log R, as a (4, 4) matrix.

    s2 is the variance of the steps of x, R the variance of v. If R = 0, log R is left out, and the matrix is
    (3, 3).
    """
    slopes = log_slopes(LAM, alpha, g, s2, R)
    if R == 0:
        slopes = slopes[:3]
    return np.asarray(n / 2 * mean(slopes[:, np.newaxis] * slopes))


def bound(alpha: float, g: float, s2: float, R: float, n: int, h: float) -> Bound:
    """Return the Cramér–Rao bound for n samples (0 for R if R = 0). `h`: sampling period [s]."""
    covariance = np.linalg.inv(fisher(alpha, g, s2, R, n))
    pair = covariance[:2, :2]
    # Derivatives of f = h^-α g with respect to α and g. They convert the covariance of α and g to the
    # variance of f.
    of_f = np.array([-math.log(h) * g, 1.0]) * h**-alpha
    logs = np.sqrt(np.diag(covariance)[2:])
    return Bound(
        math.sqrt(pair[0, 0]),
        math.sqrt(of_f @ pair @ of_f),
        math.sqrt(pair.sum()),
        s2 * float(logs[0]),
        R * float(logs[1]) if R else 0.0,
    )
