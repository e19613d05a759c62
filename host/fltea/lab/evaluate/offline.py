"""The Whittle fit on the same series: what can be known of them, not sample by sample but afterwards."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fltea.spectrum.likelihood_ratio import critical_values, null_fits
from fltea.spectrum.models import FULL, held, parameters
from fltea.spectrum.null_constants import PROBABILITIES
from fltea.spectrum.periodogram import Binned, binned, periodogram
from fltea.spectrum.profile import CRITICAL
from fltea.spectrum.whittle import Fit, Model, fit

Array = NDArray[np.float64]


class WhittleReading(NamedTuple):
    """Of all series, (seeds,) each."""

    alpha: Array
    f: Array
    alpha_covered: NDArray[np.bool_] | None
    """the true order is in the 95 % interval of the profile likelihood; None without a truth"""
    f_covered: NDArray[np.bool_] | None
    rejected: NDArray[np.bool_]
    """the null test rejects white noise at 5 %"""


def whittle_reading(y: Array, h: float, alpha: float | None, f: float | None) -> WhittleReading:
    """Fit y (n, seeds), h in s, whose true α and f are given. See `covered` for the intervals."""
    data = binned(periodogram(y.T, h))
    found = fit(data, FULL)
    p = parameters(found.theta)
    alpha_covered = f_covered = None
    if alpha is not None and f is not None:
        alpha_covered = covered(data, found, held("alpha", alpha), found.theta[:, 1:])
        f_covered = covered(data, found, held("f", f, h), found.theta[:, [0, 2]])
    return WhittleReading(p.alpha, p.g * h**-p.alpha, alpha_covered, f_covered, _rejected(data))


def fitted_variances(y: Array, h: float, Q: float, power: float) -> tuple[Array, Array]:
    """Q = s2 and R of the fits of y (n, seeds), (seeds,) each.

    Where the null test does not reject white noise they are the given Q and the variance `power` of y. None
    is below a thousandth of `power`: the fit may say 0, and the filters need R > 0.
    """
    data = binned(periodogram(y.T, h))
    found = fit(data, FULL)
    weight = parameters(found.theta).weight
    least = power / 1000
    white = ~_rejected(data)
    s2 = np.where(white, Q, np.maximum(weight * found.scale, least))
    R = np.where(white, power, np.maximum((1 - weight) * found.scale, least))
    return s2, R


def _rejected(data: Binned) -> NDArray[np.bool_]:
    critical = critical_values(data.ordinates)[PROBABILITIES.index(0.05)]
    return np.asarray(null_fits(data).likelihood_ratio > critical)


def covered(data: Binned, found: Fit, model: Model, start: Array) -> NDArray[np.bool_]:
    """Tell for each series whether the value that `model` holds is in the 95 % interval.

    It is if the best fit that has the value is hardly worse than the best of all, `found`: the ends of the
    interval, a hundred times the work, are not needed for that. start: (series, free), to begin at too.
    """
    nll = fit(data, model, start[:, np.newaxis]).nll
    return np.asarray(2 * (nll - found.nll) <= CRITICAL)
