"""Decide when refits begin and take effect, counted in samples, so that replays give the same results.

A record that has grown by little says hardly anything new, so the time between refits follows its growth.
"""

import math
from typing import NamedTuple

from fltea.settings.config import Config
from fltea.stream.fit_worker import FitWorker

DEVICES_A_SECOND = 12
"""Number of three-axis devices that can all be refitted once a second: the model search of a young record
takes 25 ms per device."""
GOLDEN = (math.sqrt(5) - 1) / 2
"""Golden ratio. The fractional parts of its multiples are well spaced, for any number of devices."""
LONGEST_PERIOD_S = 3600.0
SEARCH_GROWTH, LOOK_GROWTH = 10, 100
"""A model search is made when the record has grown by 1/`SEARCH_GROWTH`, a refit at 1/`LOOK_GROWTH`."""
LONGEST_S = 60.0
"""Longest time between two refits while an output shows them [s]."""
CURVES_S, CURVES_PERIODS = 10.0, 4
"""Shortest time between two fits with curves, in seconds and in periods: curves are most of a record's bytes,
and a third of the work with many devices."""
SEARCH_LAG = 50
"""A model search takes effect only when the epoch has grown by 1/`SEARCH_LAG`. Samples are taken meanwhile,
also when a file is read at full speed, or when many devices began together."""


def period_s(config: Config, fit_worker: FitWorker) -> float:
    """Return the shortest time between two refits, in seconds of samples; many devices lengthen it."""
    given = config.live.period_s
    usual_s = max(1.0, fit_worker.devices / DEVICES_A_SECOND) if given is None else given
    return (
        usual_s
        if fit_worker.slower == 1
        else min(usual_s * fit_worker.slower, max(usual_s, LONGEST_PERIOD_S))
    )


def turn(fit_worker: FitWorker, number: int, period: int) -> int:
    """Return the offset within a period at which device `number` does what every device does once a period.

    Many devices begin together; without different offsets all device streams would wait at the same time.
    `number`: index of the device. `period`: in samples, or in ns.
    """
    return int(number * GOLDEN % 1 * period) if fit_worker.devices > DEVICES_A_SECOND else 0


class Look(NamedTuple):
    """What a refit is for.

    `settles`: estimates use it until the next refit that settles. `fresh`: the model is searched for again.
    `curves`: the record holds the curves. `counts`: number of the sample at which the refit takes effect.
    """

    settles: bool
    fresh: bool
    curves: bool
    counts: int


class LookTimes:
    """Gives the numbers of an epoch's samples, counted from 1, at which refits begin.

    These numbers are multiples of the period, in samples. A refit takes effect before the next multiple; only
    a model search may take longer, and delays refits that settle nothing.
    `grows`: model searches follow the record's growth; otherwise every refit is a model search.
    `every`: refits that settle nothing are made as well, for outputs that show them. The refits that settle
    do not depend on that.
    """

    def __init__(self, rate_hz: float, *, grows: bool, every: bool) -> None:
        self._rate_hz, self._grows, self._every = rate_hz, grows, every
        self.begin(1)

    def begin(self, period: int) -> None:
        """Begin an epoch."""
        self.check = self.due = self._search = period
        self._drawn: int | None = None

    def at(self, number: int, samples: int, period: int, *, noticed: bool, busy: bool = False) -> Look | None:
        """Return the refit that begins with sample `number`, which is `check` or later; None if none begins.

        `samples`: number of samples of the whole record. `period`: the period from now on, in samples.
        `noticed`: a change of the data calls for a refit. `busy`: the last refit has not taken effect yet.
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
        if not self._every:  # no output shows refits in between
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
