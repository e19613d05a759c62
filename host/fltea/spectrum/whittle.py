"""Whittle fits: spectra fitted to a periodogram by maximum likelihood (Whittle, *Ark. Mat.* 2, 1953).

Ordinates of a stationary series are nearly independent and exponential with the spectrum S for their mean, so

    -log L = sum over ordinates of log S + I / S

of which the best scale of S is known in closed form, mean I / shape, and is not searched for. The other
parameters are found by Fisher scoring with Levenberg's damping
(firmware/core/engine/whittle_scoring.hpp), for several series with the same ordinates at once.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fltea import _native
from fltea.spectrum.periodogram import Binned

Array = NDArray[np.float64]

_FAMILIES = (
    *("white", "fractional", "ar1", "ar2", "two_ar1", "three_ar1", "four_ar1", "five_ar1", "six_ar1"),
    *("low_pass", "low_pass_ar1", "low_pass_two_ar1", "arfima", "rising"),
)
FAMILIES = {name: number for number, name in enumerate(_FAMILIES)}
"""Numbers of the models in the native part (enum Family)."""


HOLDS = {"": 0, "alpha": 1, "g": 2, "f": 3, "F": 4, "s2": 5, "R": 6}
"""Numbers of what is held in the native part (enum Hold)."""


class Held(NamedTuple):
    """A number of the fractional model that keeps its value."""

    name: str = ""
    """One of `HOLDS`."""
    value: float = 0.0
    h: float = 1.0
    """Sampling period in s, where f is held."""


class Model(NamedTuple):
    """A family of spectra, in coordinates without bounds in which the likelihood is smooth."""

    name: str
    """One of `FAMILIES`."""
    parameters: int
    """The number of the spectrum's parameters with scale and white noise, as BIC counts them."""
    starts: Array
    """A grid of starts over the coordinates, (starts, p)."""
    groups: NDArray[np.intp]
    """The group of each start (starts,); the search begins at the best point of each of the best groups."""
    shape: Callable[[Array, Array], Array]
    """λ (bins,) and coordinates (k, p) to S / scale, (k, bins)."""
    highest_order: float = 2.0
    """The highest order of the fractional model."""
    held: Held = Held()
    always: Array | None = None
    """Points (k, p) at which the search begins whatever the grid says."""


class Fit(NamedTuple):
    """The best of a model, for each series."""

    model: Model
    theta: Array
    """The coordinates, (series, p)."""
    scale: Array
    """The scale of each series, (series,)."""
    nll: Array
    """The value of -log L, (series,)."""

    def spectrum(self, lam: Array) -> Array:
        """Return the fitted spectra, (series, len(lam))."""
        return self.scale[:, np.newaxis] * self.model.shape(lam, self.theta)


def fit(data: Binned, model: Model, extra_starts: Array | None = None, warm: Array | None = None) -> Fit:
    """Fit `model` to every series of `data`.

    extra_starts: (series, k, p) points to begin at too, for instance the best of a model within this one.
    warm: (series, p) where the search begins instead of on the grid; it ends after at most ten steps.

    Raises:
        ValueError: no spectrum can be fitted: numbers are not finite or negative, λ does not rise between 0
            and π, there are fewer than two bins, nothing is counted, or a series has no power; or there is no
            model with the value that is held.
    """
    series, p = len(data.power), model.starts.shape[1]
    theta, scale, nll = np.empty((series, p)), np.empty(series), np.empty(series)
    if model.always is not None and warm is None:
        always = np.broadcast_to(model.always, (series, *model.always.shape))
        extra_starts = always if extra_starts is None else np.concatenate([always, extra_starts], axis=1)
    _native.whittle_fit(
        *_arguments(data, model),
        starts=model.starts,
        groups=model.groups,
        extra=None if extra_starts is None else np.ascontiguousarray(extra_starts, dtype=np.float64),
        warm=None if warm is None else np.ascontiguousarray(warm, dtype=np.float64),
        theta=theta,
        scale=scale,
        nll=nll,
    )
    return Fit(model, theta, scale, nll)


class Slopes(NamedTuple):
    """-log L of each series at some coordinates, at the best scale there."""

    nll: Array
    """The value of -log L of each series, (series,)."""
    gradient: Array
    """The gradient, (series, p)."""
    information: Array
    """Fisher's information on the coordinates with the scale unknown, (series, p, p)."""


def slopes(data: Binned, model: Model, theta: Array) -> Slopes:
    """Return the slopes at theta (series, p).

    Raises:
        ValueError: as for `fit`.
    """
    series, p = theta.shape
    found = Slopes(np.empty(series), np.empty((series, p)), np.empty((series, p, p)))
    _native.whittle_slopes(
        *_arguments(data, model),
        theta=np.ascontiguousarray(theta, dtype=np.float64),
        nll=found.nll,
        gradient=found.gradient,
        information=found.information,
    )
    return found


def _arguments(data: Binned, model: Model) -> tuple[Array, Array, Array, int, float, int, float, float]:
    """Return what all native functions begin with."""
    lam, counts, power = (np.ascontiguousarray(a, dtype=np.float64) for a in data)
    held = model.held
    return lam, counts, power, FAMILIES[model.name], model.highest_order, HOLDS[held.name], held.value, held.h


def negative_log_likelihood(
    data: Binned, shape: Array, rows: NDArray[np.intp], scale: ArrayLike | None = None
) -> tuple[Array, Array]:
    """Return -log L of spectra `shape` (k, bins) for the series `rows` (k,), and their scales (k,).

    scale: (k,) where it is given; else the best one.
    """
    ordinates = data.counts.sum()
    ratio = np.einsum("kb,kb,b->k", data.power[rows], 1 / shape, data.counts)
    best = ratio / ordinates if scale is None else np.asarray(scale, dtype=np.float64)
    return np.log(shape) @ data.counts + ordinates * np.log(best) + ratio / best, best
