"""Null test: is there anything in the noise beyond white? (pure).

The statistic is the likelihood ratio of two Whittle fits, white noise against the fractional state in white
noise with α <= 1. White noise has no α, g and s2, so the ratio is not chi-squared: its distribution is
simulated (tools/gen_null_constants.py). It hardly depends on the length of the record.
"""

import math

import numpy as np

from fltea.records.arrays import Array
from fltea.spectrum.null_constants import COEFFICIENTS, PROBABILITIES

_COEFFICIENTS = np.array(COEFFICIENTS).T
_PROBABILITIES = np.array(PROBABILITIES)
_LOGARITHMS = np.log(_PROBABILITIES)


def p_value(likelihood_ratio: float, ordinates: float) -> float:
    """Return the probability that white noise gives this ratio or more, with so many ordinates."""
    quantiles = critical_values(ordinates)
    if likelihood_ratio <= quantiles[0]:
        share = max(likelihood_ratio, 0.0) / quantiles[0]
        return float(1 - share * (1 - _PROBABILITIES[0]))
    if likelihood_ratio >= quantiles[-1]:
        return float(_PROBABILITIES[-1] * math.exp(-(likelihood_ratio - quantiles[-1]) / 2))
    return float(np.exp(np.interp(likelihood_ratio, quantiles, _LOGARITHMS)))


def critical_values(ordinates: float) -> Array:
    """Return the ratios that white noise exceeds with `PROBABILITIES`, from 50 % down to 0.1 %."""
    x, (c, b, a) = math.log10(ordinates), _COEFFICIENTS
    return np.asarray((a * x + b) * x + c)
