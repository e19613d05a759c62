"""Convert the tracked system of an axis (a state-space model) to a plain Kalman filter.

The filter has white noise, a random walk of the bias, and Gauss-Markov states:

    rate = bias + the states + white noise with variance N²/h per sample
    bias: its steps have the variance K² h; at the start it is `bias`, with a standard deviation of `bias_std`
    a state: x_k = exp(-h/τ) x_k-1 + noise with variance σ² (1 - exp(-2 h/τ)); it starts at 0 ± σ

N, K, `bias_std` and the σ of each τ come from a least-squares fit to two curves of the tracked system. One
curve is the spectrum, which determines how the filter learns from further samples. The other is the variance
of the heading after the end of the record, over time, if only `bias` is subtracted from the rates.

The filter has no slope. A slope that was found is replaced by a random walk that moves equally far in a time
as long as the record. The filter has no high-pass either. It assumes that the noise continues below the
corner of a high-pass, so it predicts a larger heading error than the samples have.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import msgspec
import numpy as np

from fltea.estimator.tracker import Tracker
from fltea.identification.forecast_judge import FittedSystem, fitted_system
from fltea.noise.filters import HighPass
from fltea.noise.heading import aheads, heading_stds, rested
from fltea.noise.linear_system import System
from fltea.noise.non_negative import non_negative
from fltea.noise.parts import FILTERS, Relaxation, White, high_pass_of, spectrum
from fltea.records.arrays import Array, Mask

A_DECADE = 3
"""Number of correlation times that are tried in each decade."""
FASTEST, SLOWEST = 3.0, 0.1
"""Smallest correlation time in samples, and largest correlation time as a fraction of the record's length.

Parts of the noise with a longer correlation time become a random walk.
"""
POINTS_A_DECADE = 12
HEADINGS_A_DECADE = 6
TOLD_S = (1.0, 10.0, 60.0, 300.0)
"""Times after the end of the record for which the file gives the heading's σ [s]."""
FROM_S = 1.0
"""Shortest time after the end of the record for which the heading's error is fitted [s]."""
PASSED = 0.5
"""The fit uses only frequencies at which the sensor's low-pass lets at least this proportion of white noise
pass.
"""
WORSE = 1.05
"""A state is left out if the fit's error without the state is at most this many times the error with it.

A state is also left out if the fit's error without it is below ENOUGH.
"""
ENOUGH = 0.01
LEAST_WHITE = 0.01
"""If the white noise's variance is less than this many times a state's variance, the state is turned into
white noise.
"""
FOLDED_S, FOLDED = 0.1, 10.0
"""Longest correlation time of a state that may be turned into white noise, in s and in samples."""
NOTHING_LEFT = 0.1
"""If the fitted variance of the bias is less than this many times the variance by the tracked system (the
tracker's state-space model), the variance by the tracked system is used.
"""
LEAST_OF_ALL = 1e-4
"""The white noise's variance is made at least this many times the variance of all states together.

No filter works without white noise.
"""


