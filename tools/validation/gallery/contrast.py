"""How much any member of a family falls short of the truth, in expected 2 log L (pure).

Of a record whose ordinates have the true spectrum S, a model M is on average 2 Σ (log(M / S) + S / M - 1)
worse in 2 log L than the truth: no fit of that family can do better than its least, but for chance. It says
what a record can tell at all. Searches are by grids that shrink around their best; nothing is shared with
the fits.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Family = Callable[[Array, Array], Array]
"""Of parameters (k, count) and λ (bins,): spectra (count, bins)."""

BINS = 160
FIRST = 10
"""The lowest ordinate that is fitted: of fewer periods nobody can say what they are."""
DEEPEST = 1e-6
"""Of the highest density: a filter's zeros are no deeper in any periodogram."""
ROUNDS = 12
SHRINK = 0.4
UPDATES = 400
LEAST_MOVE, LEAST_GAIN = 0.05, 0.05
"""Of the logarithm of a corner, and in 2 log L: from there on the search is over."""
FLOOR = -3.0
"""Logarithm of the largest white noise behind a low-pass, over what passes."""


class Bins(NamedTuple):
    """Ordinates from the `FIRST` to half the rate, in bins."""

    lam: Array
    weight: Array
    """ordinates in each"""
    truth: Array


def bins_of(spectrum: Callable[[Array], Array], n: int, around: Sequence[tuple[float, float]] = ()) -> Bins:
    """The bins of a record of n samples; around: frequencies and widths, in rad, where they are fine."""
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
    """The bins up to λ."""
    keep = bins.lam < lam
    return Bins(bins.lam[keep], bins.weight[keep], bins.truth[keep])


def shortfall(bins: Bins, models: Array) -> Array:
    """Expected 2 log L that models (count, bins) are behind the truth, each at its best size: (count,)."""
    ratio = bins.truth / models
    total = bins.weight.sum()
    size = ratio @ bins.weight / total
    return np.asarray(2 * (total * np.log(size) - np.log(ratio) @ bins.weight))


def least(bins: Bins, family: Family, box: Sequence[tuple[float, float]], points: int = 11) -> float:
    """The least shortfall of a family over a box of its parameters."""
    lows, highs = (np.array(side, dtype=float) for side in zip(*box, strict=True))
    low, high, best = lows, highs, np.inf
    for _ in range(ROUNDS):
        axes = [np.linspace(a, b, points) for a, b in zip(low, high, strict=True)]
        parameters = np.stack([one.ravel() for one in np.meshgrid(*axes, indexing="ij")])
        found = shortfall(bins, family(parameters, bins.lam))
        at = int(np.argmin(found))
        best = min(best, float(found[at]))
        half = SHRINK * (high - low) / 2
        low = np.maximum(lows, parameters[:, at] - half)
        high = np.minimum(highs, parameters[:, at] + half)
    return best


def white(bins: Bins) -> float:
    """White noise."""
    return float(shortfall(bins, np.ones((1, len(bins.lam))))[0])


def order(bins: Bins) -> float:
    """A fractional order of 0.15 to 0.85 in white noise: the state D^α x = f x + ω, or ARFIMA(1, d, 0)."""
    return min(least(bins, _state, _STATE_BOX), least(bins, _arfima, _ARFIMA_BOX))


def one_relaxation(bins: Bins) -> float:
    """AR(1) in white noise."""
    return least(bins, _one_relaxation, ((-7.0, 2.0), (-8.0, 10.0)), 31)


def walk(bins: Bins) -> float:
    """A random walk in white noise."""
    return least(bins, _walk, ((-14.0, 14.0),), 91)


def walk_and_relaxation(bins: Bins) -> float:
    """A random walk and one relaxation, in white noise."""
    return least(bins, _walk_and_relaxation, ((-14.0, 14.0), (-7.0, 2.0), (-8.0, 10.0)), 15)


def low_pass(bins: Bins) -> float:
    """A low-pass of one to eight poles on white noise, with next to no white noise behind it."""
    return least(bins, _low_pass, ((-5.0, 1.2), (1.0, 8.0), (-12.0, FLOOR)), 13)


def rising(bins: Bins) -> float:
    """A power of the frequency up to its fourth, in white noise."""
    return least(bins, _rising, ((0.0, 2.0), (-6.0, 6.0)), 31)


