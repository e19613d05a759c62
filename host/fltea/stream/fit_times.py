"""When a fit is due, counted in samples, so that nothing depends on how they came (pure)."""

import math
from dataclasses import dataclass
from typing import NamedTuple

from fltea.settings.config import Config

CURVES_S = 10.0
"""Curves are drawn no more often: they are most of a record's bytes."""

GROWTH = 10
"""From one fit that settles to the next the record grows by one part in so many: an hour has some 70, which
takes a replay 0.7 s; 50 would take 2.4 s."""

DEVICES_A_SECOND = 12
"""Devices of three axes whose fits, once a second, take a fifth of a core: 1.7 % each, curves included."""


LONGEST_PERIOD_S = 3600.0


@dataclass
class FitLoad:
    """What the fits of all devices of a program share; who runs many devices changes it as they come and go.

    devices: how many there are. slower: how many times rarer than usual their fits come, for all alike,
    because the processor does not keep up.
    """

    devices: int = 1
    slower: float = 1.0


def period_s(config: Config, load: FitLoad) -> float:
    """Seconds of samples between fits that come in time: longer by default where there are many devices."""
    given = config.live.period_s
    usual_s = max(1.0, load.devices / DEVICES_A_SECOND) if given is None else given
    return usual_s if load.slower == 1 else min(usual_s * load.slower, max(usual_s, LONGEST_PERIOD_S))


AXIS_S = 0.05
"""From the fit of an axis to that of the next, at most: one with curves takes up to 40 ms."""


class Turns(NamedTuple):
    """When axes are fitted, in samples, so that no two of this program are at the same one if there is room.

    offset: of the device's first fit, behind the period's end. step: from axis to axis; 0: all at once.
    """

    offset: int
    step: int


def turns(period: int, rate_hz: float, axes: int, devices: int, number: int) -> Turns:
    """Turns of the device `number` of `devices`, counted from 0, whose axes are fitted once in `period`."""
    own = period // devices
    step = min(max(1, own // max(1, axes)), round(AXIS_S * rate_hz)) if axes <= period else 0
    return Turns(number * period // devices, step)


class Done(NamedTuple):
    """What a fit is for. settles: estimates go by it until the next one that does; curves: it has them."""

    settles: bool
    curves: bool


class FitTimes:
    """The numbers of the samples of an epoch, counted from 1, with which fits are due.

    period: in samples, at least one. offset: of all fits, behind the multiples of it. grows: a fit settles
    only once the record has grown by 1/`GROWTH`. every: those that settle nothing are due, too. So estimates
    do not depend on `every`, which is for who looks on. curves: the fewest samples from curves to curves;
    where nobody looks on, not before the epoch is twice as long.
    """

    def __init__(self, period: int, curves: int, *, grows: bool, every: bool, offset: int = 0) -> None:
        self._period, self._curves, self._grows, self._every = period, curves, grows, every
        self._offset = offset
        self.begin()

    def begin(self) -> None:
        """Begin an epoch."""
        self.due = self._settles = self._period + self._offset
        self._drawn: int | None = None
        self._latest = 0

    def pace(self, period: int, offset: int, number: int) -> None:
        """Go on with another period from sample `number` on: a fit that comes too soon for it is put off.

        One that is due later than the new period asks stays due then.
        """
        if (period, offset) == (self._period, self._offset):
            return
        self._period, self._offset = period, offset
        if number - self._latest < period // 2:
            self.due = self._next(number, 1)

    def settles(self, number: int) -> bool:
        """Whether a fit after sample `number` settles."""
        return number >= self._settles

    def done(self, number: int, samples: int) -> Done:
        """Take note of the fit after sample `number`, of so many samples."""
        settles = self.settles(number)
        self._latest = number
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
        return math.ceil((number + step - self._offset) / self._period) * self._period + self._offset
