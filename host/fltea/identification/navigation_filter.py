"""The tracked system of an axis as a plain Kalman filter has it: white noise, a walk, Gauss-Markov states.

    rate = bias + the states + white noise of variance N²/h a sample
    bias: walks by K² h a sample, and is `bias` with a deviation of `bias_std` after the last sample
    a state: x_k = exp(-h/τ) x_k-1 + noise of variance σ² (1 - exp(-2 h/τ)); σ at first

One least-squares fit finds N, K, the σ of each τ and `bias_std`, so that two curves are those of the tracked
system: the spectrum, by which a filter learns from further samples, and the heading's variance by time when
nothing but `bias` is subtracted from the end of the record on. Such a filter has no slope: for it, one that
was found is a walk that gets as far. Nor has it a high-pass: it takes the noise as if it went on below the
corner, so that its heading is less certain than the samples are.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import msgspec
import numpy as np

from fltea.estimator.tracker import Tracker
from fltea.identification.forecast_judge import Learned, learned
from fltea.noise.heading import aheads, heading_stds, rested
from fltea.noise.non_negative import non_negative
from fltea.noise.parts import FILTERS, HighPass, Relaxation, White, high_pass_of, spectrum
from fltea.noise.system import System
from fltea.records.arrays import Array, Mask

A_DECADE = 3
"""Correlation times that are tried."""
FASTEST, SLOWEST = 3.0, 0.1
"""The least correlation time, in samples, and the largest, over the record's length; what is slower walks."""
POINTS_A_DECADE = 12
HEADINGS_A_DECADE = 6
TOLD_S = (1.0, 10.0, 60.0, 300.0)
"""Times for which the file tells the heading's σ."""
FROM_S = 1.0
"""The least time that a heading is wanted for."""
PASSED = 0.5
"""Share of white noise that a low-pass of the sensor has to let through for a frequency to count."""
WORSE = 1.05
"""A state is left out where the rest is off by no more than this ratio, or by less than ENOUGH."""
ENOUGH = 0.01
LEAST_WHITE = 0.01
"""Variance of the white noise of a sample, over that of a state, below which the state counts as white."""
FOLDED_S, FOLDED = 0.1, 10.0
"""Correlation times, in s and in samples, up to which it may."""
NOTHING_LEFT = 0.1
"""Variance of the bias over that of the tracked system, below which the latter counts."""
LEAST_OF_ALL = 1e-4
"""The same, over the variance of all states: no filter can do without any white noise."""


