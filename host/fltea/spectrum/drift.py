"""Drift: power at frequencies so low that a record contains too few periods for a fit."""

from collections.abc import Callable

import msgspec
import numpy as np

from fltea.noise.distributions import chi2_tail
from fltea.records.arrays import Array
from fltea.spectrum.cubic_drift import Drift
from fltea.spectrum.periodogram import FEWEST, LOWEST, Periodogram

PERIODS = 10.0
"""A wave of the lowest fitted frequency has this many periods in the record. A slower wave, with fewer
periods, cannot be distinguished from drift.
"""
CUBIC_PERIODS = 0.7
"""Among all waves, the one with this many periods in the record is the most similar to a cubic."""
LEAST_OFFSET = 10.0
"""The drift of the offset matters only if its power is at least this many times that of the noise."""
LEAST_RATIO = 2.0
FALSE_ALARM = 1e-4
"""In a record that is tested once, each of the two tests (slow power, drift of the offset) gives a false
alarm with this probability.
"""


class SlowPower(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The power below the fitted frequencies, compared with what the noise model predicts there."""

    below_hz: float
    ratio: float = 1.0
    """The slow power, divided by the slow power that the best model predicts."""
    p: float = 1.0
    """Probability that `ratio` is at least this large, if the model is right at the slow frequencies, too."""
    offset: float = 0.0
    """Power of the cubic that was subtracted from a long record, divided by the density of the noise model at
    the frequency of the wave that is most similar to a cubic (CUBIC_PERIODS); 0 if none was subtracted.
    """
    offset_p: float = 1.0
    """The probability that `offset` is at least this large by chance, if the model is right at such low
    frequencies, too.
    """

    def is_drift(self, false_alarm: float = FALSE_ALARM) -> bool:
        """Return whether there is more slow power than the model explains, and enough of it to matter."""
        of_offset = self.offset >= LEAST_OFFSET and self.offset_p < false_alarm
        return of_offset or (self.ratio >= LEAST_RATIO and self.p < false_alarm)


def drift_hz(duration_s: float, samples: int) -> float:
    """Return the frequency [Hz] below which power counts as drift in a record of `duration_s`.

    In a record of very few samples, only power below the lowest usable ordinate counts as drift.
    """
    enough = samples >= 2 * (FEWEST + PERIODS + 1)
    return (PERIODS if enough else LOWEST) / duration_s


def slow_power(
    below_hz: float, slow: Periodogram | None, model: Callable[[Array], Array], h: float, cubic: Drift | None
) -> SlowPower:
    """Compare the slow power with what the noise model, fitted to higher frequencies, predicts there.

    `slow`: the ordinates below `below_hz`, or None. `model`: function that returns the model's power spectrum
    at λ [rad a sample]. `cubic`: the cubic drift that was subtracted before all ordinates were computed, or
    None. `h`: sampling period [s].
    """
    offset, offset_p = 0.0, 1.0
    if cubic is not None:
        # a cubic was subtracted only if the record is long
        wave = 2 * np.pi * h * CUBIC_PERIODS / PERIODS * below_hz
        offset = cubic.power / float(model(np.array([wave]))[0])
        offset_p = chi2_tail(offset * cubic.amplitudes, cubic.amplitudes)
    if slow is None:
        return SlowPower(below_hz, offset=offset, offset_p=offset_p)
    weight = np.ones_like(slow.lam) if slow.weight is None else slow.weight
    ordinates = float(weight.sum())
    ratio, degrees = float((slow.power / model(slow.lam) * weight).sum()) / ordinates, 2 * ordinates
    return SlowPower(below_hz, ratio, chi2_tail(ratio * degrees, degrees), offset, offset_p)
