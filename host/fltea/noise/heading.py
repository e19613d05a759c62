"""Predict the error of a heading and the mean of the bias, from the samples of a sensor at rest.

Both follow from the linear system of the noise of a rate. The error of a heading is the integral of the bias
less its prediction, which uses only the samples at rest. Matrix powers are computed by repeated squaring, so
that a prediction for an hour costs as little as for a second.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from fltea import _native
from fltea.noise.system import System
from fltea.records.arrays import Array
from fltea.records.plus_minus import within as within_95
from fltea.records.units import MOST_DEG

LONGEST_REST_S = 86400.0
LONGEST_DRIVE_S = 3600.0
NEAR = 1.01
"""A time of rest or of drive is searched for until it is known within this factor."""


class Ahead(NamedTuple):
    """A sum over future samples, expressed by the state x of the system and additional noise."""

    row: Array
    """The sum is `row @ x` plus noise, where x is the state (n,) at the last sample at rest."""
    variance: float
    """Variance of the noise in the sum."""

    def std(self, P: Array) -> float:
        """Return the standard deviation of the sum. `P`: covariance of x after the last sample at rest."""
        return math.sqrt(max(float(self.row @ P @ self.row) + self.variance, 0.0))


class Rest(NamedTuple):
    """How long a sensor has to rest [s]. The time is None, with a reason, if no rest is long enough."""

    rest_s: float | None
    reason: str = ""


def ahead(system: System, h: float, t_s: float) -> Ahead:
    """Return the angle that adds up in `t_s` seconds after the last sample at rest.

    `h`: sampling period [s].
    """
    return aheads(system, h, [t_s])[0]


def aheads(system: System, h: float, times_s: Sequence[float]) -> list[Ahead]:
    """Return the angle after each of several times; the squared matrices are computed only once."""
    counts = [max(round(t_s / h), 1) for t_s in times_s]
    return _sums(system, h * system.c, h * h * system.R, counts)


def mean_ahead(system: System, samples: int) -> Ahead:
    """Return the mean of the bias over the next `samples` samples, in terms of x after the newest sample.

    Bias(T) is its expectation `row @ x`, with σ = `std(P)`. Noise that is no signal (white noise R, and
    states that `system.bias` leaves out) does not contribute. So the mean of the samples themselves varies
    more: by N²/T, for white noise.

    Raises:
        ValueError: `samples` is below 1.
    """
    return means_ahead(system, [samples])[0]


def means_ahead(system: System, counts: Sequence[int]) -> list[Ahead]:
    """Return `mean_ahead` for several numbers of samples; the squared matrices are computed only once."""
    if any(count < 1 for count in counts):
        raise ValueError(f"a mean is one of a sample or more, got {list(counts)}")
    sums = _sums(system, system.bias, 0.0, counts)
    return [Ahead(row / m, variance / m**2) for (row, variance), m in zip(sums, counts, strict=True)]


def _sums(system: System, c: Array, R: float, counts: Sequence[int]) -> list[Ahead]:
    """Return the sums of c @ x, plus white noise of variance R, over each number of future samples."""
    rows, variances = _native.sums_ahead(system.numbers, c, R, list(counts))
    return [Ahead(np.array(row), variance) for row, variance in zip(rows, variances, strict=True)]


def heading_std(system: System, P: Array, h: float, t_s: float) -> float:
    """Return the standard deviation of the heading, in deg for a rate in deg/s; arguments as for `ahead`.

    `P`: covariance of x after the last sample at rest, as `rested` returns it.
    """
    return ahead(system, h, t_s).std(P)


def rested(system: System, samples: int) -> Array:
    """Return the covariance of x after `samples` samples at rest, starting with the very first sample."""
    P = np.empty_like(system.P0)
    _native.rested(system.numbers, max(samples, 1), P)
    return P


def bias_std(system: System, P: Array) -> float:
    """Return the standard deviation of the bias (signal states plus offset); `P` as for `heading_std`."""
    return math.sqrt(max(float(system.bias @ P @ system.bias), 0.0))


def heading_stds(system: System, P: Array, h: float, times_s: Sequence[float]) -> list[float]:
    """Return `heading_std` for several times."""
    return [one.std(P) for one in aheads(system, h, times_s)]


def rest_for(system: System, h: float, t_s: float, within: float, unit: str = "°") -> Rest:
    """Return how long to rest so that the heading's standard deviation is at most `within`, `t_s` later.

    `unit`: unit of the heading, which is written after numbers in the reason.
    """
    at = ahead(system, h, t_s)

    def std(rest_s: float) -> float:
        return at.std(rested(system, max(round(rest_s / h), 1)))

    best = std(LONGEST_REST_S)
    if best > within:
        good = f"the heading is good to {within_95(best, unit)} (95 %) at best"
        why = good if best <= MOST_DEG else "no heading is left"
        return Rest(None, f"No rest is enough: after {t_s:g} s {why}.")
    low, high = h, LONGEST_REST_S
    if std(low) <= within:
        return Rest(low)
    while high / low > NEAR:
        middle = math.sqrt(low * high)
        low, high = (low, middle) if std(middle) <= within else (middle, high)
    return Rest(high)


def drive_for(system: System, h: float, rest_s: float, within: float) -> float | None:
    """Return how long [s] after a rest the heading's standard deviation stays at most `within`.

    This is the inverse of `rest_for`. Like that one, it rounds to the safe side. The result is 0 if the first
    sample exceeds `within`, and None if even an hour does not.
    """
    P = rested(system, max(round(rest_s / h), 1))
    steps = math.ceil(math.log(max(LONGEST_DRIVE_S / h, 1.0)) / math.log(NEAR))
    # The standard deviation of a heading may oscillate. All times are computed, since the first excess is
    # wanted.
    counts = sorted({round(min(NEAR**step, max(LONGEST_DRIVE_S / h, 1.0))) for step in range(steps + 1)})
    times_s = [count * h for count in counts]
    good_s = 0.0
    for t_s, std in zip(times_s, heading_stds(system, P, h, times_s), strict=True):
        if not std <= within:
            return good_s
        good_s = t_s
    return None
