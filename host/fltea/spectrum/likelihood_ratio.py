"""Null test: does the noise contain anything beyond white noise?

The statistic is 2 log of a ratio of two likelihoods, each of a Whittle fit: that of the better of two
alternatives, divided by that of white noise. The first alternative is the fractional state D^α x = f x + ω
with α <= 1 in white noise. Its power is larger at low frequencies, or at high ones, than elsewhere. The
second alternative is white noise through a high-pass of one pole, which has less power at low frequencies.
The alternatives have parameters that mean nothing for white noise, such as the order α or the corner
frequency. So the statistic does not follow χ². Its distribution is therefore simulated
(tools/gen_null_constants.py). The distribution hardly depends on the length of the record.
"""

import math

import numpy as np

from fltea.records.arrays import Array
from fltea.spectrum.null_constants import COEFFICIENTS, PROBABILITIES

_COEFFICIENTS = np.array(COEFFICIENTS).T
_PROBABILITIES = np.array(PROBABILITIES)
_LOGARITHMS = np.log(_PROBABILITIES)


def p_value(likelihood_ratio: float, ordinates: float) -> float:
    """Return the probability that white noise gives at least this ratio. `ordinates`: number of ordinates."""
    quantiles = critical_values(ordinates)
    if likelihood_ratio >= quantiles[-1]:
        return float(_PROBABILITIES[-1] * math.exp(-(likelihood_ratio - quantiles[-1]) / 2))
    above = quantiles > 0  # the ratio is often 0, when neither alternative is better than white noise
    ratios = np.concatenate([[0.0], quantiles[above]])
    logarithms = np.concatenate([[0.0], _LOGARITHMS[above]])
    return float(np.exp(np.interp(likelihood_ratio, ratios, logarithms)))


def critical_values(ordinates: float) -> Array:
    """Return the likelihood ratios that white noise exceeds with the probabilities `PROBABILITIES`.

    The first of them belongs to the largest probability.
    """
    x, (c, b, a) = math.log10(ordinates), _COEFFICIENTS
    return np.maximum.accumulate(np.maximum((a * x + b) * x + c, 0.0))
