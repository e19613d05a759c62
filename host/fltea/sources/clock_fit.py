"""Fit a device's clock to the host's clock.

A straight line is fitted to the delays with which samples arrive, as a function of the device's time.

The delay between sampling and arrival is never negative, but for some samples it is much larger than for
other samples. So of each second or so, a caller passes only the arrival with the smallest delay. The code of
the fit is host/native/clock_fit.hpp. host/native/timebase.hpp uses it too, for live samples and recordings.
"""

from collections.abc import Sequence
from typing import NamedTuple

from fltea import _native


class ClockFit(NamedTuple):
    """The straight line that is fitted to the delays of arrivals, as a function of the device's time.

    `device`, `delay`: one point of the line, which is the mean of the arrivals' device times and the mean of
    their delays. The caller chooses the unit of the device's time, such as seconds or numbers of samples.
    """

    device: float
    delay: float
    slope: float
    """Slope of the line: change of the arrivals' delay per unit of the device's time."""
    slope_std: float
    """Standard error of the slope, computed from the residuals; infinite if there are only two arrivals."""

    def at(self, device: float) -> float:
        """Return the delay at a time of the device's clock."""
        return self.delay + self.slope * (device - self.device)


def fit_clock(device: Sequence[float], delay: Sequence[float]) -> ClockFit:
    """Return the clock fit of arrivals, given by their times on the device's clock and by their delays.

    Raises:
        ValueError: there are fewer than two arrivals, or not as many delays as times.
    """
    return ClockFit(*_native.fit_clock(device, delay))
