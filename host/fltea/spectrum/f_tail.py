"""Tail of Fisher's F distribution for real degrees of freedom, as a normal deviate (pure).

Peizer and Pratt's approximation (*J. Am. Stat. Assoc.* 63, 1968). Of tails down to 1e-9,
and from two degrees on, its deviate is within 0.02 of the true one.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def f_deviate(ratio: ArrayLike, first: ArrayLike, second: ArrayLike) -> Array:
    """Return the standard normal deviate that is exceeded as often as F with these degrees exceeds ratio.

    All of one shape, or broadcast; ratio >= 0, degrees >= 2.
    """
    x, a, b = (np.asarray(one, dtype=np.float64) for one in (ratio, first, second))
    s, t = (b - 1) / 2, (a - 1) / 2
    n = s + t
    p = np.clip(b / (a * x + b), 1e-300, 1 - 1e-12)
    q = 1 - p
    d = s + 1 / 6 - (n + 1 / 3) * p + 0.04 * (q / b - p / a + (q - 0.5) / (a + b))
    spread = (1 + q * _g(s / (n * p)) + p * _g(t / (n * q))) / ((n + 1 / 6) * p * q)
    return np.asarray(d * np.sqrt(spread))


def _g(x: Array) -> Array:
    """Return (1 - x² + 2x log x) / (1 - x)², which is (1 - x)/3 near 1."""
    away = 1 - x
    near = np.abs(away) < 1e-3
    safe = np.where(near, 2.0, x)
    exact = (1 - safe**2 + 2 * safe * np.log(safe)) / (1 - safe) ** 2
    return np.where(near, away / 3, exact)
