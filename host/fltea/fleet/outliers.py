"""Finds sensors that differ from others of their kind by more than the errors of the estimates explain.

The model is a meta-analysis with random effects. The true values of sensors of a kind differ by a spread τ,
and estimate i has an error s_i, known from its interval. So estimate i is normally distributed about the
fleet's middle μ with variance τ² + s_i². μ and τ are estimated robustly, so that outliers do not move them: μ
is a weighted median, and τ makes the median of |estimate - μ| / √(τ² + s_i²) equal to that of a standard
normal variable. A sensor is reported if the p-value of its distance from μ is below `level`, after
Bonferroni's correction for all comparisons made at the same time. So if a fleet has no true outliers, a
comparison reports one with a probability of at most `level`. p-values are those of Student's t, since τ is
estimated from few sensors.
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
"""Sensors of a kind are compared if there are at least this many; with fewer sensors, their usual value and
their spread are not known well enough.
"""

LEVEL = 0.001
"""Probability that a comparison of all sensors reports an outlier although the fleet has no true outliers.

Fits change as samples are added. So sensors are compared anew many times a day, and in each comparison chance
may report an outlier. With a level of 1 %, one tenth of healthy fleets of 60 sensors raised an alert on the
first day; with 0.1 %, none of 160 fleets did.
"""

MIDDLE = NormalDist().inv_cdf(0.75)
"""Median of |x| for a standard normal variable x."""

EFFICIENCY = 0.3
"""For n sensors, Student's t has EFFICIENCY · (n - 1) degrees of freedom. With a standard deviation it would
have n - 1, but the spread comes from a median absolute deviation (efficiency 0.37, Rousseeuw & Croux 1993).
Middle and intervals are estimated as well, which lowers the efficiency further.
"""

Floats = NDArray[np.float64]


class Fleet(NamedTuple):
    """Usual value and spread of a group of sensors, on the scale (linear or logarithmic) of the comparison.

    `spread`: standard deviation of the true values between sensors, without the errors of the estimates.
    """

    middle: float
    spread: float
    sensors: int


class Odd(NamedTuple):
    """A value that differs from the values of the other sensors.

    `place`: index of the value in its group. `distance`: distance from the middle in standard deviations.
    `p`: two-sided p-value of this one comparison.
    """

    place: int
    distance: float
    p: float


def judge(
    value: Floats, low: Floats, high: Floats, *, comparisons: int, level: float = LEVEL
) -> tuple[Fleet | None, list[Odd]]:
    """Return the usual value of a group of sensors, and the values that differ from it.

    With fewer than `FEWEST` sensors, return None and an empty list.

    `value`, `low`, `high`: values and ends of their intervals (n,), on a scale on which intervals are
    symmetric, such as logarithms.
    `comparisons`: number of comparisons made at the same time, over all groups.
    `level`: significance level for all these comparisons together.
    """
    n = len(value)
    if n < FEWEST:
        return None, []
    std = np.maximum(high - low, 1e-300) / (2 * NORMAL_95)
    middle, spread = _usual(value, std)
    # An interval may be too narrow by chance, for instance if the likelihood has two maxima and the interval
    # contains only the wrong one: of 150 fits of one fractional noise, one α was wrong by 20 of its standard
    # deviations. So an interval narrower than the median width is widened to the median width.
    distance = (value - middle) / np.hypot(spread, np.maximum(std, np.median(std)))
    limit = student_quantile(1 - level / (2 * max(1, comparisons)), EFFICIENCY * (n - 1))
    odd = [
        Odd(int(i), float(distance[i]), student_tail(float(distance[i]), EFFICIENCY * (n - 1)))
        for i in np.flatnonzero(np.abs(distance) > limit)
    ]
    return Fleet(middle, spread, n), odd


def _usual(value: Floats, std: Floats) -> tuple[float, float]:
    """Return middle and spread of the sensors by iteration, since each of the two depends on the other."""
    middle, spread = float(np.median(value)), 0.0
    for _ in range(20):
        spread = _spread(np.abs(value - middle), std)
        median = _weighted_median(value, 1 / (spread**2 + std**2))
        if math.isclose(median, middle, rel_tol=1e-12, abs_tol=1e-15):
            break
        middle = median
    return middle, spread


def _spread(away: Floats, std: Floats) -> float:
    """Return the standard deviation τ of the true values between sensors.

    `away`: distances of the estimates from the usual value. `std`: errors of the estimates. With the right τ,
    the ratios `away` / √(τ² + `std`²) are |x| of a standard normal x, and their median is `MIDDLE`. So τ is
    computed from this median. It is 0 if the errors alone explain the distances.
    """
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
    """Return the weighted median: half of the total weight lies below it, and half above it.

    If two values are equally close to the middle of the weights, their mean is returned.
    """
    weight = np.minimum(weight, 3 * np.median(weight))  # no sensor counts more than three usual ones
    order = np.argsort(value)
    value, below = value[order], np.cumsum(weight[order])
    half = below[-1] / 2
    first = min(int(np.searchsorted(below, half * (1 - 1e-9))), len(value) - 1)
    last = min(int(np.searchsorted(below, half * (1 + 1e-9))), len(value) - 1)
    return float(value[first] + value[last]) / 2


def comparisons_of(counts: Sequence[int]) -> int:
    """Return the number of comparisons in groups of sizes `counts`.

    Groups below `FEWEST` are not compared.
    """
    return sum(count for count in counts if count >= FEWEST)
