"""Poles of state-space models that approximate the parts of a noise, computed from the parts' parameters."""

import math
from collections.abc import Sequence

import numpy as np

from fltea.records.arrays import Complex

A_DECADE = 2
"""An order is approximated by this number of poles per decade of frequency."""
FASTEST = 3.0
"""The poles e^-r that approximate an order have rates r of at most this, per sample."""
MOST_POLES = 6
"""Largest number of poles of a low-pass or high-pass. With more poles, the filter has about the same response
in the band that it lets pass.
"""
MOST_TAPS = 10
"""Largest number of taps of a short filter."""
SMALL = 0.005
"""A short filter has taps but no poles. It is approximated by n poles on a circle around 0, with about this
error. The n-th root of this number is the circle's radius.
"""


def size(poles: Sequence[complex]) -> int:
    """Return the number of states of a real state-space model with these poles.

    Each complex pole stands for a pair.
    """
    return sum(1 if is_real(one) else 2 for one in poles)


def is_real(pole: complex) -> bool:
    """Return whether a pole is real. A real pole needs one state instead of two."""
    return abs(complex(pole).imag) < 1e-9


def short(taps: int) -> list[complex]:
    """Return poles by which any short filter with this number of taps can be approximated."""
    if taps < 2:
        return [0.0] * taps
    n = (taps + 2) // 2 * 2
    return [
        SMALL ** (1 / n) * complex(np.exp(2j * math.pi * k / n)) for k in range(min(n, MOST_TAPS) // 2 + 1)
    ]


def spread(low: float, room: int) -> list[complex]:
    """Return at most `room` real poles e^-r. Their rates r rise from `low` in steps of equal ratio.

    Rates are per sample.
    """
    count = 1 + math.ceil(A_DECADE * math.log10(FASTEST / low))
    return list(np.exp(-np.geomspace(low, FASTEST, max(min(count, room), 1))))


def of_order(alpha: float, g: float, slowest: float) -> list[complex]:
    """Return the exact or nearly exact poles z of a fractional order, which solve (1 - 1/z)^α = g / z.

    g is h^α f, with the sampling period h. Poles with rates below `slowest` are left out.
    """
    rate = (-g) ** (1 / alpha) if g < 0 < alpha else 0.0
    if alpha > 1:
        w = 1 - rate * complex(np.exp(1j * math.pi / alpha))
        for _ in range(20 if rate > slowest else 0):
            w -= ((1 - w) ** alpha - g * w) / (-alpha * (1 - w) ** (alpha - 1) - g)
        return [1 / w] if abs(w) > 1 + slowest else []
    v = 1.0
    for _ in range(40 if g < 0 else 0):
        v = min((1 + v) ** alpha / -g, 1e6)
    found: list[complex] = [math.exp(-rate)] if rate > slowest else []
    return [*found, -1 / v] if v > 1 else found


def of_low_pass(lam: float, poles: float) -> tuple[list[complex], int]:
    """Return the poles with imaginary part ≥ 0 of a low-pass with its corner at λ, and a number of taps.

    `poles`: number of poles, which sets how steeply the response falls. If it is not whole, the next whole
    number is used. Taps (the coefficients of a weighted sum of samples) have to correct the response then.
    """
    n = math.ceil(min(max(poles, 1.0), MOST_POLES))
    angles = np.pi * (n + 1 + 2 * np.arange((n + 1) // 2)) / (2 * n)
    return list(np.exp(lam * np.exp(1j * angles))), 2 if poles != n else 0


def of_high_pass(lam: float, poles: float) -> Complex:
    """Return all poles of a high-pass with its corner frequency at λ. `poles` is rounded to a whole number.

    The filter has as many zeros, all at z = 1. For n poles and c = |1 - e^{-iλ}|², the poles are the z with
    |z| < 1 for which -(1 - z)²/z is one of the roots s² of 1 + (c/s²)^n = 0.
    """
    n = min(max(round(poles), 1), MOST_POLES)
    c = (2 * math.sin(min(lam / 2, math.pi / 2))) ** 2
    half = 1 - c * np.exp(1j * math.pi * (2 * np.arange(n) + 1) / n) / 2
    z = half + np.sqrt(half**2 - 1 + 0j)
    return np.asarray(np.where(np.abs(z) < 1, z, 1 / z))
