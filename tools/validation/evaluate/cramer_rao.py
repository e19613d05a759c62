"""The Cramér–Rao bound of α and f for y = x + v: how well they can be known at best.

For long records the Fisher information of Gaussian noise with the spectrum S is (Whittle, *Ark. Mat.* 2,
1953)

    I = n / (4π) ∫ (∂ log S) (∂ log S)ᵀ dλ,    -π < λ < π

here for α, g = h^α f, log s2 and log R, all of them unknown. The bound holds for unbiased estimators. If the
bound is as wide as the range of possible values, an estimator that returns its start value has a smaller
spread.

Spectra of noise with long memory have a cusp at λ = 0 with a width of about |g|^(1/α). Gauss–Legendre points
in u with λ = π u^6 are dense there.
"""

import math
from typing import NamedTuple

import numpy as np
from fltea.records.arrays import Array

PANELS, POINTS = 30, 50
"""Number of panels of u between 0 and 1, and of Gauss–Legendre points in each panel. A single panel with all
points would take seconds to compute at each import.
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
    """Return the mean over 0 ... π of a function whose values at `LAM` are along the last axis."""
    return np.asarray(values @ WEIGHTS)


class Bound(NamedTuple):
    """Smallest possible standard deviations of unbiased estimates."""

    alpha: float
    f: float
    """Of f [s^-α]."""
    F: float
    """Of F = g + α."""
    s2: float
    R: float


def log_slopes(lam: Array, alpha: float, g: float, s2: float, R: float) -> Array:
    """Return ∂ log S by α, g, log s2 and log R, (4, len(lam)). `lam`: frequencies [rad a sample]."""
    z = np.exp(-1j * lam)
    difference = -np.expm1(-1j * lam)  # 1 - z, without its rounding near λ = 0
    order = difference**alpha
    inverse = 1 / (order - g * z)
    x = s2 * np.abs(inverse) ** 2
    share = x / (x + R)
    by_alpha = -2 * (np.log(difference) * order * inverse).real
    by_g = 2 * (z * inverse).real
    return np.stack([share * by_alpha, share * by_g, share, 1 - share])


def fisher(alpha: float, g: float, s2: float, R: float, n: int) -> Array:
    """Return the Fisher information on α, g, log s2 and log R in n samples, (4, 4).

    If R = 0, without log R, (3, 3).
    """
    slopes = log_slopes(LAM, alpha, g, s2, R)
    if R == 0:
        slopes = slopes[:3]
    return np.asarray(n / 2 * mean(slopes[:, np.newaxis] * slopes))


def bound(alpha: float, g: float, s2: float, R: float, n: int, h: float) -> Bound:
    """Return the bound for n samples; the bound of R is 0 if R = 0. `h`: sampling period [s]."""
    covariance = np.linalg.inv(fisher(alpha, g, s2, R, n))
    pair = covariance[:2, :2]
    # f = h^-α g
    of_f = np.array([-math.log(h) * g, 1.0]) * h**-alpha
    logs = np.sqrt(np.diag(covariance)[2:])
    return Bound(
        math.sqrt(pair[0, 0]),
        math.sqrt(of_f @ pair @ of_f),
        math.sqrt(pair.sum()),
        s2 * float(logs[0]),
        R * float(logs[1]) if R else 0.0,
    )
