"""The online filters with the Q and R that the live fit hands to them: `estimator.tuning = "live"`.

A fit of what has come so far is made whenever the record has grown by 30 %. Where white noise is rejected,
and s2 and R are known well enough, they take the place of the filters' Q and R, and the filters go on with
all that they remember. Early fits must not do so: an s2 of a few hundred samples may be off by a factor of
ten, and a filter that has believed it for a while does not come back.
"""

import numpy as np
from fltea.settings.live import TUNED_WITHIN
from fltea.spectrum.models import FULL
from fltea.spectrum.octaves import Octaves
from fltea.spectrum.periodogram import Binned
from fltea.spectrum.profile import Parameter, fractional_fit
from fltea.spectrum.whittle import fit
from numpy.typing import NDArray

from tools.validation.evaluate.fits import LEVEL, live_data, rejects
from tools.validation.evaluate.online import BLOCK, Tuning

Array = NDArray[np.float64]

FIRST = 600
"""Samples before the first fit."""
GROWTH = 1.3
"""Of the record, between fits."""


def tunings(y: Array, h: float, last: int) -> list[Tuning]:
    """What the live fits of y (n, seeds), before its sample `last`, hand over; h in s."""
    octaves, at, found = Octaves(y.shape[1]), 0, []
    for n in fit_points(FIRST, last):
        octaves.add(y[at:n])
        at = n
        found.append(
            Tuning(n, *np.transpose([handed_over(one, h) for one in live_data(octaves, y.shape[1], h)]))
        )
    return found


def handed_over(data: Binned, h: float) -> tuple[float, float]:
    """The s2 and R of the fit of one series, or NaN and NaN."""
    if not rejects(data, LEVEL)[0]:
        return np.nan, np.nan
    fitted = fractional_fit(data, fit(data, FULL), h)
    if not (_known(fitted.s2) and _known(fitted.R)):
        return np.nan, np.nan
    return fitted.s2.value, fitted.R.value


def _known(variance: Parameter) -> bool:
    return (
        variance.low is not None
        and variance.high is not None
        and variance.high <= TUNED_WITHIN * variance.low
    )


def fit_points(first: int, last: int) -> list[int]:
    """Lengths after which there is a fit: multiples of BLOCK, `last` not among them."""
    points, n = [], float(first)
    while n < last:
        points.append(round(n / BLOCK) * BLOCK)
        n = max(n * GROWTH, n + BLOCK)
    return [n for n in dict.fromkeys(points) if n < last]
