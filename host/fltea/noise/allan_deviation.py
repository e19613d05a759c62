"""Compute the Allan deviation of noise with a known spectrum, by numerical integration.

The Allan variance for m averaged samples follows from the spectrum S, which is normalised as in
`fltea.noise.spectra` (white noise of variance R has S = R):

    σ²(m) = 1/π ∫ S(λ) 2 sin⁴(m λ / 2) / (m² sin²(λ / 2)) dλ,    0 < λ < π
"""

from collections.abc import Callable, Iterable
from functools import cache, lru_cache

import numpy as np
from numpy.typing import ArrayLike

from fltea.records.arrays import Array

NODES = 128
"""Number of Gauss–Legendre nodes in each panel.

A panel is an interval of λ that is integrated in one piece: an octave of λ, or a part of one of the highest
octaves.
"""
PARTS = (16, 8, 4)
"""Number of panels in each of the three highest octaves of λ. Every other octave has one panel. AR(2) and
orders above 1 may have resonances in the highest octaves, and these need narrow panels.
"""
PERIODS = 16
"""If sin(mλ) has more periods than this within a panel, the power of sin(mλ/2) in the integrand of
`allan_integrals` is replaced by its mean (MEANS).
"""
MEANS = {1: 3 / 8, 2: 35 / 128}
"""Means of sin⁴ and of sin⁸ over a period. The key is the argument `power` of `allan_integrals`."""
BELOW = 24
"""For an averaging time of m samples, the integration begins this number of octaves of λ below π/m.

Lower frequencies contribute nothing: the integrand is proportional to λ² S there, and towards low λ the
spectrum S of a stationary state rises more slowly than λ^-1.
"""


def model_adev(
    spectrum: Callable[[Array], Array], factors: ArrayLike, around: Iterable[tuple[float, float]] = ()
) -> Array:
    """Return the Allan deviation at averaging times of `factors` samples, (k,), in the unit of the samples.

    Args:
        spectrum: a function that returns S (n,) at frequencies 0 < λ < π in rad per sample, (n,).
        factors: averaging times in samples, (k,).
        around: frequency and half-width of each narrow spectral line in S, in rad per sample.

    Raises:
        ValueError: a factor is below 1.
    """
    m = np.atleast_1d(np.asarray(factors, dtype=np.float64))
    if not (np.isfinite(m).all() and (m >= 1).all()):
        raise ValueError("averaging times are numbers of samples, 1 or more")
    return np.asarray(np.sqrt(allan_integrals(spectrum, m, 1, around)))


def allan_integrals(
    density: Callable[[Array], Array],
    factors: ArrayLike,
    power: int,
    around: Iterable[tuple[float, float]] = (),
) -> Array:
    """Return 1/π ∫ F(λ) (2 sin⁴(m λ / 2) / (m² sin²(λ / 2)))^power dλ for each averaging time m, (k,).

    Args:
        density: a function that returns F. If F is a spectrum, the integrals with power 1 are its Allan
            variances.
        factors: averaging times m in samples, (k,).
        power: 1 or 2.
        around: as for `model_adev`.
    """
    lam, weights = _quadrature(tuple(np.asarray(factors, dtype=np.float64).tolist()), tuple(around), power)
    # Use einsum, since a matrix-vector product would make the linear-algebra library start threads.
    return np.asarray(np.einsum("ij,j->i", weights, density(lam)))


@lru_cache(maxsize=2)  # one result takes 3 MB, and more if there are narrow spectral lines
def _quadrature(
    factors: tuple[float, ...], around: tuple[tuple[float, float], ...], power: int
) -> tuple[Array, Array]:
    """Return nodes λ (n,) and weights (k, n), by which `allan_integrals` computes its k integrals.

    The nodes and weights are cached: all axes and devices with records of the same length share them, and
    computing them takes longer than the rest of an integral.
    """
    edges = _edges(int(np.ceil(np.log2(max(factors, default=1.0)))) + BELOW, around)
    width = edges[:-1] - edges[1:]
    x, weight = _gauss()
    lam = edges[1:, np.newaxis] + width[:, np.newaxis] * (1 + x) / 2
    # `density` has dλ and the denominator of the integrand; its numerator sin⁴ or sin⁸ follows below.
    density = width[:, np.newaxis] / 2 * weight / np.sin(lam / 2) ** (2 * power)
    weights = np.zeros((len(factors), *lam.shape))
    for one, factor in zip(weights, factors, strict=True):
        fast = factor * width > 2 * np.pi * PERIODS
        one[fast] = MEANS[power] * density[fast]
        exact = ~fast & (factor * edges[:-1] > 0.5**BELOW)
        one[exact] = np.square(np.square(np.sin(factor / 2 * lam[exact]))) ** power * density[exact]
        one *= 2 / np.pi / factor**2 * (2 / factor**2) ** (power - 1)
    return lam.ravel(), weights.reshape(len(factors), -1)


def _edges(octaves: int, around: Iterable[tuple[float, float]]) -> Array:
    """Return the limits in λ between the panels, from π downwards.

    A panel is an interval that is integrated in one piece. Near a spectral line the panels are narrower.
    """
    cuts = [1 - np.arange(n) / (2 * n) for n in (*PARTS, *[1] * (octaves - len(PARTS)))]
    octave = [0.5**k * cut for k, cut in enumerate(cuts)]
    edges = np.pi * np.append(np.concatenate(octave), 0.5**octaves)
    for lam, half in around:
        offsets = half * 2.0 ** np.arange(np.ceil(np.log2(np.pi / half)))
        near = np.concatenate([lam - offsets, [lam], lam + offsets])
        edges = np.union1d(edges, near[(near > edges.min()) & (near < np.pi)])
    return np.asarray(np.sort(edges)[::-1])


@cache
def _gauss() -> tuple[Array, Array]:
    x, weight = np.polynomial.legendre.leggauss(NODES)
    return x, weight
