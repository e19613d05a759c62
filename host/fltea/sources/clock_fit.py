"""Fit a device's clock to the host's clock.

A straight line over the device's time is fitted to the delays with which samples arrive.

The delay between sampling and arrival is never negative, but for some samples it is much larger than for
other samples. So of each second or so, a caller passes only the arrival with the smallest delay. The line is
fitted by least squares in host/native/clock_fit.hpp, which live samples and recordings use too
(host/native/timebase.hpp).
"""

from collections.abc import Sequence
from typing import NamedTuple

from fltea import _native


class ClockFit(NamedTuple):
    """The line that is fitted to the delay over the device's time.

    At the device's time `device`, the line has the value `delay`.

    `device` and `delay` are the means of the arrivals' device times and delays. The caller chooses the unit
    of the device's time, such as seconds or numbers of samples.
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
    """Return the clock fit of arrivals, given by their times on the device's clock and by their delays.

    Raises:
        ValueError: there are fewer than two arrivals, or not as many delays as times.
    """
    return ClockFit(*_native.fit_clock(device, delay))
