"""Degrees of freedom of overlapping Allan variances, for white noise, 1/f noise and a random walk.

The formulas are those of C. A. Greenhall and W. J. Riley, "Uncertainty of stability variances based on finite
differences", PTTI 2003, equations 7 to 10 and 13. They are also in W. J. Riley, NIST SP 1065 (2008), 5.4.1.
They are exact for an Allan variance that compares means of m samples (blocks), where S blocks begin within
the length of one: a block begins every m / S samples.
"""

import functools

import numpy as np
from numpy.typing import ArrayLike

from fltea.records.arrays import Array

PARTS = 8
"""In the running sums of host/native/allan_sums.hpp, this many blocks begin within the length of a block. The
formulas call this number S.
"""
FULL_PARTS = 64
"""If a block begins at every sample, many blocks begin within the length of one block. The formulas use at
most this number of them as S.
"""
FINITE = 33
"""Largest number of samples in a block for which the exact formula for sampled noise is used. For longer
blocks, the formula for continuous time is used.
"""


def degrees_of_freedom(
    power: ArrayLike, factors: ArrayLike, terms: ArrayLike, most_parts: int = PARTS
) -> Array:
    """Return the degrees of freedom of each Allan variance, which are 1 or more.

    `power`: exponent of the noise's power spectrum around the frequency 1/τ: 0 (white), -1 (flicker) or -2
    (random walk). `factors`: number m of samples in a block. `terms`: number of differences between
    neighbouring blocks that were averaged. `most_parts`: number S of blocks that begin within the length of a
    block. If m is smaller, S is m.
    """
    parts = np.broadcast_arrays(
        np.asarray(power, dtype=np.int64),
        np.asarray(factors, dtype=np.float64),
        np.asarray(terms, dtype=np.float64),
    )
    found = [
        _one(int(p), m, max(n, 1.0), min(m, most_parts))
        for p, m, n in zip(*(one.tolist() for one in parts), strict=True)
    ]
    return np.maximum(found, 1.0)


def full_overlap(power: ArrayLike, factors: ArrayLike, samples: int) -> Array:
    """Return the degrees of freedom of Allan variances whose blocks begin at every sample of a record."""
    m = np.asarray(factors, dtype=np.float64)
    terms = 1 + np.floor(np.minimum(m, FULL_PARTS) * (samples - 2 * m) / m)
    return degrees_of_freedom(power, m, terms, FULL_PARTS)


@functools.lru_cache(maxsize=256)  # the function is called with the same arguments for most axes
def _one(power: int, m: float, terms: float, parts: float) -> float:
    reach = min(terms, 3 * parts)
    j = np.arange(0.0, np.ceil(reach))
    squares = _covariance(power, m, np.append(j, reach) / parts) ** 2
    weights = np.append(2 * (1 - j / terms), 1 - reach / terms)
    weights[0] = 1.0
    return float(terms * squares[0] / (weights @ squares))


def _covariance(power: int, m: float, t: Array) -> Array:
    """Return the covariance of two differences between neighbouring blocks, up to a factor.

    The two differences are `t` block lengths apart.
    """
    apart = t[:, np.newaxis] + np.arange(-2.0, 3.0)
    if m > FINITE:
        x = _generalised(power + 2, apart)
    else:
        x = 2 * _generalised(power, apart)
        x -= _generalised(power, apart - 1 / m) + _generalised(power, apart + 1 / m)
    return np.asarray(x @ np.array([1.0, -4.0, 6.0, -4.0, 1.0]))


def _generalised(power: int, t: Array) -> Array:
    """Return the generalised autocovariance of the integral (phase) of power-law noise.

    It is called generalised, since the variance of such an integral is infinite. `t`: lags, in lengths of a
    block.
    """
    size = np.abs(t)
    exponent = 3 - power
    if power % 2 == 0:
        return np.asarray(-size if power == 2 else size**exponent)
    return np.asarray(size**exponent * np.log(np.where(size > 0, size, 1.0)))
