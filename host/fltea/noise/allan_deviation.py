"""Allan deviation of noise with a known spectrum, by quadrature (pure).

With S normalised as in `fltea.noise.spectra` (white noise of variance R has R)

    σ²(m) = 1/π ∫ S(λ) 2 sin⁴(m λ / 2) / (m² sin²(λ / 2)) dλ,    0 < λ < π
"""

from collections.abc import Callable
from functools import cache

import numpy as np
from numpy.typing import ArrayLike

from fltea.records.arrays import Array

NODES = 128
"""Gauss–Legendre nodes in each panel, which is an octave of λ or a part of one of the highest octaves."""
PARTS = (16, 8, 4)
"""Panels in each of the highest octaves, where AR(2) and orders above 1 have resonances."""
PERIODS = 16
"""Where sin(mλ) has more periods in a panel, sin⁴ is taken at its mean, 3/8."""
BELOW = 24
"""Octaves below π/m: there the integrand falls with λ² S; S of a stationary state rises less than λ^-1."""


def model_adev(spectrum: Callable[[Array], Array], factors: ArrayLike) -> Array:
    """Return the Allan deviation (k,) at averaging times (k,) of so many samples, in the unit of the samples.

    spectrum: gives S at frequencies 0 < λ < π in rad a sample, (n,) to (n,).

    Raises:
        ValueError: a factor is not at least 1.
    """
    m = np.atleast_1d(np.asarray(factors, dtype=np.float64))
    if not (np.isfinite(m).all() and (m >= 1).all()):
        raise ValueError("averaging times are numbers of samples, 1 or more")
    edges = _edges(int(np.ceil(np.log2(m.max(initial=1.0)))) + BELOW)
    width = edges[:-1] - edges[1:]
    x, weight = _gauss()
    lam = edges[1:, np.newaxis] + width[:, np.newaxis] * (1 + x) / 2
    # Times dλ, over sin²(λ/2).
    density = spectrum(lam.ravel()).reshape(lam.shape) / np.sin(lam / 2) ** 2
    density *= width[:, np.newaxis] / 2 * weight
    mean = 3 / 8 * density.sum(axis=1)
    found = np.empty(len(m))
    for i, factor in enumerate(m.tolist()):
        fast = factor * width > 2 * np.pi * PERIODS
        exact = ~fast & (factor * edges[:-1] > 0.5**BELOW)
        slow = np.square(np.square(np.sin(factor / 2 * lam[exact]))) * density[exact]  # a power is slower
        found[i] = np.sqrt(2 / np.pi * (mean[fast].sum() + slow.sum())) / factor
    return found


def _edges(octaves: int) -> Array:
    """Return the edges of the panels, falling from π."""
    cuts = [1 - np.arange(n) / (2 * n) for n in (*PARTS, *[1] * (octaves - len(PARTS)))]
    octave = [0.5**k * cut for k, cut in enumerate(cuts)]
    return np.asarray(np.pi * np.append(np.concatenate(octave), 0.5**octaves))


@cache
def _gauss() -> tuple[Array, Array]:
    x, weight = np.polynomial.legendre.leggauss(NODES)
    return x, weight
