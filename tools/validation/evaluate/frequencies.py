"""Integrals over the frequencies of a spectrum (pure).

Spectra with memory have a cusp at λ = 0, as narrow as |g|^(1/α). Gauss's points in u with λ = π u^6 lie dense
there.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

PANELS, POINTS = 30, 50
"""Of u from 0 to 1, and Gauss's points of each: to find those of all in one takes seconds, at each import."""

POWER = 6


def _points() -> tuple[Array, Array]:
    node, share = np.polynomial.legendre.leggauss(POINTS)
    u = ((node + 1) / 2 + np.arange(PANELS)[:, None]).ravel() / PANELS
    weight = np.tile(share / 2 / PANELS, PANELS)
    return np.pi * u**POWER, weight * POWER * u ** (POWER - 1)


LAM, WEIGHTS = _points()
"""Frequencies in rad a sample between 0 and π, and the weight of each in a mean."""


def mean(values: Array) -> Array:
    """The mean over 0 ... π of a function at `LAM`, its last axis."""
    return np.asarray(values @ WEIGHTS)
