"""Fit a device's clock to the host's: the delay of the earliest arrivals as a straight line over time.

The delay between sampling and arrival is never negative, but often large and in bursts. So each caller keeps
only the earliest arrival of each second or so. The line is fitted by least squares in
host/native/clock_fit.hpp, which live samples and recordings use too (host/native/timebase.hpp).
"""

from collections.abc import Sequence
from typing import NamedTuple

from fltea import _native


class ClockFit(NamedTuple):
    """The fitted line. It has the slope `slope`, and the delay `delay` at the device's time `device`.

    `device` and `delay` are means of the arrivals. The unit of the device's time is the caller's, such as
    seconds or numbers of samples.
    """

    device: float
    delay: float
    slope: float
    """Change of the delay per unit of the device's time."""
    slope_std: float
    """Standard error of the slope, computed from the residuals; infinite if there are only two arrivals."""

    def at(self, device: float) -> float:
        """Return the delay at a time of the device's clock."""
        return self.delay + self.slope * (device - self.device)


def fit_clock(device: Sequence[float], delay: Sequence[float]) -> ClockFit:
    """Return the clock fit of the earliest arrivals: their times by the device's clock, and their delays.

    Raises:
        ValueError: there are fewer than two arrivals, or not as many delays.
    """
    return ClockFit(*_native.fit_clock(device, delay))
