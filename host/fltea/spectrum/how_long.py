"""How much longer a sensor has to be looked at until its order is known well enough (pure)."""

import math

import numpy as np

from fltea.noise.information import log_slopes
from fltea.spectrum.models import parameters
from fltea.spectrum.periodogram import Binned
from fltea.spectrum.whittle import Fit

DEVIATIONS = 1.96
"""Half of a 95 % interval in standard deviations."""
NO_WHITE = 1e-4
"""Share of the innovations: less white noise is none, and is no parameter."""


def order_deviation(data: Binned, found: Fit) -> float | None:
    """Standard deviation of α by Fisher's information at a fit of FULL; None where there is no such figure.

    None of the other parameters is taken to be known.
    """
    p = parameters(found.theta[0])
    scale, weight = float(found.scale[0]), float(p.weight)
    slopes = log_slopes(data.lam, float(p.alpha), float(p.g), weight * scale, (1 - weight) * scale)
    if 1 - weight < NO_WHITE:
        slopes = slopes[:3]
    information = (slopes * data.counts) @ slopes.T
    try:
        variance = float(np.linalg.inv(information)[0, 0])
    except np.linalg.LinAlgError:
        return None
    return math.sqrt(variance) if 0 < variance < 1 else None


def seconds_more(
    data: Binned, found: Fit, h: float, target: float, longest_s: float | None = None
) -> float | None:
    """Seconds of samples until the 95 % interval of α is ± target, if the noise stays as it is.

    data: all that is known. h in s. longest_s: of samples that are not forgotten; None: none are. 0 if it is
    as narrow; None if that will never be, or cannot be told.
    """
    deviation = order_deviation(data, found)
    if deviation is None:
        return None
    have = 2 * float(data.counts.sum()) * h
    needed = have * (DEVIATIONS * deviation / target) ** 2
    if longest_s is not None and needed > max(longest_s, have):
        return None
    return max(needed - have, 0.0)
