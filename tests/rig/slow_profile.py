"""Intervals of the fractional model's parameters by profile likelihood (pure).

A value belongs to the interval if the best fit that has it is at most 3.84 in 2 log L below the best of all
(95 % of χ² with one degree), or `AT_BOUND` where that fit has no white noise. Unlike the curvature at the
maximum this also holds at R = 0 and where α and g cannot be told apart; there the interval takes in nearly
all that is possible, and the parameter is undefined.
"""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np
from fltea.noise import spectra as spectrum
from fltea.spectrum.models import FULL, TINY, UP_TO_ONE, coordinates, parameters, share
from fltea.spectrum.periodogram import Binned
from fltea.spectrum.profile import FractionalFit, Parameter
from fltea.spectrum.whittle import Fit, negative_log_likelihood
from numpy.typing import NDArray
from simplex import Rows, minimise
from slow_fit import slow_fit

Array = NDArray[np.float64]

CRITICAL = 3.841
"""95 % point of χ² with one degree of freedom."""
AT_BOUND = {"alpha": 4.8, "g": 4.6, "f": 4.6, "F": 5.1, "s2": 5.1, "R": CRITICAL}
"""The same where the best fit that has the value has no white noise."""
APART = 6.0
"""In 2 log L, up to which an order above 1 may be chance."""
NO_WHITE = 1e-3
"""R over s2: less is none."""
NEARLY_ALL = 0.9
"""Share of the possible range from which on a parameter is undefined."""
HALVINGS = 7
"""The likelihood is looked at 1/2, 1/4, ... of the possible range away from the best value, on both sides."""
LOWEST = 1e-6
"""Positive parameters are searched for from here on, in units of the largest possible; less is 0."""
REFINEMENTS, PARTS = 2, 5
"""Then the stretches that hold the ends are divided."""
ROUNDS = 2
"""Of fits along a profile: once from afar, then from the neighbours' ends."""
NOT_POSSIBLE = 1e15
"""In place of -log L where there is no such spectrum."""


class _Profile(NamedTuple):
    """How a parameter t is held while the others are fitted.

    `build` takes values of t (k,) and free coordinates (k, free), and returns coordinates of the model
    (k, 3), scales (k,) or None for the best ones, and whether there is such a spectrum (k,).
    """

    name: str
    build: Callable[[Array, Array], tuple[Array, Array | None, NDArray[np.bool_]]]
    best: Array
    """(free,) free coordinates of the best fit of all"""
    axes: tuple[Array, ...]
    """a grid of free coordinates: the search begins at its best point too"""
    low: float
    high: float
    """what is possible"""
    chance: float
    """by how much an order up to 1 is worse, where that is no reason to leave it out"""
    positive: bool = False
    """searched for in its logarithm"""


_ORDERS = np.array([0.05, 0.3, 0.6, 0.95, 1.3, 1.8])
_FEEDBACKS = np.array([-9.0, -6.0, -4.0, -2.0, 0.0, 3.0])
_WEIGHTS = np.array([-7.0, -3.0, -1.0, 1.0, 4.0])
_VARIANCES = np.log(np.array([1e-6, 1e-3, 0.02, 0.15, 0.5]))
"""In units of the power."""


