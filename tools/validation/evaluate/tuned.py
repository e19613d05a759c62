"""The online filters with the Q and R of the live fit: `estimator.tuning = "live"`.

As in the daemon, all samples so far are fitted again whenever the record has grown by 30 %. If the fit finds
an order, the fit's variances (s2 of the state's steps, R of the white noise) replace the filters' Q and R,
and the filters continue with the fit's α and f.
"""

import numpy as np
from fltea.records.arrays import Array
from fltea.records.fit import AxisFit
from fltea.spectrum.periodogram import Periodogram
from fltea.stream.tuning import HandedOver, handed_over

from tools.validation.evaluate.fits import live_spectra, published
from tools.validation.evaluate.online import BLOCK, Tuning

FIRST = 600
"""Number of samples before the first fit."""
GROWTH = 1.3
"""Factor by which the record grows from one fit to the next."""


def tunings(y: Array, h: float, last: int) -> list[Tuning]:
    """Return what the filters get from each live fit of y (n, seeds): Q, R and a filter model.

    Only fits before sample `last` are made.

    `h`: sampling period [s].
    """
    points = fit_points(FIRST, last)
    return [
        _tuning(n, [_handed(one) for one in lanes])
        for n, lanes in zip(points, live_spectra(y, h, points), strict=True)
    ]


def _handed(p: Periodogram) -> HandedOver | None:
    found = published(p)
    figures = found.alpha, found.f, found.F, found.s2, found.R
    return handed_over(AxisFit("fractional", "", "deg/s", None, *figures), None)


def _tuning(samples: int, handed: list[HandedOver | None]) -> Tuning:
    Q, R = np.transpose([(np.nan, np.nan) if one is None else one.variances for one in handed])
    return Tuning(samples, Q, R, [one and one.filter_model for one in handed])


def fit_points(first: int, last: int) -> list[int]:
    """Return the lengths after which a fit is made: multiples of BLOCK below `last`."""
    points, n = [], float(first)
    while n < last:
        points.append(round(n / BLOCK) * BLOCK)
        n = max(n * GROWTH, n + BLOCK)
    return [n for n in dict.fromkeys(points) if n < last]
