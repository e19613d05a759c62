"""When a fit is due, counted in samples, so that nothing depends on how they came (pure)."""

import math
from typing import NamedTuple

from fltea.settings.config import Config

CURVES_S = 10.0
"""Curves are drawn no more often: they are most of a record's bytes."""

GROWTH = 10
"""From one fit that settles to the next the record grows by one part in so many: an hour has some 70, which
takes a replay 0.7 s; 50 would take 2.4 s."""

DEVICES_A_SECOND = 12
"""Devices of three axes whose fits, once a second, take a fifth of a core: 1.7 % each, curves included."""


def period_s(config: Config, devices: int) -> float:
    """Seconds of samples between fits that come in time: longer by default where there are many devices."""
    given = config.live.period_s
    return max(1.0, devices / DEVICES_A_SECOND) if given is None else given


class Done(NamedTuple):
    """What a fit is for. settles: estimates go by it until the next one that does; curves: it has them."""

    settles: bool
    curves: bool


class FitTimes:
    """The numbers of the samples of an epoch, counted from 1, with which fits are due.

    period: in samples, at least one. grows: a fit settles only once the record has grown by 1/`GROWTH`.
    every: those that settle nothing are due, too. So estimates do not depend on `every`, which is for who
    looks on. curves: the fewest samples from curves to curves; where nobody looks on, not before the epoch is
    twice as long.
    """

    def __init__(self, period: int, curves: int, *, grows: bool, every: bool) -> None:
        self._period, self._curves, self._grows, self._every = period, curves, grows, every
        self.begin()

    def begin(self) -> None:
        """An epoch begins."""
        self.due = self._settles = self._period
        self._drawn: int | None = None

    def done(self, number: int, samples: int) -> Done:
        """Take note of the fit after sample `number`, of so many samples."""
        settles = number >= self._settles
        if settles:
            self._settles = self._next(number, math.ceil(samples / GROWTH) if self._grows else 1)
        self.due = self._next(number, 1) if self._every else self._settles
        drawn = self._drawn
        curves = drawn is None or number - drawn >= (
            self._curves if self._every else max(self._curves, drawn)
        )
        if curves:
            self._drawn = number
        return Done(settles, curves)

    def _next(self, number: int, step: int) -> int:
        return math.ceil((number + step) / self._period) * self._period
