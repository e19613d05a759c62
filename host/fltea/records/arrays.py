"""Define types of numeric arrays, and faster replacements of two slow numpy functions."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Complex = NDArray[np.complex128]


def merged(*grids: Array) -> Array:
    """Return the numbers of all arrays, sorted and without duplicates.

    This function avoids `np.unique`, which loads the module `np.ma` and so takes 20 ms.
    """
    points = np.sort(np.concatenate(grids))
    return points[np.diff(points, prepend=-np.inf) > 0]


def median(values: Array) -> float:
    """Return the median of `values` (n,), which must be finite numbers and at least one.

    `np.median` gives the same result, but also checks for NaN and takes six times as long.
    """
    half = len(values) // 2
    parts = np.partition(values, half)
    upper = float(parts[half])
    return upper if len(values) % 2 else (float(parts[:half].max()) + upper) / 2
