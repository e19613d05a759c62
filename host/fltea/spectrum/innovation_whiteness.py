"""Test whether a Kalman filter's innovations in a record are white, and as large as the filter expects.

`estimator.bank` has the version of this test for live samples.
"""

import functools
import math

import msgspec
import numpy as np

from fltea.noise.distributions import chi2_quantile, chi2_tail
from fltea.records.arrays import Array
from fltea.records.fit import Interval
from fltea.records.plus_minus import NORMAL_95

LAGS = 20
"""Number of lags in the Ljung–Box test. The number is even, since χ² then has a closed form."""
FEWEST = 100
COLOURED_P = 1e-3
"""Innovations may be coloured (correlated) if their Ljung–Box statistic is so high that white innovations
reach it with at most this probability.
"""
COLOURED = 0.1
"""Innovations count as coloured (correlated) only if a second figure also exceeds this value, since in a day
of samples even a tiny correlation is significant. The figure is the root of the sum of their squared
autocorrelations. It is 0.3 to 0.7 for samples that passed a low-pass filter, and 0.12 to 0.15 if the Kalman
filter assumes an α that is too small by 0.25 to 0.5.
"""


class Innovations(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Figures of n innovations. They show whether the filter's model of the noise is correct.

    If it is, the mean normalised square `nis` is about 1, the correlation `lag1` of neighbours is 0 ± 1/√n,
    and the probability `ljung_box_p` is spread evenly from 0 to 1.
    """

    samples: int
    nis: float
    """Mean of the squared innovations (NIS), where each square is divided by the variance that the filter
    expects.
    """
    lag1: float
    """Correlation of each innovation with the following one."""
    ljung_box: float
    ljung_box_p: float
    """Probability that white innovations give a Ljung–Box statistic of at least `ljung_box`."""


class InnovationSums:
    """Sums over innovations that arrive block by block, in constant memory."""

    def __init__(self) -> None:
        self._samples = 0
        self._squares = self._normalised = 0.0
        self._products = np.zeros(LAGS)
        self._before = np.empty(0)

    def add(self, innovation: Array, std: Array) -> None:
        """Add innovations (n,), and the standard deviations (n,) that the filter expects them to have.

        Samples without finite values are left out.
        """
        good = np.isfinite(innovation) & np.isfinite(std) & (std > 0)
        e, s = innovation[good], std[good]
        if not len(e):
            return
        self._samples += len(e)
        self._squares += float(e @ e)
        self._normalised += float(((e / s) ** 2).sum())
        known = len(self._before)
        both = np.concatenate([self._before, e])
        for lag in range(1, LAGS + 1):
            first = min(max(known, lag), len(both))
            self._products[lag - 1] += float(both[first:] @ both[max(first - lag, 0) :][: len(both) - first])
        self._before = both[-LAGS:]

    def result(self) -> Innovations | None:
        """Return the figures of all innovations so far; None if there are fewer than 100."""
        n = self._samples
        if n < FEWEST or not self._squares > 0:
            return None
        r = self._products / self._squares
        q = float(n * (n + 2) * (r**2 / (n - np.arange(1, LAGS + 1))).sum())
        return Innovations(n, self._normalised / n, float(r[0]), q, chi2_tail(q, LAGS))


def innovations(innovation: Array, std: Array) -> Innovations | None:
    """Return the figures of innovations; None if there are fewer than 100.

    `std`: the standard deviations that the filter expects the innovations to have. Innovations and `std` have
    the shape (n,).
    """
    sums = InnovationSums()
    sums.add(innovation, std)
    return sums.result()


def describes_order(
    white: bool | None, alpha: float, alpha_std: float, order: Interval | None
) -> bool | None:
    """Return whether a filter's order `alpha`, with its standard deviation `alpha_std`, describes the noise.

    White innovations alone do not show this: on white noise, with or without a drift, a filter with any order
    up to 1 has white innovations. So the fit of the spectrum has to give an order, too, and the two orders
    have to agree.

    `white`: whether the innovations are white; None if that is not known yet. `order`: the interval of the
    order by the fit of the spectrum; None as long as there is no fit. The ends of the interval are None if
    the noise has no order.

    The result is False if the innovations are not white. It is None, for not known yet, as long as `white` or
    `order` is None, or if `alpha` is not finite.
    """
    if not white or order is None or not math.isfinite(alpha):
        return False if white is False else None
    if order.low is None or order.high is None:
        return False
    reach = NORMAL_95 * alpha_std
    return order.low - reach <= alpha <= order.high + reach


def describes(samples: int, ljung_box: float) -> bool:
    """Return whether innovations are nearly white. `ljung_box`: their Ljung–Box statistic.

    If they are not, the filter's α and f say nothing about the noise, nor do the standard deviations that the
    filter gives for them.
    """
    return math.sqrt(ljung_box / samples) <= COLOURED or ljung_box < _coloured()


@functools.cache
def _coloured() -> float:
    """Return the Ljung–Box statistic that white innovations exceed with the probability COLOURED_P."""
    return float(chi2_quantile(1 - COLOURED_P, [LAGS])[0])
