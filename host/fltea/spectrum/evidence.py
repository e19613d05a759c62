"""What a verdict on one axis is drawn from."""

import math

import msgspec

from fltea.spectrum.drift import FALSE_ALARM, SlowPower
from fltea.spectrum.lines import Peak
from fltea.spectrum.low_pass import LowPass
from fltea.spectrum.rivals import APART, Contest
from fltea.spectrum.stationarity import Change

LEVEL = 0.05
"""The null test rejects below, of a recording that is looked at once."""
ANYTIME_LEVEL = 1e-5
"""The same of a sensor that is looked at every second for a day: with it at most one white sensor in a
hundred is ever called anything else."""


def more_than_once(level: float) -> float:
    """What 2 log L has to gain more than of one look, where a claim at this level holds for all looks."""
    return -2 * math.log(level / LEVEL)


class Evidence(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What the verdict is drawn from."""

    duration_s: float
    samples: int
    rate_hz: float
    p_all: float
    """null test of all ordinates that the user left in"""
    p_without_peaks: float
    """of these without lines and resonances"""
    p_clean: float
    """of these above what is called drift, and without the low-pass"""
    peaks: tuple[Peak, ...]
    contest: Contest
    """of the clean ordinates"""
    from_hz: float
    to_hz: float
    """the clean ordinates are between"""
    slow: SlowPower
    low_pass: LowPass | None = None
    change: Change | None = None
    """of the noise during the record"""
    decides_s: float | None = None
    """length of a record that tells the fractional model from relaxations, where this one does not"""
    level: float = LEVEL
    """at which the null test rejects"""

    @property
    def drifts(self) -> bool:
        """Whether there is more below the lowest frequency than the model explains."""
        return self.slow.is_drift(FALSE_ALARM * self.level / LEVEL)

    @property
    def more(self) -> float:
        """`more_than_once` at its level."""
        return more_than_once(self.level)

    @property
    def apart(self) -> float:
        """In 2 log L, from which on two models are told apart."""
        return APART + self.more
