"""How well α and f can be known at best: the Cramér–Rao bound of y = x + v (pure).

For long records the Fisher information of Gaussian noise with the spectrum S is (Whittle, *Ark. Mat.* 2,
1953)

    I = n / (4π) ∫ (∂ log S) (∂ log S)ᵀ dλ,    -π < λ < π

here for α, g = h^α f, log s2 and log R. None of them is taken to be known. The bound holds for estimators
without bias: where it is as wide as what is possible, one that returns its start value has less spread.
"""

import math
from typing import NamedTuple

import numpy as np
from fltea.noise.information import log_slopes
from numpy.typing import NDArray

from tools.validation.evaluate.frequencies import LAM, mean

Array = NDArray[np.float64]


class Bound(NamedTuple):
    """Least standard deviations."""

    alpha: float
    f: float
    """in s^-α"""
    F: float
    """g + α"""
    s2: float
    R: float


def fisher(alpha: float, g: float, s2: float, R: float, n: int) -> Array:
    """The information on α, g, log s2 and log R in n samples, (4, 4); without log R, (3, 3), if R = 0."""
    slopes = log_slopes(LAM, alpha, g, s2, R)
    if R == 0:
        slopes = slopes[:3]
    return np.asarray(n / 2 * mean(slopes[:, np.newaxis] * slopes))


def bound(alpha: float, g: float, s2: float, R: float, n: int, h: float) -> Bound:
    """The bound for n samples at a sampling period of h s; that of R is 0 if R is."""
    covariance = np.linalg.inv(fisher(alpha, g, s2, R, n))
    pair = covariance[:2, :2]
    # f = h^-α g
    of_f = np.array([-math.log(h) * g, 1.0]) * h**-alpha
    logs = np.sqrt(np.diag(covariance)[2:])
    return Bound(
        math.sqrt(pair[0, 0]),
        math.sqrt(of_f @ pair @ of_f),
        math.sqrt(pair.sum()),
        s2 * float(logs[0]),
        R * float(logs[1]) if R else 0.0,
    )