def six_relaxations(bins: Bins) -> float:
    """Six relaxations of any corners and sizes, in white noise.

    They begin evenly apart on the logarithmic axis; then each moves as long as that helps. Sizes are found by
    multiplicative updates, which go on from the last answer.
    """
    bottom, top = float(np.log(bins.lam[0])), float(np.log(np.pi))
    starts = [(low, high) for low in (bottom - 2, bottom, bottom + 2) for high in (top - 2, top, top + 1.5)]
    corners = np.array([np.linspace(low, max(high, low + 0.5), 6) for low, high in starts])
    sizes = np.full((len(corners), 7, 1), float(np.median(bins.truth)) / 7)
    found, sizes = _mixed(bins, corners, sizes, UPDATES)
    at = int(np.argmin(found))
    best, corner, size, step = float(found[at]), corners[at], sizes[at], 0.6
    moves = np.concatenate([np.eye(6), -np.eye(6), np.ones((1, 6)), -np.ones((1, 6)), np.zeros((1, 6))])
    while step > LEAST_MOVE:
        corners = corner + step * moves
        found, sizes = _mixed(bins, corners, np.repeat(size[np.newaxis], len(moves), axis=0), UPDATES // 2)
        at = int(np.argmin(found))
        if best - found[at] < LEAST_GAIN:
            step /= 2
        if found[at] < best:
            best, corner, size = float(found[at]), corners[at], sizes[at]
    return best


def _mixed(bins: Bins, log_corners: Array, size: Array, updates: int) -> tuple[Array, Array]:
    """Relaxations of these corners (count, 6), each of the size that is best: shortfalls and sizes."""
    poles = np.exp(-np.exp(log_corners))[..., np.newaxis]
    shapes = _scaled(1 / ((1 - poles) ** 2 + 4 * poles * np.sin(bins.lam / 2) ** 2))
    shapes = np.concatenate([np.ones_like(shapes[:, :1]), shapes], axis=1)
    across = np.swapaxes(shapes, 1, 2)
    rows = np.swapaxes(size, 1, 2)
    for _ in range(updates):
        model = rows @ shapes
        rows = rows * ((bins.weight * bins.truth / model**2) @ across) / ((bins.weight / model) @ across)
    return shortfall(bins, (rows @ shapes)[:, 0]), np.swapaxes(rows, 1, 2)


def _with_floor(shape: Array, log_floor: Array) -> Array:
    """log_floor: of white noise over the shape's own size."""
    return np.asarray(shape + np.exp(log_floor)[:, np.newaxis])


def _scaled(shape: Array) -> Array:
    return np.asarray(shape / np.exp(np.log(shape).mean(axis=-1, keepdims=True)))


_STATE_BOX = ((0.15, 0.85), (-9.0, 0.5), (-8.0, 10.0))


def _state(p: Array, lam: Array) -> Array:
    alpha, g = p[0][:, np.newaxis], -np.exp(p[1])[:, np.newaxis]
    g = np.maximum(g, -0.98 * 2**alpha)
    z = np.exp(-1j * lam)
    return _with_floor(_scaled(1 / np.abs((1 - z) ** alpha - g * z) ** 2), p[2])


_ARFIMA_BOX = ((0.15, 0.85), (-7.0, 1.5), (-8.0, 10.0))


def _arfima(p: Array, lam: Array) -> Array:
    phi = np.exp(-np.exp(p[1]))[:, np.newaxis]
    shape = (2 * np.sin(lam / 2)) ** (-2 * p[0][:, np.newaxis])
    return _with_floor(_scaled(shape / ((1 - phi) ** 2 + 4 * phi * np.sin(lam / 2) ** 2)), p[2])


def _one_relaxation(p: Array, lam: Array) -> Array:
    phi = np.exp(-np.exp(p[0]))[:, np.newaxis]
    return _with_floor(_scaled(1 / ((1 - phi) ** 2 + 4 * phi * np.sin(lam / 2) ** 2)), p[1])


def _walk(p: Array, lam: Array) -> Array:
    shape = 1 / (4 * np.sin(lam / 2) ** 2)
    return _with_floor(_scaled(np.repeat(shape[np.newaxis], p.shape[1], axis=0)), p[0])


def _low_pass(p: Array, lam: Array) -> Array:
    x = (2 * np.sin(lam / 2)) ** 2 / np.exp(2 * p[0])[:, np.newaxis]
    return _with_floor(1 / (1 + x ** p[1][:, np.newaxis]), p[2])


def _walk_and_relaxation(p: Array, lam: Array) -> Array:
    walk = _scaled(1 / (4 * np.sin(lam / 2) ** 2))
    phi = np.exp(-np.exp(p[1]))[:, np.newaxis]
    relaxation = _scaled(1 / ((1 - phi) ** 2 + 4 * phi * np.sin(lam / 2) ** 2))
    return np.asarray(np.exp(-p[0])[:, np.newaxis] * walk + np.exp(-p[2])[:, np.newaxis] * relaxation + 1)


def _rising(p: Array, lam: Array) -> Array:
    return _with_floor((2 * np.sin(lam / 2)) ** (2 * p[0][:, np.newaxis]), p[1])