def slow_intervals(data: Binned, found: Fit, h: float, *, white: bool = False) -> FractionalFit:
    """Profile the one series of `data`, whose fit of the model FULL is `found`; h in s.

    white: the null test does not reject white noise, in which none of the parameters is defined.
    """
    theta, p = found.theta[0], parameters(found.theta[0])
    alpha, g, weight, scale = float(p.alpha), float(p.g), float(p.weight), float(found.scale[0])
    f, s2, R = spectrum.f_of(alpha, g, h), weight * scale, (1 - weight) * scale
    power = float(data.power[0] @ data.counts / data.counts.sum())

    chance = _chance(data, found)

    def interval(value: float, profile: _Profile) -> Parameter:
        return Parameter(value, None, None) if white else _interval(data, found, value, profile)

    def by_g(
        name: str, g_of: Callable[[Array, Array], Array], low: float, high: float, positive: bool
    ) -> _Profile:
        return _Profile(name, _with_g(g_of), theta[[0, 2]], (_ORDERS, _WEIGHTS), low, high, chance, positive)

    def variance(name: str, value: float, other: float, hold: _Hold) -> Parameter:
        best = np.array([*theta[:2], np.log(other)])
        axes = _ORDERS[1::2], _FEEDBACKS[::2], _VARIANCES + np.log(power)
        return interval(value, _Profile(name, hold, best, axes, 0.0, 2 * power, chance, True))

    highest = spectrum.HIGHEST_ORDER - 1e-4
    orders = _Profile("alpha", _hold_order, theta[1:], (_FEEDBACKS, _WEIGHTS), 0.0, highest, 0.0)
    order = interval(alpha, orders)
    minus_g = interval(-g, by_g("g", lambda t, a: -t, 0.0, 4.0, True))
    minus_f = interval(-f, by_g("f", lambda t, a: -t * h**a, 0.0, 4 * max(1.0, h**-2), True))
    told_apart = order.defined and minus_g.defined
    return FractionalFit(
        F=interval(g + alpha, by_g("F", lambda t, a: t - a, -2.0, 2.0, False)),  # α - 2^α < F < α
        alpha=order,
        g=_negative(minus_g),
        f=_negative(minus_f) if told_apart else Parameter(f, None, None),
        s2=variance("s2", s2, R, _hold_state),
        R=variance("R", R, s2, _hold_white),
        Q=spectrum.noise_variance(alpha, s2, h),
    )


def _chance(data: Binned, found: Fit) -> float:
    if float(parameters(found.theta[0]).alpha) <= 1:
        return 0.0
    other = slow_fit(data, UP_TO_ONE)
    if float(parameters(other.theta[0]).alpha) > 0.999:
        return 0.0
    below = 2 * float(other.nll[0] - found.nll[0])
    return below if 0 < below <= APART else 0.0


_Hold = Callable[[Array, Array], tuple[Array, Array | None, NDArray[np.bool_]]]


def _with_g(g_of: Callable[[Array, Array], Array]) -> _Hold:
    """Of t and α to g; free are α and the weight."""

    def build(t: Array, free: Array) -> tuple[Array, None, NDArray[np.bool_]]:
        alpha = parameters(np.column_stack([free[:, 0], free])).alpha
        g = g_of(t, alpha)
        # g = 0 stands for any smaller than the record can tell from it.
        exists = (g <= 0) & spectrum.stationary(alpha, np.minimum(g, -TINY))
        return coordinates(alpha, g, share(free[:, 1])), None, exists

    return build


def _hold_order(t: Array, free: Array) -> tuple[Array, None, NDArray[np.bool_]]:
    return np.column_stack([t, free]), None, np.ones(len(t), dtype=bool)


