"""How fast an offset drifts, by how likely walks of it make the samples.

The spectrum leaves out what is slower than ten periods of a record. A filter in the time does not. So walks
of the offset, from one that a record of n samples hardly shows to one that it shows at once, are weighted by
their likelihood, and a constant offset as much as all of them together.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from fltea.estimator.tracker import Remembered
from fltea.noise.parts import Part
from fltea.noise.system import System, system
from fltea.records.arrays import Array
from fltea.records.fit import Interval

SHARES = tuple(10.0 ** (k / 2) for k in range(1, 10))
"""Variances of a step, over the level of the spectrum and times n²."""
CERTAIN = 0.95
LEVEL_AT = 1e-3
"""Where the level is read, in rad a sample."""


class OffsetWalk(NamedTuple):
    """Variances of a step, of which the first is 0, and how likely each is."""

    steps: Array
    weights: Array

    @property
    def q(self) -> float:
        """The mean variance of a step."""
        return float(self.weights @ self.steps)

    @property
    def is_certain(self) -> bool:
        """Whether a constant offset is unlikely."""
        return float(self.weights[0]) < 1 - CERTAIN

    def K(self, h: float) -> Interval:
        """Return the random walk of the rate, per s and √s; null where the offset may be constant.

        The interval has 95 % of the walks' weight.
        """
        if not self.is_certain:
            return Interval()
        walks = self.weights[1:] / self.weights[1:].sum()
        ends = np.interp([0.025, 0.975], np.cumsum(walks) - walks / 2, np.log(self.steps[1:]))
        return Interval(*(math.sqrt(q / h) for q in (self.q, *np.exp(ends))))


CONSTANT = OffsetWalk(np.zeros(1), np.ones(1))


def system_of(
    parts: Sequence[Part], h: float, samples: int, remembered: Remembered
) -> tuple[System, OffsetWalk]:
    """Return the system of a noise found in so many samples, and how its offset walks.

    It does beside any noise that does not walk itself, orders too. Measured, this is as near the best as a
    constant offset where that is the truth, and nearer where a fit has missed what is slow. remembered: of
    these samples.
    """
    found = system(parts, h, samples, found=True)
    if found.walks:
        return found, CONSTANT
    walk = offset_walk(found, samples, remembered)
    return found.with_offset(walk.q, of_state=walk.is_certain), walk


def offset_walk(found: System, samples: int, remembered: Remembered) -> OffsetWalk:
    """Return how fast the offset of a noise walks."""
    level = float(found.spectrum(np.array([LEVEL_AT]))[0])
    steps = np.array([0.0, *(share * level / samples**2 for share in SHARES)])
    likely = remembered.likelihoods(found.with_offset(), steps)
    if not np.isfinite(likely).all():
        return CONSTANT
    weights = np.exp((likely - likely.max()) / 2) * np.array([1.0, *[1 / len(SHARES)] * len(SHARES)])
    return OffsetWalk(steps, weights / weights.sum())
