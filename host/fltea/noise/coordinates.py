"""Convert between parameters in physical units and the transformed free parameters of the native fits."""

import math
from collections.abc import Sequence

SMALLEST = 1e-300
"""Replaces a variance of 0, which has no logarithm."""
MOST_POLES = 24.0
LOGIT_END = 16.0


def log(value: float) -> float:
    """Return the logarithm of a variance, a rate or a frequency; 0 is replaced by `SMALLEST`."""
    return math.log(max(value, SMALLEST))


def log_lam(frequency_hz: float, h: float) -> float:
    """Return the logarithm of a frequency in rad per sample; `h`: sampling period [s]."""
    return log(2 * math.pi * frequency_hz * h)


def hz(log_lam: float, h: float) -> float:
    """Return the frequency [Hz] for a logarithm of rad per sample; `h`: sampling period [s]."""
    return math.exp(log_lam) / (2 * math.pi * h)


def logit(share: float) -> float:
    """Return the logit of `share`. A share below the lower bound of the fits gives the logit of the bound."""
    found = math.log(share / (1 - share)) if share > 0 else -LOGIT_END
    return max(found, -LOGIT_END)


def logit_of_poles(poles: float) -> float:
    """Return the transformed parameter for a filter's number of poles."""
    share = min(max((poles - 1) / (MOST_POLES - 1), 1e-7), 1 - 1e-7)
    return math.log(share / (1 - share))


def poles_of_logit(logit: float) -> float:
    """Return a filter's number of poles for the transformed parameter `logit`."""
    return 1 + (MOST_POLES - 1) / (1 + math.exp(-logit))


def g_of_eta(eta: Sequence[float]) -> float:
    """Return g from the transformed parameters of an order."""
    return -(2 ** eta[0]) / (1 + math.exp(-eta[1]))
