"""Whittle fits by the simplex method in numpy: slow, and sharing only the models with the native ones."""

import numpy as np
from fltea.spectrum.periodogram import Binned
from fltea.spectrum.whittle import Fit, Model, negative_log_likelihood
from numpy.typing import NDArray
from simplex import Rows, minimise

Array = NDArray[np.float64]

KEPT_STARTS = 3
"""Local maxima are real: α = 0 and α = 1 are the same for a g each."""


def slow_fit(data: Binned, model: Model, extra_starts: Array | None = None) -> Fit:
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