def _hold_state(t: Array, free: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Of s2; the last free coordinate is the logarithm of R."""
    theta = np.column_stack([free[:, :2], np.log(t) - free[:, 2]])
    return theta, t + np.exp(np.minimum(free[:, 2], 100)), np.ones(len(t), dtype=bool)


def _hold_white(t: Array, free: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Of R; the last free coordinate is the logarithm of s2."""
    theta = np.column_stack([free[:, :2], free[:, 2] - np.log(t)])
    return theta, t + np.exp(np.minimum(free[:, 2], 100)), np.ones(len(t), dtype=bool)


def _interval(data: Binned, found: Fit, value: float, profile: _Profile) -> Parameter:
    low, high = profile.low, profile.high
    if profile.positive:
        low, high = np.log(LOWEST * high), np.log(high)
    here = float(np.clip(np.log(max(value, 1e-300)) if profile.positive else value, low, high))
    steps = (high - low) * 0.5 ** np.arange(HALVINGS + 1)
    values = np.unique(np.clip(np.concatenate([[low, here, high], here - steps, here + steps]), low, high))
    deviance = 2 * (_held(data, found, values, profile) - found.nll[0])
    for _ in range(REFINEMENTS):
        ends = _ends(values, deviance, here)
        between = [np.linspace(values[a], values[b], PARTS + 1)[1:-1] for a, b in ends if a != b]
        if not between:
            break
        more = np.sort(np.concatenate(between))
        values = np.concatenate([values, more])
        deviance = np.concatenate([deviance, 2 * (_held(data, found, more, profile) - found.nll[0])])
        order = values.argsort()
        values, deviance = values[order], deviance[order]
    limits = [_crossing(values, deviance, *pair) for pair in _ends(values, deviance, here)]
    if profile.positive:
        limits = [0.0 if limit <= low else float(np.exp(limit)) for limit in limits]
    if limits[1] - limits[0] >= NEARLY_ALL * (profile.high - profile.low) / (2 if profile.positive else 1):
        return Parameter(value, None, None)
    return Parameter(value, min(limits[0], value), max(limits[1], value))


def _ends(values: Array, deviance: Array, here: float) -> tuple[tuple[int, int], tuple[int, int]]:
    """For both ends the last value inside and the first outside, which are the same at what is possible."""
    at = int(np.searchsorted(values, here))
    inside = np.append(np.flatnonzero(deviance <= CRITICAL), at)
    first, last = int(inside.min()), int(inside.max())
    return (first, max(first - 1, 0)), (last, min(last + 1, len(values) - 1))


def _crossing(values: Array, deviance: Array, inner: int, outer: int) -> float:
    """Where the deviance is critical: between the two its square root is nearly straight."""
    if inner == outer:
        return float(values[inner])
    a, b = (np.sqrt(np.clip(deviance[i], 0.0, 1e6)) for i in (inner, outer))
    return float(values[inner] + (np.sqrt(CRITICAL) - a) / (b - a) * (values[outer] - values[inner]))


def _held(data: Binned, found: Fit, values: Array, profile: _Profile) -> Array:
    """-log L of the best fits that have these values of the parameter (in its logarithm if positive).

    It is less by what the critical value is more there than 3.84. values: rising. Each
    fit is tried again from where its neighbours have ended.
    """
    t = np.exp(values) if profile.positive else values
    k, free = len(t), len(profile.axes)
    grid = np.stack([axis.ravel() for axis in np.meshgrid(*profile.axes, indexing="ij")], axis=-1)

    def nll(points: Array, owner: Rows) -> Array:
        theta, scale, exists = profile.build(t[owner], points)
        only = np.zeros(len(points), dtype=np.intp)
        value, _ = negative_log_likelihood(data, FULL.shape(data.lam, theta), only, scale)
        return np.where(exists, value, NOT_POSSIBLE)

    on_grid = nll(np.tile(grid, (k, 1)), np.repeat(np.arange(k), len(grid))).reshape(k, -1)
    starts = np.stack([grid[on_grid.argmin(axis=1)], np.tile(profile.best, (k, 1))], axis=1)
    for _ in range(ROUNDS):
        each = starts.shape[1]
        owner = np.repeat(np.arange(k), each)
        points, ends = minimise(
            partial(_of_owner, nll, owner), starts.reshape(-1, free), tolerance=1e-2, steps=50
        )
        ends = ends.reshape(k, each)
        best = points.reshape(k, each, free)[np.arange(k), ends.argmin(axis=1)]
        starts = np.stack([best, np.roll(best, 1, axis=0), np.roll(best, -1, axis=0)], axis=1)
    theta, _, _ = profile.build(t, best)
    # R that is held is not a bound that was met.
    at_bound = np.exp(-theta[:, 2]) < NO_WHITE
    more = profile.chance + at_bound * (AT_BOUND[profile.name] - CRITICAL)
    return np.asarray(ends.min(axis=1) - more / 2)


def _of_owner(nll: Callable[[Array, Rows], Array], owner: Rows, points: Array, rows: Rows) -> Array:
    return nll(points, owner[rows])


def _negative(p: Parameter) -> Parameter:
    """Of -p to p."""
    if p.low is None or p.high is None:
        return Parameter(-p.value, None, None)
    return Parameter(-p.value, -p.high, -p.low)
