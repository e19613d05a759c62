"""How much longer a sensor has to be looked at until its order is known well enough (pure)."""

import math

import numpy as np

from fltea.noise.information import log_slopes
from fltea.spectrum.models import parameters
from fltea.spectrum.periodogram import Binned
from fltea.spectrum.whittle import Fit, fit

DEVIATIONS = 1.96
"""Half of a 95 % interval in standard deviations."""
LONGEST_S = 30 * 86_400.0
"""No record is that long."""
NO_WHITE = 1e-4
"""Share of the innovations: less white noise is none, and is no parameter."""


def order_deviation(data: Binned, found: Fit) -> float | None:
    """Return the standard deviation of α by Fisher's information at a fit of FULL, or None.

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
    """Return seconds of samples until the 95 % interval of α is ± target, if the noise stays as it is.

    data: all that is known. h in s. longest_s: of samples that are not forgotten; None: none are. 0 if it is
    as narrow; None if that will never be, or cannot be known.
    """
    deviation = order_deviation(data, found)
    if deviation is None:
        return None
    have = 2 * float(data.counts.sum()) * h
    needed = have * (DEVIATIONS * deviation / target) ** 2
    if longest_s is not None and needed > max(longest_s, have):
        return None
    return max(needed - have, 0.0)


def seconds_to_tell(data: Binned, one: Fit, other: Fit, duration_s: float, apart: float) -> float | None:
    """Return the length of a record that tells two models apart by so much in 2 log L.

    one, other: their fits to `data`, of a record of duration_s. That longer records also show slower waves is
    not counted, so that it may well be shorter. None if it is longer than any record.
    """
    gain = min(_gain(data, one, other), _gain(data, other, one))
    needed = apart + abs(one.model.parameters - other.model.parameters)
    if not gain * LONGEST_S > needed * duration_s:
        return None
    return duration_s * max(needed / gain, 1.0)


def _gain(data: Binned, true: Fit, other: Fit) -> float:
    """Return what 2 log L of the other model lacks on average, if this one is true."""
    expected = data._replace(power=true.spectrum(data.lam))
    lacks = fit(expected, other.model, other.theta[:, np.newaxis])
    m = float(data.counts.sum())
    best = float(data.counts @ np.log(expected.power[0])) + m
    return max(2 * (float(lacks.nll[0]) - best), 0.0)
