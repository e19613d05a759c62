"""When a look begins and from when on it counts, in samples: nothing depends on how fast anybody is (pure).

A record that is a little longer says hardly anything new, so looks follow its growth.
"""

import math
from typing import NamedTuple

from fltea.settings.config import Config
from fltea.stream.fit_worker import FitWorker

DEVICES_A_SECOND = 12
"""Devices of three axes that may all look once a second: while they are young a search takes 25 ms each."""
GOLDEN = (math.sqrt(5) - 1) / 2
"""Multiples of it, less whole numbers, are far apart, however many there are."""
LONGEST_PERIOD_S = 3600.0
SEARCH_GROWTH, LOOK_GROWTH = 10, 100
"""The record grows by one part in so many from search to search, and from look to look."""
LONGEST_S = 60.0
"""From look to look, for who watches."""
CURVES_S, CURVES_PERIODS = 10.0, 4
"""Curves are drawn no more often: they are most of a record's bytes, and a third of the work for many."""
SEARCH_LAG = 50
"""A search counts no sooner than when the epoch has grown by one part in so many: the walk goes on meanwhile,
also at full speed and of many devices that began together."""


def period_s(config: Config, fit_worker: FitWorker) -> float:
    """Seconds of samples from look to look at least: more by default where there are many devices."""
    given = config.live.period_s
    usual_s = max(1.0, fit_worker.devices / DEVICES_A_SECOND) if given is None else given
    return (
        usual_s
        if fit_worker.slower == 1
        else min(usual_s * fit_worker.slower, max(usual_s, LONGEST_PERIOD_S))
    )


def turn(fit_worker: FitWorker, number: int, period: int) -> int:
    """Return by how much of a period one of many devices does later what all do once in it: they have turns.

    number: which of them it is. period: in samples, or in ns. Many begin together, and all walks would wait.
    """
    return int(number * GOLDEN % 1 * period) if fit_worker.devices > DEVICES_A_SECOND else 0


class Look(NamedTuple):
    """What a look is for.

    settles: estimates go by it until the next one that does. fresh: everything is searched for again.
    counts: the number of the sample from which on it does.
    """

    settles: bool
    fresh: bool
    curves: bool
    counts: int


class LookTimes:
    """The numbers of the samples of an epoch, counted from 1, with which looks begin.

    These are multiples of the period, in samples. A look counts before the next multiple; only a search may
    hold up looks that settle nothing. grows: searches follow the record's growth; else every look is one.
    every: there are others, for who looks on; what settles does not depend on them.
    """

    def __init__(self, rate_hz: float, *, grows: bool, every: bool) -> None:
        self._rate_hz, self._grows, self._every = rate_hz, grows, every
        self.begin(1)

    def begin(self, period: int) -> None:
        """Begin an epoch."""
        self.check = self.due = self._search = period
        self._drawn: int | None = None

    def at(self, number: int, samples: int, period: int, *, noticed: bool, busy: bool = False) -> Look | None:
        """Return the look that begins with sample `number`, which is `check` or later.

        samples: of the whole record. period: from now on. noticed: something has happened that is to be seen.
        busy: the last look does not count yet.
        """
        self.check = (number // period + 1) * period
        settles = number >= self._search
        if busy or not (settles or (self._every and (noticed or number >= self.due))):
            return None
        lag = max(1, period // 2)
        if settles:
            step = math.ceil(samples / SEARCH_GROWTH) if self._grows else 1
            self._search = self._next(number, step, period)
            lag = max(lag, number // SEARCH_LAG) if self._grows else lag
        step = min(math.ceil(samples / LOOK_GROWTH), round(LONGEST_S * self._rate_hz)) if self._grows else 1
        self.due = min(self._search, self._next(number, step, period)) if self._every else self._search
        drawn = self._drawn
        if not self._every:  # nobody wants news in between
            self.check = self._search
        apart = max(CURVES_S * self._rate_hz, CURVES_PERIODS * period)
        curves = self._every and settles and (drawn is None or number - drawn >= apart)
        if curves:
            self._drawn = number
        counts = number + lag if settles else min(number + lag, self.check)
        return Look(settles, settles or noticed, curves, counts)

    @staticmethod
    def _next(number: int, step: int, period: int) -> int:
        return math.ceil((number + step) / period) * period
