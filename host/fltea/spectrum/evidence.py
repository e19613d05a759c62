"""The figures from which the verdict on one axis is drawn."""

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
"""The null test of a recording, which is tested once, rejects white noise at p-values below this level."""
ANYTIME_LEVEL = 1e-5
"""The level for a sensor that is tested every second for a day: at most one white sensor in a hundred is ever
reported as anything else."""
APART = 6.0
"""Difference in 2 log L from which on two models count as different."""


# Over 12 attributes: each is one finding that the verdict rests on.
class Evidence(NamedTuple):
    """All figures that the verdict on one axis rests on."""

    duration_s: float
    samples: int
    rate_hz: float
    p_all: float
    """The p-value of the null test of all ordinates that the user left in."""
    p_without_peaks: float
    """The p-value of the null test without the ordinates of lines and resonances."""
    p_clean: float
    """The p-value of the null test of the clean ordinates: those without peaks and above the frequencies of
    the drift.
    """
    peaks: tuple[Peak, ...]
    candidates: CandidateModels
    """The candidate models, fitted to the clean ordinates."""
    reading: Reading
    """What the best model without an order says about the noise."""
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
    """The median filter that was detected in the samples; None without one."""

    def residual_ks(self, model: FittedModel) -> float:
        """Return the Kolmogorov–Smirnov distance for the ratio of periodogram to model (`residuals`)."""
        p = self.clean
        ratio = np.empty_like(p.lam)
        for begin in range(0, len(ratio), AT_ONCE):  # computed in pieces, which takes less memory
            part = slice(begin, begin + AT_ONCE)
            ratio[part] = p.power[part] / model.spectrum(p.lam[part], p.h)
        return farthest(ratio, p.weight)

    @property
    def drifts(self) -> bool:
        """Whether there is more power below the lowest frequency than the models explain."""
        return self.slow.is_drift(FALSE_ALARM * self.level / LEVEL)

    @property
    def odds(self) -> float | None:
        """The odds that coloured noise has an order; None if no fitted model has an order."""
        return odds_of(self.candidates)

    @property
    def apart(self) -> float:
        """The difference in 2 log L from which on two models count as different at this refit."""
        return apart(self.level)


def apart(level: float) -> float:
    """Return the difference in 2 log L from which on two models count as different.

    It grows as `level`, the significance level of a single refit, becomes smaller. So a claim holds for all
    refits together.
    """
    return APART - 2 * math.log(level / LEVEL)
