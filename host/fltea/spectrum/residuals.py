"""Kolmogorov–Smirnov test of a model's residuals, on the cumulative periodogram: are they white?"""

import math

import numpy as np

from fltea.records.arrays import Array
from fltea.spectrum.periodogram import AT_ONCE


def farthest(ratio: Array, weight: Array | None = None) -> float:
    """Return the Kolmogorov–Smirnov statistic of a model, from the ratios I/S at m frequencies.

    I is the measured power at a frequency, and S the model's power there. The cumulative sum of I/S is
    divided by its last value, so that it ends at 1. For a correct model, it rises almost like a straight
    line. The statistic is √m times the largest distance from that line.

    For a correct model, all ratios I/S have the same exponential distribution. Then √m times the distance,
    as a function of the frequency, is a Brownian bridge (Bartlett 1955). `ratio`: I/S, (m,); the array is
    overwritten. `weight`: effective number of ordinates (powers at single frequencies) of which each value is
    the mean; m is then the sum of the weights.
    """
    if weight is not None:
        # Each value of I/S is a mean over w ordinates, and w is its weight. It counts in the cumulative sum
        # as often as w single ordinates. So m, the number of ordinates, is the sum of all weights.
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
