"""Count how often the 95 % intervals of each parameter contain the true value.

The program counts the intervals on many series of each of a few noises.
"""

import math
from typing import NamedTuple

import numpy as np
from fltea.noise import spectra as spectrum
from fltea.spectrum.periodogram import periodogram

from tools.validation.evaluate.cases import POWER, H
from tools.validation.evaluate.fits import QUANTITIES, holds, published
from tools.validation.recursions import FractionalState
from tools.validation.runner import Row

LENGTHS = (3_000, 60_000)
AT_ONCE = 100
"""Number of series in one task."""


class Point(NamedTuple):
    """A noise whose intervals are counted."""

    alpha: float
    f: float
    """Parameter f [s^-α]."""
    white: float
    """R / s2: variance of the white noise divided by that of the state's steps. 0 means that there is no
    white noise.
    """

    @property
    def name(self) -> str:
        """The noise as a text for people."""
        ratio = f"s2/R = {1 / self.white:.3g}" if self.white else "R = 0"
        return f"α = {self.alpha:g}, f = {self.f:g}, {ratio}"


POINTS = (
    Point(0.2, -1.0, 1 / 3),
    Point(0.3, -3.0, 1 / 0.3),
    Point(0.4, -1.0, 0.0),
    Point(0.5, -2.0, 1.0),
    Point(0.6, -0.3, 1 / 0.3),
    Point(0.6, -3.0, 1 / 30),
    Point(0.8, -1.0, 1 / 0.03),
    Point(0.8, -10.0, 1 / 3),
)


def count_coverage(point: Point, samples: int, series: int, seed: int) -> list[Row]:
    """Count, for some series of a noise, the intervals that contain the true value.

    `seed`: each seed gives another set of series.

    In the rows, `held` is the number of published intervals that hold the true value. `undefined` is the
    number of intervals that are not published because the verdict has no order, or because the data do not
    determine the parameter.
    """
    g = spectrum.g_of(point.alpha, point.f, H)
    noise = FractionalState(point.alpha, g, samples)
    s2 = POWER / (noise.power + point.white)
    R = s2 * point.white
    truth = dict(zip(QUANTITIES, (point.alpha, point.f, point.alpha + g, s2, R), strict=True))
    held, undefined = dict.fromkeys(QUANTITIES, 0), dict.fromkeys(QUANTITIES, 0)
    rng = np.random.default_rng([seed, samples, *point.name.encode()])
    for _ in range(series):
        y = math.sqrt(s2) * noise.draw(rng) + math.sqrt(R) * rng.standard_normal(samples)
        found = published(periodogram(y, H))
        for name, value in truth.items():
            none = getattr(found, name).value is None
            undefined[name] += none
            held[name] += none or holds(found, name, value)
    case: Row = {"kind": "coverage", "noise": point.name, "samples": samples, "series": series}
    return [
        case | {"quantity": name, "held": held[name], "undefined": undefined[name]} for name in QUANTITIES
    ]
