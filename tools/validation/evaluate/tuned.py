"""The online filters with the Q and R that the live fit hands to them: `estimator.tuning = "live"`.

A fit of what has come so far is made whenever the record has grown by 30 %. Where there is an order,
and s2 and R are known well enough, they take the place of the filters' Q and R, and the filters go on with
all that they remember. Early fits must not do so: an s2 of a few hundred samples may be off by a factor of
ten, and a filter that has believed it for a while does not come back.
"""

import numpy as np
from fltea.records.fit import Interval
from fltea.settings.live import TUNED_WITHIN
from fltea.spectrum.periodogram import Periodogram
from numpy.typing import NDArray

from tools.validation.evaluate.fits import live_spectra, published
from tools.validation.evaluate.online import BLOCK, Tuning

Array = NDArray[np.float64]

FIRST = 600
"""Samples before the first fit."""
GROWTH = 1.3
"""Of the record, between fits."""


def tunings(y: Array, h: float, last: int) -> list[Tuning]:
    """What the live fits of y (n, seeds), before its sample `last`, hand over; h in s."""
    points = fit_points(FIRST, last)
    return [
        Tuning(n, *np.transpose([handed_over(one) for one in lanes]))
        for n, lanes in zip(points, live_spectra(y, h, points), strict=True)
    ]


def handed_over(p: Periodogram) -> tuple[float, float]:
    """The s2 and R of the fit of one series, or NaN and NaN."""
    found = published(p)
    if found.s2.value is None or found.R.value is None or not (_known(found.s2) and _known(found.R)):
        return np.nan, np.nan
    return found.s2.value, found.R.value


def _known(variance: Interval) -> bool:
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
