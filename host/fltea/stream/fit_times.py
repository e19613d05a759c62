"""Decide when refits begin and take effect, counted in samples, so that replays give the same results.

A few more samples hardly change the fit of a long record, so the time between refits grows with the record.
"""

import math
from typing import NamedTuple

from fltea.settings.config import Config
from fltea.stream.fit_worker import FitWorker

DEVICES_A_SECOND = 12
"""Largest number of three-axis devices that are refitted once a second each: the model search for a short
record takes 25 ms per device.
"""
GOLDEN = (math.sqrt(5) - 1) / 2
"""Golden ratio. The fractional parts of its multiples are spread evenly over 0 to 1, for any number of
devices.
"""
LONGEST_PERIOD_S = 3600.0
SEARCH_GROWTH, REFIT_GROWTH = 10, 100
"""Growth of the record between two model searches (1/`SEARCH_GROWTH`) and two refits (1/`REFIT_GROWTH`)."""
LONGEST_S = 60.0
"""Longest time between two refits while an output shows them [s]."""
CURVES_S, CURVES_PERIODS = 10.0, 4
"""Shortest time between two published fits with curves: in seconds (CURVES_S), and in the shortest times
between refits (CURVES_PERIODS). Curves are most of a record's bytes, and a third of the work with many
devices.
"""
SEARCH_LAG = 50
"""A model search takes effect when the epoch has grown by 1/`SEARCH_LAG` since the search began. Samples are
processed in the meantime, also when a file is read at full speed or many devices began together.
"""


def period_s(config: Config, fit_worker: FitWorker) -> float:
    """Return the shortest time between two refits [s], by the samples' clock.

    It is longer with many devices.
    """
    given = config.live.period_s
    usual_s = max(1.0, fit_worker.devices / DEVICES_A_SECOND) if given is None else given
    return (
        usual_s
        if fit_worker.slower == 1
        else min(usual_s * fit_worker.slower, max(usual_s, LONGEST_PERIOD_S))
    )


def turn(fit_worker: FitWorker, number: int, period: int) -> int:
    """Return the time within a period at which device `number` does its periodic work.

    Many devices begin together. If they also did this work at the same time, all device streams would wait
    for each other. `number`: index of the device. `period`: length of the period, in the unit of the result:
    samples or ns.
    """
    return int(number * GOLDEN % 1 * period) if fit_worker.devices > DEVICES_A_SECOND else 0


class Refit(NamedTuple):
    """Purpose of a refit, and when it takes effect.

    `settles`: the estimates use the refit, until the next refit with `settles`. `fresh`: the noise model is
    searched for again. `curves`: the record of the refit holds curves. `counts`: number of the sample at
    which the refit takes effect.
    """

    settles: bool
    fresh: bool
    curves: bool
    counts: int


class RefitTimes:
    """Gives the numbers of an epoch's samples, counted from 1, at which refits begin.

    These numbers are multiples of the period, in samples. A refit takes effect before the next multiple. Only
    a model search may take longer; it delays the refits that no estimate uses. `grows`: the time between
    model searches grows with the record; otherwise every refit is a model search. `every`: refits that no
    estimate uses are made as well, for outputs that show them. The refits that estimates use are the same
    with and without `every`.
    """

    def __init__(self, rate_hz: float, *, grows: bool, every: bool) -> None:
        self._rate_hz, self._grows, self._every = rate_hz, grows, every
        self.begin(1)

    def begin(self, period: int) -> None:
        """Begin an epoch. `period`: number of samples between two refits."""
        self.check = self.due = self._search = period
        self._drawn: int | None = None

    def at(
        self, number: int, samples: int, period: int, *, noticed: bool, busy: bool = False
    ) -> Refit | None:
        """Return the refit that begins with sample `number`, which is at least `check`; None if none begins.

        `samples`: number of samples of the whole record. `period`: number of samples between two refits from
        now on. `noticed`: the data have changed, so a refit is wanted now. `busy`: the last refit has not
        taken effect yet.
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
        step = min(math.ceil(samples / REFIT_GROWTH), round(LONGEST_S * self._rate_hz)) if self._grows else 1
        self.due = min(self._search, self._next(number, step, period)) if self._every else self._search
        drawn = self._drawn
        if not self._every:  # no output shows the refits between model searches
            self.check = self._search
        apart = max(CURVES_S * self._rate_hz, CURVES_PERIODS * period)
        curves = self._every and settles and (drawn is None or number - drawn >= apart)
        if curves:
            self._drawn = number
        counts = number + lag if settles else min(number + lag, self.check)
        return Refit(settles, settles or noticed, curves, counts)

    @staticmethod
    def _next(number: int, step: int, period: int) -> int:
        return math.ceil((number + step) / period) * period
