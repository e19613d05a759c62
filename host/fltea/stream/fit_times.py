"""Decide when refits begin and when they take effect.

Beginning and effect of a refit are counted in samples, so that replays give the same results.

A few more samples hardly change the fit of a long record, so the time between refits grows with the length of
the record.
"""

import math
from typing import NamedTuple

from fltea.settings.config import Config
from fltea.stream.fit_worker import FitWorker

DEVICES_A_SECOND = 12
"""Up to this number of devices with three axes, each device is refitted once a second. The model search for a
short record takes 25 ms per device.
"""
GOLDEN = (math.sqrt(5) - 1) / 2
"""Inverse of the golden ratio. The fractional parts of its multiples are spread evenly over 0 to 1, however
many there are. The one of multiple k says at which proportion of a period device k does its work (`turn`).
"""
LONGEST_PERIOD_S = 3600.0
SEARCH_GROWTH, REFIT_GROWTH = 10, 100
"""A model search begins when the record has grown by a tenth (1/`SEARCH_GROWTH`) since the last search. Any
other refit begins when it has grown by a hundredth (1/`REFIT_GROWTH`) since the last refit.
"""
LONGEST_S = 60.0
"""Longest time between two refits if an output shows the fits [s]."""
CURVES_S, CURVES_PERIODS = 10.0, 4
"""The time between two published fits with curves is at least CURVES_S seconds, and at least CURVES_PERIODS
times the shortest time between refits. Curves are most of the bytes of the record `fit`, and a third of the
work if there are many devices.
"""
SEARCH_LAG = 50
"""A model search takes effect when the epoch has grown by 1/`SEARCH_LAG` of its length since the search
began. So there is time for the search while samples are processed, even when a file is read at full speed or
many devices began together.
"""


def period_s(config: Config, fit_worker: FitWorker) -> float:
    """Return the shortest time between two refits [s], by the samples' clock.

    The time is longer if the program has many devices, or if the processor does not keep up.
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

    Many devices begin together when a program starts. If they also did their periodic work at the same time,
    all device streams would wait for each other. With few devices the result is 0. `number`: index of the
    device. `period`: length of the period, in the unit of the result: samples or ns.
    """
    return int(number * GOLDEN % 1 * period) if fit_worker.devices > DEVICES_A_SECOND else 0


class Refit(NamedTuple):
    """Purpose of a refit, and when it takes effect.

    `settles`: whether the estimates use the result of this refit. They use it until the next refit for which
    `settles` is True. `fresh`: whether the noise model is searched for again. `curves`: whether the refit's
    record contains spectrum and Allan deviation. `counts`: number of the sample at which the refit takes
    effect.
    """

    settles: bool
    fresh: bool
    curves: bool
    counts: int


class RefitTimes:
    """Decides at which samples of an epoch refits begin. The samples are numbered from 1.

    A refit may begin once in each period (a number of samples). There are two kinds. The estimates use the
    regular model searches; a search may take several periods. The other refits are made only for outputs that
    show fits. Such a refit takes effect before the next period, and none begins during a search. `grows`:
    whether the time between model searches grows with the record; if not, every refit is a regular model
    search. `every`: whether the other refits are made. The regular searches do not depend on it.
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
        """Return the refit that begins with sample number `number`; None if no refit begins.

        Call this only if `number` is at least `check`, the number at which the next refit may begin.
        `samples`: number of samples of the whole record. `period`: number of samples between two refits from
        now on. `noticed`: whether a step or a change of the noise was noticed, so that a refit is wanted now.
        `busy`: whether the last refit has not taken effect yet, so that none can begin.
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
