"""Compute the weights of the Grünwald–Letnikov difference of real order.

The difference of order a of a sequence x is `h^-a * sum_{j=0}^{L} c_j(a) x_{k-j}` with
`c_j(a) = (-1)^j binom(a, j)` (Macias & Sierociuk 2023, sections 2 and 4).
"""

from functools import lru_cache

import numpy as np

from fltea.records.arrays import Array


@lru_cache(maxsize=8)
def _indices(capacity: int) -> Array:
    """Return 0 .. capacity as floats; the array is shared by all callers, and therefore read-only."""
    indices = np.arange(capacity + 1, dtype=np.float64)
    indices.flags.writeable = False
    return indices


def weights(orders: float | Array, n: int) -> Array:
    """Return weights c_0 .. c_n, of shape (n+1,) for one order, or (len(orders), n+1) for several.

    The recurrence is `c_0 = 1, c_j = c_{j-1} (1 - (a+1)/j)`. Orders beyond the range of floats give
    infinities or NaN, never an exception. `n < 0`, and orders with more than one dimension, raise ValueError.
    """
    a = np.asarray(orders, dtype=np.float64)
    if n < 0 or a.ndim > 1:
        raise ValueError(f"weights need n >= 0 and one order or a list of them, got n={n}, shape {a.shape}")
    # One cached array serves all n up to the next power of two, so that a growing history allocates no new
    # array for each n.
    j = _indices(1 << n.bit_length())
    c = np.empty((*a.shape, n + 1))
    c[..., 0] = 1.0
    factors = c[..., 1:]
    # Use (j-1-a)/j, not 1-(a+1)/j: the difference is exact near j = a+1, so integer orders end in exact
    # zeros.
    np.subtract(j[:n], a[..., np.newaxis], out=factors)
    np.divide(factors, j[1 : n + 1], out=factors)
    np.multiply.accumulate(c, axis=-1, out=c)
    return c