class FilterState(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A Gauss-Markov state. At the filter's start it is 0, with a standard deviation of σ."""

    sigma: float
    tau_s: float


class HeadingStd(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Standard deviation of the heading `t_s` seconds after the record's end, in the unit of the axis · s.

    The heading is the integral of the rate minus `bias`.
    """

    t_s: float
    filter: float
    """The standard deviation that the plain filter predicts without further samples."""
    forecast: float
    """The standard deviation that `--forecast` predicts. In contrast to `filter`, it uses the values of the
    Gauss-Markov states at the record's end.
    """


class NavigationFilter(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """All parameters of a plain Kalman filter of one axis, in the unit of the axis; nothing is null."""

    N: float
    """White noise per √Hz; the variance of a sample is N²/h."""
    K: float
    """Random walk of the bias, per √s; 0 for a constant bias."""
    gauss_markov: tuple[FilterState, ...]
    """The states, from the slowest to the fastest; may be empty."""
    bias: float
    """Estimate of the bias after the last sample of the record. The values that the Gauss-Markov states have
    at this time are not part of it.
    """
    bias_std: float
    heading_std: tuple[HeadingStd, ...]
    """Standard deviation of the heading at several times, by which users can check their implementation of
    the filter.
    """


class _Target(NamedTuple):
    """What the filter has to reproduce: the spectrum at some λ, and the heading's variance over time."""

    lam: Array
    power: Array
    times_s: Array
    heading: Array


def navigation_filter(tracked: FittedSystem, y: Array, h: float) -> NavigationFilter:
    """Return the filter of an axis. `y`: samples without a gap, (n,), after which the filter starts.

    Raises:
        ValueError: no filter works with the noise.
    """
    forecast = tracked.system
    P = of_forecast = rested(forecast, len(y))
    if high_pass_of(tracked.parts) is not None:
        tracked = fitted_system([part for part in tracked.parts if not isinstance(part, HighPass)], y, h)
        P = rested(tracked.system, len(y))
    model, length_s = tracked.system, len(y) * h
    tau_s = _grid(tracked, h, length_s)
    part = _of_bias(model, SLOWEST * length_s / h)
    times_s = np.geomspace(FROM_S, max(length_s, 2 * FROM_S), _count(length_s / FROM_S, HEADINGS_A_DECADE))
    lam = _frequencies(tracked, h, len(y))
    tracker = Tracker([None])
    tracker.set(0, model)
    tracker.take(y)
    origin, x = tracker.x(0)
    always = _always(model, x, P)
    heading = _heading_variance(model, part, always, P, h, times_s)
    target = _Target(lam, _power(model, always, lam, len(y)), times_s, heading)
    found, tau_s = _folded(*_fitted(target, tau_s, h), h)
    known = float(part @ P @ part)
    # The fit may attribute the error of the bias to the Gauss-Markov states, and leave none for `bias_std`.
    if found[2] < NOTHING_LEFT * known:
        found[2] = known
    N, K, bias_std, *sigmas = np.sqrt(found).tolist()
    ahead = np.sqrt(_headings(tau_s, h, np.array(TOLD_S)) @ found).tolist()
    states = sorted(zip(tau_s, sigmas, strict=True), reverse=True)
    return NavigationFilter(
        N,
        K,
        tuple(FilterState(sigma, tau) for tau, sigma in states),
        origin + float(part @ x),
        bias_std,
        tuple(map(HeadingStd, TOLD_S, ahead, heading_stds(forecast, of_forecast, h, TOLD_S))),
    )


def _count(ratio: float, a_decade: int) -> int:
    return max(round(a_decade * math.log10(max(ratio, 1.0))), 2) + 1


def _grid(tracked: FittedSystem, h: float, length_s: float) -> list[float]:
    """Return the correlation times to try.

    These are the correlation times of the noise's parts. Between them are the times of a regular grid, except
    grid times close to those of the parts.
    """
    low, high = FASTEST * h, SLOWEST * length_s
    if high <= low:
        return []
    own = [part.tau_s for part in tracked.parts if isinstance(part, Relaxation) and low <= part.tau_s <= high]
    ratio = 10 ** (0.5 / A_DECADE)
    grid = np.geomspace(low, high, _count(high / low, A_DECADE)).tolist()
    return own + [tau for tau in grid if all(max(tau / one, one / tau) > ratio for one in own)]


def _frequencies(tracked: FittedSystem, h: float, samples: int) -> Array:
    """Return the frequencies λ for the fit.

    The frequencies go from one period in the record up to where a low-pass stops half of the noise.
    """
    low = 2 * math.pi / samples
    lam = np.geomspace(low, math.pi, _count(math.pi / low, POINTS_A_DECADE))
    filters = [part for part in tracked.parts if isinstance(part, FILTERS)]
    if not filters:
        return lam
    stopped = spectrum([White(1.0), *filters], lam, h) < PASSED
    return lam[: max(int(stopped.argmax()), POINTS_A_DECADE)] if stopped.any() else lam


def _of_bias(model: System, slow: float) -> Array:
    """Return a row vector. Its product with x, the state of the tracked system, is the filter's bias.

    The bias is the sum of the slow entries of x, each times the factor with which it enters a sample. An
    entry is slow if it decays over more than `slow` samples.
    """
    with np.errstate(divide="ignore"):
        memory = -1 / np.log(np.minimum(np.hypot(model.a, model.b), 1 - 1e-15))
    return np.asarray(np.where((memory > slow) & (model.a > 0), model.c, 0.0))


def slope_of(model: System) -> Mask:
    """Return a mask of the model's states: true for a slope of the offset, which a plain filter lacks."""
    return np.asarray((model.a < 1.0) & (np.diag(model.Q) == 0.0), dtype=np.bool_)


def _always(model: System, x: Array, P: Array) -> Array:
    """Return the stationary mean squares and products of the tracked system's states, (N, N).

    An offset and a slope are not stationary. The result is 0 for an offset. For a slope it is the mean square
    that was estimated at the record's end.
    """
    moving, slope = model.a < 1.0, slope_of(model)
    always = model.P0 * np.outer(moving, moving)
    always[slope] = always[:, slope] = 0.0
    always[slope, slope] = x[slope] ** 2 + P[slope, slope]
    return np.asarray(always)


def _power(model: System, always: Array, lam: Array, samples: int) -> Array:
    """Return the spectrum of the tracked system.

    A slope is replaced by a random walk that moves equally far in a time as long as the record.
    """
    slope = slope_of(model)
    per_sample = float((np.diag(always) * (1 - model.a) ** 2)[slope].sum())
    return np.asarray(model.spectrum(lam) + per_sample * samples / (4 * np.sin(lam / 2) ** 2))


def _heading_variance(model: System, part: Array, always: Array, P: Array, h: float, times_s: Array) -> Array:
    """Return the mean square of the heading's error at each time, if the estimated bias is subtracted.

    x is the state of the tracked system at the record's end, and E x is its estimate. After t seconds, the
    true angle is row @ x plus noise; `Ahead` has the row vector `row` and the noise's variance. The estimated
    bias is part @ E x, so the angle t part @ E x is subtracted. This leaves the error

        (row - t part) @ x  +  t part @ (x - E x)  +  noise

    `part`: row vector; part @ x is the bias. `always`: stationary mean squares of x. `P`: covariance of the
    error x - E x, which is also the covariance of this error with x.
    """
    moving = model.a < 1.0
    found = []
    for t_s, at in zip(times_s.tolist(), aheads(model, h, times_s.tolist()), strict=True):
        known = t_s * part
        rest = np.where(moving, at.row - known, 0.0)
        found.append(rest @ always @ rest + 2 * rest @ P @ known + known @ P @ known + at.variance)
    return np.array(found)


def _spectra(tau_s: Sequence[float], h: float, lam: Array) -> Array:
    """Return the spectrum of each noise of a filter, (frequencies, noises).

    The columns are: white noise with N² = 1; a random walk with K² = 1; an error of the bias with variance 1,
    whose spectrum is 0, since it is constant; each Gauss-Markov state with σ² = 1.
    """
    phi = np.exp(-h / np.array(tau_s))
    states = (1 - phi**2) / (1 - 2 * phi * np.cos(lam)[:, None] + phi**2)
    walk = h / (4 * np.sin(lam / 2) ** 2)
    return np.column_stack([np.full(len(lam), 1 / h), walk, np.zeros(len(lam)), states])


def _headings(tau_s: Sequence[float], h: float, times_s: Array) -> Array:
    """Return the variance of the heading that each noise of a filter causes, (times, noises).

    The columns are: white noise with N² = 1; a random walk with K² = 1; an error of the bias with variance 1;
    each Gauss-Markov state with σ² = 1.
    """
    tau = np.array(tau_s)
    over = times_s[:, None] / tau
    states = 2 * tau**2 * (over + np.expm1(-over))
    return np.column_stack([times_s, times_s**3 / 3, times_s**2, states])


def _solved(target: _Target, tau_s: Sequence[float], h: float) -> tuple[Array, float]:
    """Fit a filter to two curves: the spectrum, and the heading's variance over time.

    Return an array with the squares of N, K, bias_std and the σ of each state, and the root mean square of
    the relative errors of the fit. Both curves count equally.
    """
    rows = np.vstack(
        [
            _spectra(tau_s, h, target.lam) / target.power[:, None],
            _headings(tau_s, h, target.times_s) / target.heading[:, None],
        ]
    )
    counts = [len(target.lam), len(target.times_s)]
    weights = np.repeat([1 / math.sqrt(2 * count) for count in counts], counts)
    x = non_negative(rows * weights[:, None], weights)
    return x, float(np.sqrt((((rows @ x - 1) * weights) ** 2).sum()))


def _fitted(target: _Target, tau_s: list[float], h: float) -> tuple[Array, list[float]]:
    """Return the squares of N, K, bias_std and the σ of each state, and the correlation times of the states.

    States that the fit does not need are left out.
    """
    found, least = _solved(target, tau_s, h)
    used = found[3:] > 0
    tau_s, found = (
        [tau for tau, is_used in zip(tau_s, used, strict=True) if is_used],
        np.delete(found, 3 + np.flatnonzero(~used)),
    )
    for tau in list(tau_s):
        rest = [one for one in tau_s if one != tau]
        other, off = _solved(target, rest, h)
        if off <= max(WORSE * least, ENOUGH):
            tau_s, found = rest, other
    return found, tau_s


def _folded(found: Array, tau_s: list[float], h: float) -> tuple[Array, list[float]]:
    """Turn states that cannot be told from white noise into white noise."""
    for tau in sorted(tau_s):
        at = 3 + tau_s.index(tau)
        if tau > max(FOLDED_S, FOLDED * h) or found[0] / h > LEAST_WHITE * found[at]:
            break
        found[0] += 2 * found[at] * tau
        found, tau_s = np.delete(found, at), [one for one in tau_s if one != tau]
    found[0] = max(found[0], LEAST_OF_ALL * h * float(found[3:].sum()))
    return found, tau_s
