"""The supervisor of one lane: declares it lost or not to be trusted, and says why (pure).

The filters know nothing of it. Rules, judged after each sample:

- *runaway*: an estimate that is not finite, or an order beyond ±`LOST_ORDER`. The lane is invalid with
  this sample and begins anew with the next: initial values, empty memory. Only without a guard can this
  happen.
- *bound*: the guard had to hold the state in more than `BOUND_SHARE` of the last `BOUND_SAMPLES` samples.
  Then R does not fit the data (the sensor moves, an offset was left, R was given wrong). The lane is invalid
  for as long as that lasts, and begins anew when the share is below half of it again.
"""

import math
from collections import deque
from typing import NamedTuple

from fltea.estimator.lanes import BOUND_SAMPLES, BOUND_SHARE, LOST_ORDER, Reason

__all__ = [
    "BOUND_SAMPLES",
    "BOUND_SHARE",
    "GOOD",
    "LOST_ORDER",
    "Reason",
    "Supervisor",
    "Verdict",
    "ran_away",
]


class Verdict(NamedTuple):
    """What the supervisor says of a lane after a sample.

    valid: the estimate may be published. restart: the lane has to begin anew with the next sample.
    news: why the lane has just become invalid, else None.
    """

    valid: bool
    restart: bool
    news: Reason | None


GOOD = Verdict(True, False, None)


def ran_away(alpha: float, f: float, state_dps: float) -> bool:
    """Whether an estimate is not finite, or its order beyond all sense."""
    return not (math.isfinite(f) and math.isfinite(state_dps) and abs(alpha) <= LOST_ORDER)


class Supervisor:
    """Watches one lane."""

    def __init__(self) -> None:
        self._bounds: deque[bool] = deque(maxlen=BOUND_SAMPLES)
        self._bounded = 0
        self._distrusted = False

    def judge(self, alpha: float, f: float, state_dps: float, *, state_bound: bool) -> Verdict:
        """Judge one sample's estimates; state_bound says whether the guard held the state in this sample."""
        if ran_away(alpha, f, state_dps):
            return Verdict(False, True, "runaway")
        if len(self._bounds) == BOUND_SAMPLES:
            self._bounded -= self._bounds[0]
        self._bounds.append(state_bound)
        self._bounded += state_bound
        share = self._bounded / BOUND_SAMPLES
        if not self._distrusted and share <= BOUND_SHARE:
            return GOOD
        news: Reason | None = None if self._distrusted else "bound"
        self._distrusted = share > BOUND_SHARE / 2
        return Verdict(False, not self._distrusted, news)
