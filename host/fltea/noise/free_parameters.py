"""Convert between parameters in physical units and the transformed free parameters of the native fits."""

import math
from collections.abc import Sequence

SMALLEST = 1e-300
"""Value that replaces a variance of 0, which has no logarithm."""
MOST_POLES = 24.0
LOGIT_END = 16.0


def log(value: float) -> float:
    """Return the logarithm of a variance, a rate or a frequency; 0 is replaced by `SMALLEST`."""
    return math.log(max(value, SMALLEST))


def log_lam(frequency_hz: float, h: float) -> float:
    """Return the logarithm of a frequency after conversion to rad per sample. `h`: sampling period [s]."""
    return log(2 * math.pi * frequency_hz * h)


def hz(log_lam: float, h: float) -> float:
    """Return the frequency [Hz], given the logarithm of the frequency in rad per sample.

    `h`: sampling period [s].
    """
    return math.exp(log_lam) / (2 * math.pi * h)


def logit(share: float) -> float:
    """Return the logit log(share / (1 - share)), but at least -LOGIT_END, its lower bound in the fits."""
    found = math.log(share / (1 - share)) if share > 0 else -LOGIT_END
    return max(found, -LOGIT_END)


def logit_of_poles(poles: float) -> float:
    """Return a filter's free parameter in the fits, for its number of poles, which need not be whole.

    The parameter is the logit of where the number lies between 1 and `MOST_POLES`.
    """
    share = min(max((poles - 1) / (MOST_POLES - 1), 1e-7), 1 - 1e-7)
    return math.log(share / (1 - share))


def poles_of_logit(logit: float) -> float:
    """Return a filter's number of poles, given the free parameter that `logit_of_poles` returns for it."""
    return 1 + (MOST_POLES - 1) / (1 + math.exp(-logit))


def g_of_eta(eta: Sequence[float]) -> float:
    """Return g = h^α f (h: sampling period) of an order, from its free parameters `eta` in the fits."""
    return -(2 ** eta[0]) / (1 + math.exp(-eta[1]))
