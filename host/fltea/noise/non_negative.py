"""Solve least squares for coefficients of 0 or more, by the method of active sets.

The algorithm is that of Lawson & Hanson, *Solving Least Squares Problems*, 1974, chapter 23. SciPy has it,
too, but fltea does not depend on SciPy.
"""

import numpy as np

from fltea.records.arrays import Array, Mask

TOLERANCE = 1e-10
"""Coefficients and derivatives of the sum of squares that are at most this count as 0. They are compared with
it after the columns of M and the right side d were scaled to length 1.
"""
ROUNDS = 10
"""The number of iterations is at most this many times the number of columns."""


def non_negative(M: Array, d: Array) -> Array:
    """Return x (columns,), with no element below 0, that minimises |M x - d|. `M`: (rows, columns)."""
    lengths = np.sqrt((M * M).sum(axis=0))
    scale = float(np.sqrt(d @ d)) or 1.0
    lengths[lengths == 0] = 1.0
    M, d = M / lengths, d / scale
    x, free = np.zeros(M.shape[1]), np.zeros(M.shape[1], dtype=bool)
    for _ in range(ROUNDS * len(x)):
        slope = np.where(free, -np.inf, M.T @ (d - M @ x))
        if not len(x) or slope.max() <= TOLERANCE:
            break
        free[slope.argmax()] = True
        x = _within(M, d, x, free)
    return np.asarray(x * scale / lengths)


def _within(M: Array, d: Array, x: Array, free: Mask) -> Array:
    """Return the coefficients that minimise |M x - d|, where only those marked in `free` may differ from 0.

    Coefficients that would turn negative are set to 0, and unmarked in `free`.
    """
    while free.any():
        best = np.zeros(len(x))
        best[free] = np.linalg.lstsq(M[:, free], d, rcond=None)[0]
        below = free & (best <= 0)
        if not below.any():
            return best
        way = (x[below] / np.maximum(x[below] - best[below], np.finfo(float).tiny)).min()
        x = x + way * (best - x)
        free &= (x > TOLERANCE) | ~below
        if (free & below & (x > TOLERANCE)).sum() == below.sum():
            break
        x[~free] = 0.0
    return np.zeros(len(x)) if not free.any() else x