class FilterState(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A Gauss-Markov state, which is 0 at first, with a deviation of σ."""

    sigma: float
    tau_s: float


class HeadingStd(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Standard deviation of the heading t_s after the record's end, in the unit of the axis times s.

    The heading is the integral of the rate less `bias`.
    """

    t_s: float
    filter: float
    """By this filter, if it is given no further sample."""
    forecast: float
    """By `--forecast`, which knows also what value the states have at the end of the record."""


class NavigationFilter(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """All that a plain Kalman filter of one axis is built from, in `unit` of the axis; nothing is null."""

    N: float
    """White noise, per √Hz: N²/h is the variance of a sample."""
    K: float
    """Random walk of the bias, per √s; 0: it is constant."""
    gauss_markov: tuple[FilterState, ...]
    """From the slowest to the fastest; there may be none."""
    bias: float
    """After the last sample of the record; the states are not in it."""
    bias_std: float
    heading_std: tuple[HeadingStd, ...]
    """How far the heading is off by time, to check a filter by."""


class _Target(NamedTuple):
    """What the filter has to have: a spectrum at λ, and the heading's variance at times."""

    lam: Array
    power: Array
    times_s: Array
    heading: Array


def navigation_filter(tracked: Learned, y: Array, h: float) -> NavigationFilter:
    """Return the filter of an axis; y: the samples (n,), without a gap, at whose end it begins.

    Raises:
        ValueError: no filter can work with the noise.
    """
    forecast = tracked.system
    P = of_forecast = rested(forecast, len(y))
    if high_pass_of(tracked.parts) is not None:
        tracked = learned([part for part in tracked.parts if not isinstance(part, HighPass)], y, h)
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
    if found[2] < NOTHING_LEFT * known:  # the fit gave the error of the bias to the states
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


def _grid(tracked: Learned, h: float, length_s: float) -> list[float]:
    """Return correlation times: those that were found, and a grid without their neighbours."""
    low, high = FASTEST * h, SLOWEST * length_s
    if high <= low:
        return []
    own = [part.tau_s for part in tracked.parts if isinstance(part, Relaxation) and low <= part.tau_s <= high]
    apart = 10 ** (0.5 / A_DECADE)
    grid = np.geomspace(low, high, _count(high / low, A_DECADE)).tolist()
    return own + [tau for tau in grid if all(max(tau / one, one / tau) > apart for one in own)]


def _frequencies(tracked: Learned, h: float, samples: int) -> Array:
    """Return λ from one period of the record to where a low-pass takes half of the noise away."""
    low = 2 * math.pi / samples
    lam = np.geomspace(low, math.pi, _count(math.pi / low, POINTS_A_DECADE))
    filters = [part for part in tracked.parts if isinstance(part, FILTERS)]
    if not filters:
        return lam
    stopped = spectrum([White(1.0), *filters], lam, h) < PASSED
    return lam[: max(int(stopped.argmax()), POINTS_A_DECADE)] if stopped.any() else lam


def _of_bias(model: System, slow: float) -> Array:
    """Return what the filter's bias has of each coordinate: those that remember `slow` samples or more."""
    with np.errstate(divide="ignore"):
        memory = -1 / np.log(np.minimum(np.hypot(model.a, model.b), 1 - 1e-15))
    return np.asarray(np.where((memory > slow) & (model.a > 0), model.c, 0.0))


def slope_of(model: System) -> Mask:
    """Return which coordinate is the slope of the offset, which no such filter has."""
    return np.asarray((model.a < 1.0) & (np.diag(model.Q) == 0.0), dtype=np.bool_)


def _always(model: System, x: Array, P: Array) -> Array:
    """Return the mean squares of what moves, as large as it always is; of a slope, as it was found."""
    moving, slope = model.a < 1.0, slope_of(model)
    always = model.P0 * np.outer(moving, moving)
    always[slope] = always[:, slope] = 0.0
    always[slope, slope] = x[slope] ** 2 + P[slope, slope]
    return np.asarray(always)


def _power(model: System, always: Array, lam: Array, samples: int) -> Array:
    """Return the spectrum; a line's is that of a walk which gets as far in the record."""
    slope = slope_of(model)
    per_sample = float((np.diag(always) * (1 - model.a) ** 2)[slope].sum())
    return np.asarray(model.spectrum(lam) + per_sample * samples / (4 * np.sin(lam / 2) ** 2))


def _heading_variance(model: System, part: Array, always: Array, P: Array, h: float, times_s: Array) -> Array:
    """Return the mean square of a heading from which `part` of the tracked x is subtracted, by time.

    The angle is row @ x and noise on top. What is subtracted is t part @ E x, so (row - t part) @ x is left
    as large as it always is, and t part @ (x - E x), whose covariance with x is P.
    """
    moving = model.a < 1.0
    found = []
    for t_s, at in zip(times_s.tolist(), aheads(model, h, times_s.tolist()), strict=True):
        known = t_s * part
        rest = np.where(moving, at.row - known, 0.0)
        found.append(rest @ always @ rest + 2 * rest @ P @ known + known @ P @ known + at.variance)
    return np.array(found)


def _spectra(tau_s: Sequence[float], h: float, lam: Array) -> Array:
    """Return a column of the spectrum for N², K², the bias, and each σ²."""
    phi = np.exp(-h / np.array(tau_s))
    states = (1 - phi**2) / (1 - 2 * phi * np.cos(lam)[:, None] + phi**2)
    walk = h / (4 * np.sin(lam / 2) ** 2)
    return np.column_stack([np.full(len(lam), 1 / h), walk, np.zeros(len(lam)), states])


def _headings(tau_s: Sequence[float], h: float, times_s: Array) -> Array:
    """Return a column of the heading's variance for N², K², the bias' variance, and each σ²."""
    tau = np.array(tau_s)
    over = times_s[:, None] / tau
    states = 2 * tau**2 * (over + np.expm1(-over))
    return np.column_stack([times_s, times_s**3 / 3, times_s**2, states])


def _solved(target: _Target, tau_s: Sequence[float], h: float) -> tuple[Array, float]:
    """Return squares of N, K, bias_std and each σ, and the relative error of both curves."""
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
    """Return squares of N, K, bias_std and the σ of those correlation times that matter."""
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
    """Return the same with states that white noise cannot be told from as white noise."""
    for tau in sorted(tau_s):
        at = 3 + tau_s.index(tau)
        if tau > max(FOLDED_S, FOLDED * h) or found[0] / h > LEAST_WHITE * found[at]:
            break
        found[0] += 2 * found[at] * tau
        found, tau_s = np.delete(found, at), [one for one in tau_s if one != tau]
    found[0] = max(found[0], LEAST_OF_ALL * h * float(found[3:].sum()))
    return found, tau_s
