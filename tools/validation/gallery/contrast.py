"""Computes how well the best model of a family can describe a known noise.

A family is a set of models with free parameters. Each model has a spectrum M; the true spectrum of the noise
is S. In a fit, 2 log L (L: likelihood) is on average smaller for M than for S by 2 Σ (log(M / S) + S / M -
1), where the sum is over all frequencies of the periodogram. This is the model's shortfall. A record
can exclude the family only if even the smallest shortfall in the family is larger than what chance can do.
scipy finds this minimum. No code is shared with the fits.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from fltea.records.arrays import Array
from scipy.ndimage import minimum_filter
from scipy.optimize import Bounds, least_squares, minimize

Family = Callable[[Array, Array], Array]
"""A family of models, as a function that returns the spectra of models. Its arguments are `count` sets of k
parameters, of shape (k, count), and the frequencies λ (bins,). The spectra have the shape (count, bins).
"""
Nearest = Callable[["Bins"], float]
"""A function for one family of models. For a record with the given bins, it returns how much smaller 2 log L
(L: likelihood) is for the best model of the family than for the true spectrum.
"""

BINS = 160
FIRST = 10
"""The lowest frequency that is fitted has this number of periods in the record. Lower frequencies of the
periodogram say too little about a model.
"""
DEEPEST = 1e-6
"""Lowest density of a true spectrum, divided by its highest density. Lower densities are raised to this one.
A periodogram does not show lower densities either, not even where a filter stops everything.
"""
FLOOR = -3.0
"""In the family `low_pass`, white noise is added after the filter. Its density is at most exp(FLOOR) times
the density that passes the filter at low frequencies.
"""
POINTS, MOST_POINTS, STARTS = 15, 3_400, 6
"""The shortfall is first computed on a grid of parameters. POINTS: number of values of each parameter, or
fewer, so that the grid has at most MOST_POINTS points. STARTS: a search begins at each of the STARTS points
with the smallest shortfalls, and at each of the STARTS lowest local minima.
"""
RELAXATIONS = 6


class Bins(NamedTuple):
    """The ordinates of a record's spectrum from number `FIRST` to half the sample rate, joined in bins."""

    lam: Array
    weight: Array
    """Number of ordinates in each bin."""
    truth: Array


def bins_of(spectrum: Callable[[Array], Array], n: int, around: Sequence[tuple[float, float]] = ()) -> Bins:
    """Return the bins of a record of `n` samples.

    `around`: frequencies and widths [rad] of peaks and notches, around which the bins are finely spaced.
    """
    last = (n - 1) // 2
    edges = np.unique(np.round(np.geomspace(FIRST, last + 1, BINS)).astype(int))
    for at, width in around:
        fine = np.linspace(at - 6 * width, at + 6 * width, 121) * n / (2 * np.pi)
        edges = np.unique(np.concatenate([edges, fine.round().astype(int)]))
    edges = edges[(edges >= FIRST) & (edges <= last + 1)]
    lam = np.pi * (edges[:-1] + edges[1:] - 1) / n
    truth = spectrum(lam)
    return Bins(lam, np.diff(edges).astype(float), np.maximum(truth, DEEPEST * truth.max()))


def below(bins: Bins, lam: float) -> Bins:
    """Return the bins whose frequency is below `lam` [rad per sample]."""
    keep = bins.lam < lam
    return Bins(bins.lam[keep], bins.weight[keep], bins.truth[keep])


def shortfall(bins: Bins, models: Array) -> Array:
    """Return each model's shortfall: how much smaller its expected 2 log L is than that of the truth.

    `models`: spectra (count, bins).

    Each model is multiplied by the factor with which it fits best.
    """
    ratio = bins.truth / models
    total = bins.weight.sum()
    size = ratio @ bins.weight / total
    return np.asarray(2 * (total * np.log(size) - np.log(ratio) @ bins.weight))


def least(bins: Bins, family: Family, *box: tuple[float, float]) -> float:
    """Return the smallest shortfall in a family of models (see `shortfall`).

    `box`: the range of each parameter.

    Shortfalls are computed on a grid of parameters. Searches begin where they are smallest, and at the local
    minima of the grid.
    """
    points = min(POINTS, int(MOST_POINTS ** (1 / len(box))))
    grid = np.stack(np.meshgrid(*(np.linspace(*side, points) for side in box), indexing="ij"))
    flat = grid.reshape(len(box), -1)
    found = shortfall(bins, family(flat, bins.lam))

    def behind(p: Array) -> float:
        return float(shortfall(bins, family(p[:, np.newaxis], bins.lam))[0])

    def apart(p: Array) -> Array:
        logs = np.log(bins.truth / family(p[:, np.newaxis], bins.lam)[0])
        return np.asarray(np.sqrt(bins.weight) * (logs - logs @ bins.weight / bins.weight.sum()))

    around = minimum_filter(found.reshape(grid.shape[1:]), size=3, mode="nearest").ravel()
    valleys = np.flatnonzero(found == around)
    ends = []
    for at in {*valleys[np.argsort(found[valleys])[:STARTS]].tolist(), *np.argsort(found)[:STARTS].tolist()}:
        # Near the true spectrum, the shortfall is about a sum of squares, and its minimum lies in a narrow
        # valley. L-BFGS-B alone would get stuck there. A least-squares search therefore goes first.
        near = least_squares(apart, flat[:, at], bounds=np.transpose(box), x_scale="jac", max_nfev=200).x
        ends.append(minimize(behind, near, method="L-BFGS-B", bounds=box).fun)
    return float(min(ends))


