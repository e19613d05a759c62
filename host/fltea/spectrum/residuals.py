"""Test whether the residuals of a model are white: Kolmogorov–Smirnov on the cumulative periodogram."""

import math

import numpy as np

from fltea.records.arrays import Array
from fltea.spectrum.periodogram import AT_ONCE


def farthest(ratio: Array, weight: Array | None = None) -> float:
    """Return √m times the largest distance of the cumulative sum of I/S from a straight line.

    The sum is scaled to end at 1.

    For a correct model all ratios I/S have the same exponential distribution, and the sum is a Brownian
    bridge (Bartlett 1955). `ratio`: I/S, (m,), which is overwritten. `weight`: effective number of ordinates
    of each line; m is then the sum of the weights.
    """
    if weight is not None:
        # An ordinate of weight w contributes w I/S, whose variance is w. So the sum W of all weights replaces
        # m.
        sums, line = np.cumsum(ratio * weight), weight.cumsum()
        return float(np.abs(sums / sums[-1] - line / line[-1]).max()) * math.sqrt(line[-1])
    sums = np.cumsum(ratio, out=ratio)
    m = len(sums)
    farthest = 0.0
    for begin in range(0, m, AT_ONCE):
        part = sums[begin : begin + AT_ONCE]
        line = np.arange(begin + 1, begin + len(part) + 1) / m
        farthest = max(farthest, float(np.abs(part / sums[-1] - line).max()))
    return farthest * math.sqrt(m)


def kolmogorov(p: float) -> float:
    """Return the value that the Kolmogorov–Smirnov statistic exceeds with the small probability `p`."""
    return math.sqrt(-math.log(p / 2) / 2)
