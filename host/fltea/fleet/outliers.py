"""Who is unlike the others: robust, and by the intervals, not by eye (pure).

The model is that of a meta-analysis with random effects: sensors of a kind differ by themselves, and each is
known as well as its interval says. Estimate i is normal about the fleet's middle μ with variance τ² + s_i².
μ and τ are found so that the odd ones do not move them: μ is a weighted median, and τ makes the median of
|estimate - μ| / √(τ² + s_i²) that of a normal variable. A sensor is odd if its distance has a probability
below the level after Bonferroni, over all that is compared at a time; so of fleets without an odd sensor at
most that share shows any at a look. τ itself is known from so many sensors only: distances are judged by
Student's t.
"""

import math
from collections.abc import Sequence
from statistics import NormalDist
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fltea.noise.distributions import student_quantile, student_tail
from fltea.records.plus_minus import NORMAL_95

FEWEST = 8
"""Sensors of a kind; with fewer nobody knows what is usual."""

LEVEL = 0.001
"""Share of fleets without an odd sensor in which any is called odd, at one look.

Records grow, so that the looks of a day are as good as some tens of independent ones: with 1 % a look a
tenth of healthy fleets of 60 sensors raised an alert within their first day, with this none of 160 did.
"""

MIDDLE = NormalDist().inv_cdf(0.75)
"""Median of |x| of a standard normal x."""

EFFICIENCY = 0.3
"""Degrees of freedom of τ for each sensor: a median absolute deviation is worth 0.37 of them (Rousseeuw
& Croux 1993), and μ and the intervals cost some."""

Floats = NDArray[np.float64]


class Fleet(NamedTuple):
    """What is usual: the middle and how much sensors differ by themselves, on the scale of comparison."""

    middle: float
    spread: float
    sensors: int


class Odd(NamedTuple):
    """place: in the sequences that were given. distance: in deviations. p: two-sided, of one comparison."""

    place: int
    distance: float
    p: float


def judge(
    value: Floats, low: Floats, high: Floats, *, comparisons: int, level: float = LEVEL
) -> tuple[Fleet | None, list[Odd]]:
    """The usual sensor of a kind, and who is unlike it.

    value, low, high: (n,) on a scale on which intervals are symmetric, such as logarithms. comparisons: how
    many are made at this look, of all kinds and figures. None with fewer than `FEWEST`.
    """
    n = len(value)
    if n < FEWEST:
        return None, []
    std = np.maximum(high - low, 1e-300) / (2 * NORMAL_95)
    middle, spread = _usual(value, std)
    # An interval may be too narrow by chance, as where a likelihood has two maxima and it holds the wrong one
    # alone: of 150 fits of one fractional noise one has an order 20 of its own deviations away.
    distance = (value - middle) / np.hypot(spread, np.maximum(std, np.median(std)))
    limit = student_quantile(1 - level / (2 * max(1, comparisons)), EFFICIENCY * (n - 1))
    odd = [
        Odd(int(i), float(distance[i]), student_tail(float(distance[i]), EFFICIENCY * (n - 1)))
        for i in np.flatnonzero(np.abs(distance) > limit)
    ]
    return Fleet(middle, spread, n), odd


def _usual(value: Floats, std: Floats) -> tuple[float, float]:
    """μ and τ; a few turns, for each needs the other."""
    middle, spread = float(np.median(value)), 0.0
    for _ in range(20):
        spread = _spread(np.abs(value - middle), std)
        found = _weighted_median(value, 1 / (spread**2 + std**2))
        if math.isclose(found, middle, rel_tol=1e-12, abs_tol=1e-15):
            break
        middle = found
    return middle, spread


def _spread(away: Floats, std: Floats) -> float:
    """τ at which the median of away / √(τ² + std²) is a normal variable's; 0 if it is below that."""
    least, most = 0.0, float(np.median(away)) / MIDDLE + 1e-300
    if np.median(away / std) <= MIDDLE:
        return 0.0
    for _ in range(60):
        spread = (least + most) / 2
        if np.median(away / np.sqrt(spread**2 + std**2)) > MIDDLE:
            least = spread
        else:
            most = spread
    return (least + most) / 2


def _weighted_median(value: Floats, weight: Floats) -> float:
    """Half of the weight is on either side; between two values where it is so for both."""
    weight = np.minimum(weight, 3 * np.median(weight))  # no sensor alone decides, however well it is known
    order = np.argsort(value)
    value, below = value[order], np.cumsum(weight[order])
    half = below[-1] / 2
    first = min(int(np.searchsorted(below, half * (1 - 1e-9))), len(value) - 1)
    last = min(int(np.searchsorted(below, half * (1 + 1e-9))), len(value) - 1)
    return float(value[first] + value[last]) / 2


def comparisons_of(counts: Sequence[int]) -> int:
    """Comparisons at one look: those of groups that are large enough to be judged."""
    return sum(count for count in counts if count >= FEWEST)
