"""When a fit is due, counted in samples, so that nothing depends on how they came (pure)."""

import math

from fltea.settings.config import Config

CURVES_S = 10.0
"""Curves are drawn no more often: they are most of a record's bytes."""

GROWTH = 50
"""At full speed the record grows by one part in so many from fit to fit: an hour has some 245 of them."""

DEVICES_A_SECOND = 20
"""Devices of three axes whose fits, once a second, take a fifth of a core."""


def period_s(config: Config, devices: int) -> float:
    """Seconds of samples between fits that come in time: longer by default where there are many devices."""
    given = config.live.period_s
    return max(1.0, devices / DEVICES_A_SECOND) if given is None else given


class FitTimes:
    """The numbers of the samples of an epoch, counted from 1, with which fits are due.

    period: in samples, at least one. grows: wait also until the record has grown by 1/`GROWTH`. curves: the
    fewest samples from curves to curves.
    """

    def __init__(self, period: int, curves: int, *, grows: bool) -> None:
        self._period, self._curves, self._grows = period, curves, grows
        self.begin()

    def begin(self) -> None:
        """An epoch begins."""
        self.due = self._period
        self._drawn: int | None = None

    def done(self, number: int, samples: int) -> bool:
        """Take note of the fit after sample `number`, of so many samples; whether it is to have curves."""
        step = math.ceil(samples / GROWTH) if self._grows else 1
        self.due = math.ceil((number + step) / self._period) * self._period
        if self._drawn is not None and number - self._drawn < self._curves:
            return False
        self._drawn = number
        return True
