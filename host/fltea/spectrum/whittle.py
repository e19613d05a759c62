"""Whittle fits: spectra fitted to a periodogram by maximum likelihood (Whittle, *Ark. Mat.* 2, 1953).

Ordinates of a stationary series are nearly independent and exponential with the spectrum S for their mean, so

    -log L = sum over ordinates of log S + I / S

of which the best scale of S is known in closed form, mean I / shape, and is not searched for. Everything is
done for several series with the same ordinates at once.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fltea.spectrum.periodogram import Binned
from fltea.spectrum.simplex import Rows, minimise

Array = NDArray[np.float64]

KEPT_STARTS = 3
"""Local maxima are real: α = 0 and α = 1 are the same for a g each."""


class Model(NamedTuple):
    """A family of spectra, in coordinates without bounds in which the likelihood is smooth."""

    name: str
    parameters: int
    """of the spectrum, scale and white noise included, as BIC counts them"""
    starts: Array
    """(starts, p) a grid over the coordinates"""
    groups: NDArray[np.intp]
    """(starts,) the search begins at the best point of each of the best groups"""
    shape: Callable[[Array, Array], Array]
    """λ (bins,) and coordinates (k, p) to S / scale, (k, bins)"""


class Fit(NamedTuple):
    """The best of a model, for each series."""

    model: Model
    theta: Array
    """(series, p) coordinates"""
    scale: Array
    """(series,)"""
    nll: Array
    """(series,) -log L"""

    def spectrum(self, lam: Array) -> Array:
        """The fitted spectra, (series, len(lam))."""
        return self.scale[:, np.newaxis] * self.model.shape(lam, self.theta)


def fit(data: Binned, model: Model, extra_starts: Array | None = None) -> Fit:
    """Fit `model` to every series of `data`.

    extra_starts: (series, k, p) points to begin at too, for instance the best of a model within this one.
    """
    series = len(data.power)
    if model.starts.shape[1] == 0:
        theta = np.zeros((series, 0))
        nll, scale = negative_log_likelihood(data, model.shape(data.lam, theta), np.arange(series))
        return Fit(model, theta, scale, nll)
    starts = _best_starts(data, model)
    if extra_starts is not None:
        starts = np.concatenate([starts, extra_starts], axis=1)
    per_series = starts.shape[1]
    owner = np.repeat(np.arange(series), per_series)

    def objective(theta: Array, rows: Rows) -> Array:
        return negative_log_likelihood(data, model.shape(data.lam, theta), owner[rows])[0]

    points, _ = minimise(objective, starts.reshape(series * per_series, -1))
    # Once more from where they stopped: a simplex can be flat in a direction that matters.
    points, values = minimise(objective, points, size=0.2, tolerance=1e-4)
    best = values.reshape(series, per_series).argmin(axis=1)
    theta = points.reshape(series, per_series, -1)[np.arange(series), best]
    nll, scale = negative_log_likelihood(data, model.shape(data.lam, theta), np.arange(series))
    return Fit(model, theta, scale, nll)


def negative_log_likelihood(
    data: Binned, shape: Array, rows: Rows, scale: ArrayLike | None = None
) -> tuple[Array, Array]:
    """Return -log L of spectra `shape` (k, bins) for the series `rows` (k,), and their scales (k,).

    scale: (k,) where it is given; else the best one.
    """
    ordinates = data.counts.sum()
    ratio = np.einsum("kb,kb,b->k", data.power[rows], 1 / shape, data.counts)
    best = ratio / ordinates if scale is None else np.asarray(scale, dtype=np.float64)
    return np.log(shape) @ data.counts + ordinates * np.log(best) + ratio / best, best


def _best_starts(data: Binned, model: Model) -> Array:
    """The best point of each of the best groups of the grid, (series, at most KEPT_STARTS, p)."""
    shape = model.shape(data.lam, model.starts)
    ordinates = data.counts.sum()
    scale = data.power @ (data.counts / shape).T / ordinates
    nll = np.log(shape) @ data.counts + ordinates * np.log(scale)
    names = np.unique(model.groups)
    best = np.stack(
        [np.flatnonzero(model.groups == name)[nll[:, model.groups == name].argmin(axis=1)] for name in names],
        axis=1,
    )
    order = np.take_along_axis(nll, best, axis=1).argsort(axis=1)[:, :KEPT_STARTS]
    return np.asarray(model.starts[np.take_along_axis(best, order, axis=1)])
