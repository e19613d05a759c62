"""Null test: is there anything in the noise beyond white? (pure).

The statistic is the likelihood ratio of two Whittle fits, white noise against the fractional state in white
noise with α <= 1. White noise has no α, g and s2, so the ratio is not chi-squared: its distribution is
simulated (tools/gen_null_constants.py). It hardly depends on the length of the record.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fltea.spectrum.models import AR1, UP_TO_ONE, WHITE, ar1_parameters, coordinates
from fltea.spectrum.null_constants import COEFFICIENTS, PROBABILITIES
from fltea.spectrum.periodogram import Binned
from fltea.spectrum.warm import Search
from fltea.spectrum.whittle import Fit, fit

Array = NDArray[np.float64]


class NullFits(NamedTuple):
    """The fits that the test compares, and their statistic for each series."""

    white: Fit
    ar1: Fit
    alternative: Fit

    @property
    def likelihood_ratio(self) -> Array:
        """Return 2 (log L of the alternative - log L of white), (series,), 0 or more."""
        return 2 * (self.white.nll - self.alternative.nll)

    @property
    def ratio_to_ar1(self) -> Array:
        """Return the same against AR(1) in white noise, which is the alternative with α = 1."""
        return 2 * (self.ar1.nll - self.alternative.nll)


def null_fits(data: Binned, search: Search = fit) -> NullFits:
    """Fit what the null test needs."""
    ar1 = search(data, AR1)
    phi, weight = ar1_parameters(ar1.theta)
    inside = coordinates(1.0, phi - 1, weight)[:, np.newaxis]
    return NullFits(fit(data, WHITE), ar1, search(data, UP_TO_ONE, inside))


def p_value(likelihood_ratio: float, ordinates: float) -> float:
    """Return the probability that white noise gives this ratio or more, with so many ordinates."""
    quantiles = critical_values(ordinates)
    probabilities = np.array(PROBABILITIES)
    if likelihood_ratio <= quantiles[0]:
        share = max(likelihood_ratio, 0.0) / quantiles[0]
        return float(1 - share * (1 - probabilities[0]))
    if likelihood_ratio >= quantiles[-1]:
        return float(probabilities[-1] * math.exp(-(likelihood_ratio - quantiles[-1]) / 2))
    return float(np.exp(np.interp(likelihood_ratio, quantiles, np.log(probabilities))))


def critical_values(ordinates: float) -> Array:
    """Return the ratios that white noise exceeds with `PROBABILITIES`, from 50 % down to 0.1 %."""
    return np.asarray(np.polynomial.polynomial.polyval(math.log10(ordinates), np.array(COEFFICIENTS).T))
