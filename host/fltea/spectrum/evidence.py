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
"""The level for a sensor that is looked at every second for a day: with it at most one white sensor in a
hundred is ever called anything else."""


def more_than_once(level: float) -> float:
    """Return how much more 2 log L has to gain than in one look, if a claim shall hold for all looks."""
    return -2 * math.log(level / LEVEL)


class Evidence(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """All figures that the verdict on one axis rests on."""

    duration_s: float
    samples: int
    rate_hz: float
    p_all: float
    """Null test of all ordinates that the user left in."""
    p_without_peaks: float
    """The p-value of these ordinates without lines and resonances."""
    p_clean: float
    """The p-value of these above what is called drift, and without the low-pass."""
    peaks: tuple[Peak, ...]
    contest: Contest
    """The contest of the models on the clean ordinates."""
    from_hz: float
    to_hz: float
    """The clean ordinates are between."""
    slow: SlowPower
    low_pass: LowPass | None = None
    change: Change | None = None
    """The change of the noise during the record."""
    decides_s: float | None = None
    """Length of a record that tells the fractional model from relaxations, where this one does not."""
    level: float = LEVEL
    """The level at which the null test rejects."""

    @property
    def drifts(self) -> bool:
        """Whether there is more below the lowest frequency than the model explains."""
        return self.slow.is_drift(FALSE_ALARM * self.level / LEVEL)

    @property
    def more(self) -> float:
        """How much more 2 log L has to gain than in one look, at the level of this look."""
        return more_than_once(self.level)

    @property
    def apart(self) -> float:
        """The difference in 2 log L from which on two models count as different."""
        return APART + self.more
