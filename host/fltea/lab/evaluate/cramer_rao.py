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
from numpy.typing import NDArray

from fltea.lab.evaluate.frequencies import LAM, mean
from fltea.noise.information import log_slopes

Array = NDArray[np.float64]


class Bound(NamedTuple):
    """Least standard deviations."""

    alpha: float
    f: float
    """in s^-α"""


def fisher(alpha: float, g: float, s2: float, R: float, n: int) -> Array:
    """The information on α, g, log s2 and log R in n samples, (4, 4); without log R, (3, 3), if R = 0."""
    slopes = log_slopes(LAM, alpha, g, s2, R)
    if R == 0:
        slopes = slopes[:3]
    return np.asarray(n / 2 * mean(slopes[:, np.newaxis] * slopes))


def bound(alpha: float, g: float, s2: float, R: float, n: int, h: float) -> Bound:
    """The bound for n samples at a sampling period of h s."""
    covariance = np.linalg.inv(fisher(alpha, g, s2, R, n))[:2, :2]
    # f = h^-α g
    slope = np.array([-math.log(h) * g, 1.0]) * h**-alpha
    return Bound(math.sqrt(covariance[0, 0]), math.sqrt(slope @ covariance @ slope))
