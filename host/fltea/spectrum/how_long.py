"""How much longer a sensor has to be looked at until its order is known well enough (pure)."""

import numpy as np

from fltea.noise.distributions import NORMAL_95
from fltea.spectrum.frontier import Frontier, Sentence, native
from fltea.spectrum.intervals import order_deviation

LONGEST_S = 30 * 86_400.0
"""No record is that long."""


def seconds_more(
    f: Frontier, sentence: Sentence, target: float, longest_s: float | None = None
) -> float | None:
    """Return seconds of samples until the 95 % interval of α is ± target, if the noise stays as it is.

    sentence: of `f`, with an order. longest_s: of samples that are not forgotten; None: none are. 0 if it is
    as narrow; None if that will never be, or cannot be known.
    """
    deviation = order_deviation(f, sentence)
    if deviation is None:
        return None
    have = 2 * f.ordinates * f.h
    needed = have * (NORMAL_95 * deviation / target) ** 2
    if longest_s is not None and needed > max(longest_s, have):
        return None
    return max(needed - have, 0.0)


def seconds_to_tell(f: Frontier, duration_s: float, apart: float) -> float | None:
    """Return the length of a record that tells an order from the sentence without one by so much in 2 log L.

    f: of a record of duration_s. That longer records also show slower waves is not counted, so that it may
    well be shorter. None if it is longer than any record, or if there is no order.
    """
    if f.ordered is None:
        return None
    gain = min(_gain(f, f.ordered, f.rich), _gain(f, f.rich, f.ordered))
    needed = apart + abs(f.ordered.parameters - f.rich.parameters)
    if not gain * LONGEST_S > needed * duration_s:
        return None
    return duration_s * max(needed / gain, 1.0)


def _gain(f: Frontier, true: Sentence, other: Sentence) -> float:
    """Return what 2 log L of the other sentence lacks on average, if this one is true."""
    expected = f.data._replace(power=true.spectrum(f.data.lam, f.h)[np.newaxis])
    fits = native(expected, f.h, f.samples)
    _, nll = fits.fit(list(other.codes), list(other.eta))
    best = float(f.data.counts @ np.log(expected.power[0])) + f.ordinates
    return max(2 * (nll - best), 0.0)
