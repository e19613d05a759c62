"""Kolmogorov–Smirnov test of a model's residuals, on the cumulative periodogram: are they white?"""

import math

import numpy as np

from fltea.records.arrays import Array
from fltea.spectrum.periodogram import AT_ONCE


def farthest(ratio: Array, weight: Array | None = None) -> float:
    """Return the Kolmogorov–Smirnov statistic of the ratios I/S of m ordinates to a model.

    I is the power of an ordinate, and S the model's power at the same frequency. The cumulative sum of I/S is
    scaled so that it ends at 1. The statistic is √m times the largest distance of this sum from a straight
    line.

    For a correct model, all ratios I/S have the same exponential distribution, and the distance is a Brownian
    bridge (Bartlett 1955). `ratio`: I/S, (m,); the array is overwritten. `weight`: effective number of
    ordinates that each value averages; m is then the sum of the weights.
    """
    if weight is not None:
        # A value is a mean of w ordinates, its weight. It contributes w I/S to the sum, with the variance w.
        # So the sum of all weights takes the place of the number m of ordinates.
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
    """Return the Kolmogorov–Smirnov statistic that a correct model exceeds with the small probability `p`."""
    return math.sqrt(-math.log(p / 2) / 2)
