"""How fast an offset drifts, by how likely walks of it make the samples.

The spectrum leaves out what is slower than ten periods of a record. A filter in the time does not. So walks
of the offset, from one that a record of n samples hardly shows to one that it shows at once, are weighted by
their likelihood, and a constant offset as much as all of them together.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from fltea.noise.system import System
from fltea.records.fit import Interval

SHARES = tuple(10.0**k for k in (0.5, 1.5, 2.5, 3.5, 4.5))
"""Variances of a step, over the level of the spectrum and times n²."""
CERTAIN = 0.95
LEVEL_AT = 1e-3
"""Where the level is read, in rad a sample."""


class OffsetWalk(NamedTuple):
    """The mean variance of a step, and the weight of all walks beside that of a constant offset."""

    q: float
    weight: float
    low: float
    """Between low and high are 95 % of the walks' weight."""
    high: float

    @property
    def is_certain(self) -> bool:
        """Whether a constant offset is unlikely."""
        return self.weight > CERTAIN

    def K(self, h: float) -> Interval:
        """Return the random walk of the rate, per s and √s; null where the offset may be constant."""
        if not self.is_certain:
            return Interval()
        return Interval(*(math.sqrt(q / h) for q in (self.q, self.low, self.high)))


def offset_walk(found: System, samples: int, likelihood: Callable[[System], float]) -> OffsetWalk:
    """Return how fast the offset of a noise walks; likelihood: 2 log L of the samples with such a noise."""
    level = float(found.spectrum(np.array([LEVEL_AT]))[0])
    steps = np.array([0.0, *(share * level / samples**2 for share in SHARES)])
    likely = np.array([likelihood(found.with_offset(q)) for q in steps])
    if not np.isfinite(likely).all():
        return OffsetWalk(0.0, 0.0, 0.0, 0.0)
    weights = np.exp((likely - likely.max()) / 2) * np.array([1.0, *[1 / len(SHARES)] * len(SHARES)])
    weights /= weights.sum()
    walks = weights[1:] / weights[1:].sum()
    ends = np.interp([0.025, 0.975], np.cumsum(walks) - walks / 2, np.log(steps[1:]))
    return OffsetWalk(float(weights @ steps), float(weights[1:].sum()), *np.exp(ends).tolist())