def _with_floor(shape: Array, log_floor: Array) -> Array:
    """Add white noise to spectra.

    `log_floor`: for each spectrum, the logarithm of the white noise's density, in the unit of the spectrum.
    """
    return np.asarray(shape + np.exp(log_floor)[:, np.newaxis])


def _scaled(shape: Array) -> Array:
    return np.asarray(shape / np.exp(np.log(shape).mean(axis=-1, keepdims=True)))


def _ar1(log_corner: Array, lam: Array) -> Array:
    phi = np.exp(-np.exp(log_corner))[:, np.newaxis]
    return np.asarray(1 / ((1 - phi) ** 2 + 4 * phi * np.sin(lam / 2) ** 2))


def _state(p: Array, lam: Array) -> Array:
    alpha, g = p[0][:, np.newaxis], -np.exp(p[1])[:, np.newaxis]
    g = np.maximum(g, -0.98 * 2**alpha)
    z = np.exp(-1j * lam)
    return _with_floor(_scaled(1 / np.abs((1 - z) ** alpha - g * z) ** 2), p[2])


def _arfima(p: Array, lam: Array) -> Array:
    return _with_floor(_scaled((2 * np.sin(lam / 2)) ** (-2 * p[0][:, np.newaxis]) * _ar1(p[1], lam)), p[2])


def _walk(p: Array, lam: Array) -> Array:
    return _with_floor(_scaled(1 / (4 * np.sin(lam / 2) ** 2)), p[0])


def _rise(log_size: Array, delta: Array, lam: Array) -> Array:
    return np.asarray(np.exp(log_size)[:, np.newaxis] * np.sin(lam / 2) ** (2 * delta[:, np.newaxis]))


def _low_pass(p: Array, lam: Array) -> Array:
    x = (2 * np.sin(lam / 2)) ** 2 / np.exp(2 * p[0])[:, np.newaxis]
    return _with_floor(1 / (1 + x ** p[1][:, np.newaxis]), p[2])


def _high_passed_order(p: Array, lam: Array) -> Array:
    x = np.exp(2 * p[3])[:, np.newaxis] / (2 * np.sin(lam / 2)) ** 2
    return np.asarray(_state(p, lam) / (1 + x ** p[4][:, np.newaxis]))


def _walk_and_relaxation(p: Array, lam: Array) -> Array:
    walk, relaxation = _scaled(1 / (4 * np.sin(lam / 2) ** 2)), _scaled(_ar1(p[1], lam))
    return np.asarray(np.exp(-p[0])[:, np.newaxis] * walk + np.exp(-p[2])[:, np.newaxis] * relaxation + 1)


def _nearest(family: Family, *box: tuple[float, float]) -> Nearest:
    return lambda bins: least(bins, family, *box)


ORDERS, RATES, WHITE, RISES = (0.15, 0.85), (-9.0, 0.5), (-14.0, 10.0), ((-10.0, 10.0), (0.1, 2.0))
CORNERS, SIZES, WALKS = (-7.0, 2.0), (-8.0, 10.0), (-14.0, 14.0)

state = _nearest(_state, ORDERS, RATES, WHITE)
"""Returns how much less 2 log L (L: likelihood) is for the best of these models than for the true spectrum:
D^α x = f x + ω, with an order α of 0.15 to 0.85, in white noise.
"""
arfima = _nearest(_arfima, ORDERS, (-7.0, 1.5), WHITE)
"""Returns how much less 2 log L (L: likelihood) is for the best of these models than for the true spectrum:
ARFIMA(1, d, 0), with an order d of 0.15 to 0.85, in white noise.
"""
order_and_rise = _nearest(
    lambda p, lam: _state(p, lam) + _rise(p[3], p[4], lam), ORDERS, RATES, WHITE, *RISES
)
"""Returns how much less 2 log L (L: likelihood) is for the best of these models than for the true spectrum:
D^α x = f x + ω plus noise whose density rises with at most the 4th power of frequency, in white noise.
"""
high_passed_order = _nearest(_high_passed_order, ORDERS, RATES, WHITE, CORNERS, (1.0, 3.0))
"""Returns how much less 2 log L (L: likelihood) is for the best of these models than for the true spectrum:
D^α x = f x + ω in white noise, after a high-pass of one to three poles.
"""
one_relaxation = _nearest(lambda p, lam: _with_floor(_scaled(_ar1(p[0], lam)), p[1]), CORNERS, SIZES)
"""Returns how much less 2 log L (L: likelihood) is for the best of these models than for the true spectrum:
one relaxation (AR(1)) in white noise.
"""
walk = _nearest(_walk, WALKS)
"""Returns how much less 2 log L (L: likelihood) is for the best of these models than for the true spectrum:
a random walk in white noise.
"""
walk_and_rise = _nearest(lambda p, lam: _walk(p, lam) + _rise(p[1], p[2], lam), WALKS, *RISES)
"""Returns how much less 2 log L (L: likelihood) is for the best of these models than for the true spectrum:
a random walk plus noise whose density rises with at most the 4th power of frequency, in white noise.
"""
walk_and_relaxation = _nearest(_walk_and_relaxation, WALKS, CORNERS, SIZES)
"""Returns how much less 2 log L (L: likelihood) is for the best of these models than for the true spectrum:
a random walk and one relaxation, in white noise.
"""
low_pass = _nearest(_low_pass, (-5.0, 1.2), (1.0, 8.0), (-12.0, FLOOR))
"""Returns how much less 2 log L (L: likelihood) is for the best of these models than for the true spectrum:
white noise after a low-pass of one to eight poles, plus a little white noise that does not pass the filter.
"""
rising = _nearest(
    lambda p, lam: _with_floor((2 * np.sin(lam / 2)) ** (2 * p[0][:, np.newaxis]), p[1]),
    (0.0, 2.0),
    (-6.0, 6.0),
)
"""Returns how much less 2 log L (L: likelihood) is for the best of these models than for the true spectrum:
noise whose density rises with at most the 4th power of frequency, in white noise.
"""


