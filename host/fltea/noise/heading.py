"""Predict the error of a heading and the mean of the bias, from the samples of a sensor at rest.

Both follow from a linear state-space model of the rate's noise, which is called the system here. The
prediction of the bias uses only the samples at rest. The error of a heading is the integral of the bias less
this prediction. Matrix powers are computed by repeated squaring, so that a prediction for an hour costs as
little as one for a second.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from fltea import _native
from fltea.noise.linear_system import System
from fltea.records.arrays import Array
from fltea.records.plus_minus import within as within_95
from fltea.records.units import MOST_DEG

LONGEST_REST_S = 86400.0
LONGEST_DRIVE_S = 3600.0
NEAR = 1.01
"""The searches for a time of rest or of drive (`rest_for`, `drive_for`) end when they know the time to within
this factor.
"""


class Ahead(NamedTuple):
    """A sum or mean over future samples: `row @ x` plus noise, where x (n,) is the system's present state.

    The present is the last sample at rest.
    """

    row: Array
    """Weight of each state in the sum or mean, (n,)."""
    variance: float
    """Variance of the noise that is added to `row @ x`. It is noise of the future samples."""

    def std(self, P: Array) -> float:
        """Return the standard deviation of the sum or mean. `P`: covariance of the present state x."""
        return math.sqrt(max(float(self.row @ P @ self.row) + self.variance, 0.0))


class Rest(NamedTuple):
    """How long a sensor has to rest. `rest_s` is None, with a reason, if no rest is long enough."""

    rest_s: float | None
    reason: str = ""


def ahead(system: System, h: float, t_s: float) -> Ahead:
    """Return the error of the heading `t_s` seconds after the last sample at rest, as a function of x then.

    x is the state of the system. `h`: sampling period [s].
    """
    return aheads(system, h, [t_s])[0]


def aheads(system: System, h: float, times_s: Sequence[float]) -> list[Ahead]:
    """Return what `ahead` returns, for each of several times. The squared matrices are computed only once."""
    counts = [max(round(t_s / h), 1) for t_s in times_s]
    return _sums(system, h * system.c, h * h * system.R, counts)


def mean_ahead(system: System, samples: int) -> Ahead:
    """Return the mean of the bias over the next `samples` samples, as a function of the present state x.

    `samples` samples last T seconds. The expectation of this mean is Bias(T). It is `row @ x` of the result,
    and its σ is `std(P)`. Two kinds of noise are not part of the bias: white noise, and states whose weight
    in `system.bias` is 0. So the mean of the samples themselves varies more: white noise alone adds N²/T to
    its variance.

    Raises:
        ValueError: `samples` is below 1.
    """
    return means_ahead(system, [samples])[0]


def means_ahead(system: System, counts: Sequence[int]) -> list[Ahead]:
    """Return `mean_ahead` for each of several numbers of samples. Squared matrices are computed only once."""
    if any(count < 1 for count in counts):
        raise ValueError(f"a mean needs at least one sample, got {list(counts)}")
    sums = _sums(system, system.bias, 0.0, counts)
    return [Ahead(row / m, variance / m**2) for (row, variance), m in zip(sums, counts, strict=True)]


def _sums(system: System, c: Array, R: float, counts: Sequence[int]) -> list[Ahead]:
    """Return, for each number in `counts`, the sum of c @ x plus white noise over so many future samples.

    x is the state of the system, and `R` the variance of the white noise.
    """
    rows, variances = _native.sums_ahead(system.numbers, c, R, list(counts))
    return [Ahead(np.array(row), variance) for row, variance in zip(rows, variances, strict=True)]


def heading_std(system: System, P: Array, h: float, t_s: float) -> float:
    """Return the standard deviation of the heading `t_s` seconds after the last sample at rest.

    It is in deg for a rate in deg/s. `h`: sampling period [s].

    `P`: covariance of the system's state after the last sample at rest, as `rested` returns it.
    """
    return ahead(system, h, t_s).std(P)


def rested(system: System, samples: int) -> Array:
    """Return the covariance of the state x after `samples` samples at rest, from the initial state on."""
    P = np.empty_like(system.P0)
    _native.rested(system.numbers, max(samples, 1), P)
    return P


def bias_std(system: System, P: Array) -> float:
    """Return the standard deviation of the bias, which is the sum of signal and offset.

    `P`: covariance of the state x.
    """
    return math.sqrt(max(float(system.bias @ P @ system.bias), 0.0))


def heading_stds(system: System, P: Array, h: float, times_s: Sequence[float]) -> list[float]:
    """Return what `heading_std` returns, for each of several times."""
    return [one.std(P) for one in aheads(system, h, times_s)]


def rest_for(system: System, h: float, t_s: float, within: float, unit: str = "°") -> Rest:
    """Return how long to rest, so that the heading's σ is at most `within` after `t_s` of motion.

    `t_s`: time after the last sample at rest [s]. `unit`: unit of the heading, for `Rest.reason`.
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
    """Return for how long after a rest [s] the heading's standard deviation stays at most `within`.

    This function is the inverse of `rest_for`. Like `rest_for`, it rounds to the safe side. The result is 0
    if `within` is exceeded at the first sample after the rest, and None if it is not exceeded even after an
    hour.
    """
    P = rested(system, max(round(rest_s / h), 1))
    steps = math.ceil(math.log(max(LONGEST_DRIVE_S / h, 1.0)) / math.log(NEAR))
    # The standard deviation of a heading may oscillate in time. So it is computed at all times, and not
    # searched by bisection, to find where it exceeds `within` first.
    counts = sorted({round(min(NEAR**step, max(LONGEST_DRIVE_S / h, 1.0))) for step in range(steps + 1)})
    times_s = [count * h for count in counts]
    good_s = 0.0
    for t_s, std in zip(times_s, heading_stds(system, P, h, times_s), strict=True):
        if not std <= within:
            return good_s
        good_s = t_s
    return None
