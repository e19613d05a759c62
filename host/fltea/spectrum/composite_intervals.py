"""Intervals of the parameters of composite models, by profile likelihood (pure).

As for the fractional model (`profile.py`): a value belongs to the interval if the best fit that has it is at
most 3.84 in 2 log L below the best of all. The curvature at the maximum would not do: the correlation time of
a slow part is known from below only, and of white noise beneath others often no more than that it is small.
"""

import math

import msgspec
import numpy as np
from numpy.typing import NDArray

from fltea.spectrum.composite_fit import LEAK_OF_CUBIC, Kind, Lines, Point, bounds, score, slopes
from fltea.spectrum.profile import CRITICAL

Array = NDArray[np.float64]

SLOWEST = 300.0
"""Correlation times are tried up to so many times the longest that the data can show."""
LEAST = 7.0
"""Below this power of e under its best value a variance is 0."""
CLOSE = 0.01
"""The tolerance of 2 log L at an end."""
LOOKS = 40
NORMAL = 1.96


class Estimate(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A positive parameter and its 95 % interval; an end that the data do not have is None."""

    value: float
    low: float | None
    high: float | None

    def scaled(self, factor: float, power: float) -> "Estimate":
        """Return factor times a power of the interval; a power below 0 changes its ends."""
        ends = [None if end is None else factor * end**power for end in (self.low, self.high)]
        low, high = ends if power > 0 else reversed(ends)
        return Estimate(factor * self.value**power, low, high)


def interval(data: Lines, kind: Kind, best: Point, i: int) -> Estimate:
    """Return parameter i of `best`, which is the best of all, with its interval."""
    ends = bounds(data, kind, SLOWEST)
    low, high = _end(data, kind, best, i, -1, ends), _end(data, kind, best, i, 1, ends)
    return Estimate(
        math.exp(best.eta[i]),
        None if low is None else math.exp(low),
        None if high is None else math.exp(high),
    )


def of_walk(data: Lines, kind: Kind, best: Point, i: int) -> Estimate:
    """Return the same of the walk: what leaks of it hangs on one step, and is the same at all frequencies."""
    found = interval(data, kind, best, i)
    relative = slopes(data, kind, best.eta)
    own = (relative[1][i] / relative[0]) ** 2 * data.counts
    leaks = float(own[data.leaks].sum() / own.sum())
    # χ² of one degree has √2 for standard deviation.
    more = NORMAL * leaks * math.sqrt(2) * LEAK_OF_CUBIC / (1 + LEAK_OF_CUBIC)
    low, high = (
        None if end is None else found.value * math.exp(sign * math.hypot(math.log(end / found.value), more))
        for sign, end in ((-1, found.low), (1, found.high))
    )
    return Estimate(found.value, low, high)


def _end(data: Lines, kind: Kind, best: Point, i: int, sign: int, ends: tuple[Array, Array]) -> float | None:
    """Return the value of parameter i where the profile crosses, to one side; None: it does nowhere."""
    at = float(best.eta[i])
    corner = 1 + kind.gauss_markov <= i < 1 + 2 * kind.gauss_markov
    limit = float(ends[0 if sign < 0 else 1][i])
    if not corner:
        limit = at + sign * LEAST
    step = min(max(2 * _deviation(data, kind, best, i), 1e-3), 1.0)
    inside, eta, inside_excess, outside = at, best.eta, 0.0, math.nan
    outside_excess = math.nan
    for _ in range(LOOKS):
        if math.isnan(outside):
            trial = inside + sign * step
            step *= 1.6
            if sign * (trial - limit) >= 0:
                trial = limit
        else:
            # The excess is about quadratic: its root is about straight.
            a, b = (math.sqrt(max(one, 0.0)) for one in (inside_excess, outside_excess))
            share = (math.sqrt(CRITICAL) - a) / max(b - a, 1e-12)
            trial = inside + min(max(share, 0.1), 0.9) * (outside - inside)
        start = eta.copy()
        start[i] = trial
        found = score(data, kind, start, i, ends)
        excess = 2 * (found.nll - best.nll)
        if abs(excess - CRITICAL) < CLOSE:
            return trial
        if excess < CRITICAL:
            if trial == limit:
                return None
            inside, inside_excess, eta = trial, excess, found.eta
        else:
            outside, outside_excess = trial, excess
        if not math.isnan(outside) and abs(outside - inside) < 1e-4:
            break
    return outside if not math.isnan(outside) else None


def _deviation(data: Lines, kind: Kind, best: Point, i: int) -> float:
    """Return the standard deviation by the curvature, with which the search begins."""
    spectrum, parts = slopes(data, kind, best.eta)
    relative = parts / spectrum
    information = (relative * data.counts) @ relative.T
    return float(np.sqrt(max(np.linalg.pinv(information)[i, i], 0.0)))