def white(bins: Bins) -> float:
    """Return how much less 2 log L (L: likelihood) is for white noise than for the truth in `bins`."""
    return float(shortfall(bins, np.ones((1, len(bins.lam))))[0])


def order(bins: Bins) -> float:
    """Return how much less 2 log L (L: likelihood) is for the best model with an order than for the truth.

    The models are the fractional state (`state`) and ARFIMA (`arfima`). The truth is the spectrum in `bins`.
    """
    return min(state(bins), arfima(bins))


def without_order(bins: Bins) -> float:
    """Return how much less 2 log L (L: likelihood) is for the best sum of parts than for the true spectrum.

    None of the parts has a fractional order.

    The parts are six relaxations (first-order Gauss-Markov processes), one relaxation that alternates in
    sign, a random walk, quantisation and white noise. The parts can have any sizes. Each search starts with
    corners whose logarithms are evenly spaced.
    """
    bottom, top = float(np.log(bins.lam[0])), float(np.log(np.pi))
    starts = [(low, high) for low in (bottom - 2, bottom, bottom + 2) for high in (top - 2, top, top + 1.5)]
    return min(_mixed(bins, np.linspace(low, max(high, low + 0.5), RELAXATIONS)) for low, high in starts)


def _mixed(bins: Bins, log_corners: Array) -> float:
    """Search the best sum of parts without an order, from one starting point; see `without_order`.

    `log_corners`: logarithms of the relaxations' corners at the start of the search.
    """
    half = 4 * np.sin(bins.lam / 2) ** 2
    # the last relaxation alternates in sign, so its spectrum is mirrored: it is largest at half the sample
    # rate
    halves = np.stack([half] * RELAXATIONS + [4 - half])
    fixed = np.stack([1 / half, half, np.ones_like(half)])
    poles = len(halves)

    def behind(p: Array) -> tuple[float, Array]:
        """Return the shortfall of a model, and its derivatives by the parameters `p` (see `shortfall`).

        The parameters are the logarithms of the relaxations' corners and of the sizes of all parts.
        """
        corner = np.exp(p[:poles, np.newaxis])
        pole, rest = np.exp(-corner), -np.expm1(-corner)
        below = rest**2 + pole * halves
        parts = np.exp(p[poles:, np.newaxis]) * np.concatenate([rest**2 / below, fixed])
        model = parts.sum(axis=0)
        slope = 2 * bins.weight * (model - bins.truth) / model**2
        by_pole = -2 / rest - (halves - 2 * rest) / below
        of_corners = parts[:poles] * by_pole * -corner * pole
        value = 2 * bins.weight @ (np.log(model / bins.truth) + bins.truth / model - 1)
        return float(value), np.concatenate([of_corners @ slope, parts @ slope])

    level = np.log(np.median(bins.truth) / (RELAXATIONS + 1))
    sizes = np.full(poles + len(fixed), level)
    # At the start of the search, three parts are small: the relaxation that alternates in sign, the random
    # walk, and the quantisation, whose density rises with frequency.
    sizes[-len(fixed) - 1 : -1] = level - 5
    sizes[-len(fixed)] += 2 * np.log(bins.lam[0])
    start = np.concatenate([log_corners, [0.0], sizes])
    limits = Bounds(start - 25, np.concatenate([np.full(poles, 3.0), np.full(len(sizes), 40.0)]))
    found = minimize(
        behind,
        start,
        jac=True,
        method="L-BFGS-B",
        bounds=limits,
        options={"maxiter": 5000, "maxfun": 20000, "maxcor": 30, "ftol": 1e-13},
    )
    return float(found.fun)
