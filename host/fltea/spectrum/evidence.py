"""The figures on which the verdict on one axis is based."""

import math
from typing import NamedTuple

import numpy as np

from fltea.spectrum.candidate_models import CandidateModels, FittedModel
from fltea.spectrum.drift import FALSE_ALARM, SlowPower
from fltea.spectrum.median_filter import MedianFilter
from fltea.spectrum.order_odds import odds_of
from fltea.spectrum.periodogram import AT_ONCE, Periodogram
from fltea.spectrum.reading import Reading
from fltea.spectrum.residuals import farthest
from fltea.spectrum.spectral_lines import Peak
from fltea.spectrum.stationarity import Change

LEVEL = 0.05
"""Significance level for a recording, which is tested once: the null test rejects white noise if its p-value
is below this level.
"""
ANYTIME_LEVEL = 1e-5
"""Significance level for a live sensor, which is tested every second. With it, at most one sensor with white
noise in a hundred is reported as anything else within a day.
"""
APART = 6.0
"""Two models count as different if their 2 log L (twice the log likelihood) differs by at least this."""


# Why more than 12 attributes: each is one finding on which the verdict is based.
class Evidence(NamedTuple):
    """All figures that the verdict on one axis rests on."""

    duration_s: float
    samples: int
    rate_hz: float
    p_all: float
    """The p-value of the null test on all ordinates that the user did not exclude."""
    p_without_peaks: float
    """The p-value of the null test on the ordinates outside spectral lines and resonances."""
    p_clean: float
    """The p-value of the null test on the clean ordinates. These lie outside peaks, and above the frequencies
    of the drift.
    """
    peaks: tuple[Peak, ...]
    candidates: CandidateModels
    """The candidate models, fitted to the clean ordinates: those outside peaks, and above the drift's
    frequencies.
    """
    reading: Reading
    """What the best model without an order says about the noise. Parts that only imitate something else, such
    as the power that leaks from a peak to its sides, do not count.
    """
    from_hz: float
    to_hz: float
    """`from_hz` and `to_hz` are the ends [Hz] of the band of the clean ordinates."""
    slow: SlowPower
    change: Change | None
    clean: Periodogram
    """The clean ordinates."""
    level: float = LEVEL
    """The level at which the null test rejects white noise."""
    median: MedianFilter | None = None
    """The median filter that was detected in the samples; None if there is none."""

    def residual_ks(self, model: FittedModel) -> float:
        """Return the Kolmogorov–Smirnov statistic of the residuals of a model (`residuals.farthest`)."""
        p = self.clean
        ratio = np.empty_like(p.lam)
        # the ratio of periodogram to model is computed in pieces, which takes less memory
        for begin in range(0, len(ratio), AT_ONCE):
            part = slice(begin, begin + AT_ONCE)
            ratio[part] = p.power[part] / model.spectrum(p.lam[part], p.h)
        return farthest(ratio, p.weight)

    @property
    def drifts(self) -> bool:
        """Whether there is more power below the lowest fitted frequency than the models predict."""
        return self.slow.is_drift(FALSE_ALARM * self.level / LEVEL)

    @property
    def odds(self) -> float | None:
        """The odds that noise which is not white has an order. None if no fitted model has an order."""
        return odds_of(self.candidates)

    @property
    def apart(self) -> float:
        """Smallest difference in 2 log L with which two models count as different at this refit."""
        return apart(self.level)


def apart(level: float) -> float:
    """Return the smallest difference in 2 log L with which two models count as different.

    `level`: significance level of a single refit. The smaller the level, the larger the difference. A live
    sensor has a smaller level than a recording, since it is refitted often. So wrong claims about it are no
    more frequent than about a recording.
    """
    return APART - 2 * math.log(level / LEVEL)
