"""The families of spectra that are fitted: the fractional state in white noise and its rivals (pure).

Their coordinates have no bounds: shares and poles are logits, orders are folded.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fltea.noise import spectra as spectrum
from fltea.spectrum.whittle import Held, Model

Array = NDArray[np.float64]

TINY = 1e-6
"""Shares closer than that to 0 or 1 are moved to it as starts; the search itself goes to 1e-7."""

WEIGHTS = np.array([1e-5, 1e-3, 0.01, 0.05, 0.15, 0.4, 0.75, 0.98])
"""Weights of starts: variance of the innovations over the same plus R."""


def logit(share: ArrayLike) -> Array:
    """Return the coordinate of a number between 0 and 1."""
    x = np.clip(share, TINY, 1 - TINY)
    return np.asarray(np.log(x / (1 - x)))


def share(coordinate: ArrayLike) -> Array:
    """Return the number between 0 and 1 of a coordinate, at least 1e-7 from both."""
    # np.clip takes several times as long, which counts in a fit every second.
    return np.asarray(1 / (1 + np.exp(np.minimum(np.maximum(np.negative(coordinate), -16.0), 16.0))))


def broken_stick(coordinates: Array) -> tuple[Array, Array]:
    """Return shares (..., K) of 1, and what is left, (...).

    coordinates: (..., K); of each, the share of what those before it have left.
    """
    taken, rest = [], np.ones(coordinates.shape[:-1])
    for k in range(coordinates.shape[-1]):
        part = rest * share(coordinates[..., k])
        taken.append(part)
        rest = rest - part
    return np.stack(taken, axis=-1), rest


class Parameters(NamedTuple):
    """The parameters of the fractional state in white noise, as arrays of one shape."""

    alpha: Array
    g: Array
    weight: Array
    """The weight s2 / (s2 + R)."""


def parameters(theta: Array, highest_order: float = spectrum.HIGHEST_ORDER) -> Parameters:
    """Return the parameters of coordinates (..., 3): α folded, logits of -g/2^α and of s2/(s2 + R)."""
    alpha = np.minimum(np.abs((theta[..., 0] + 2) % 4 - 2), highest_order - TINY)
    return Parameters(alpha, -(2.0**alpha) * share(theta[..., 1]), share(theta[..., 2]))


def coordinates(alpha: ArrayLike, g: ArrayLike, weight: ArrayLike) -> Array:
    """Return the inverse of `parameters`, (..., 3); g and weight are moved inside their bounds."""
    a = np.asarray(alpha, dtype=np.float64)
    parts = np.broadcast_arrays(a, logit(-np.asarray(g) / 2.0**a), logit(weight))
    return np.stack(parts, axis=-1)


def fractional(highest_order: float = spectrum.HIGHEST_ORDER) -> Model:
    """Return the fractional state, 0 <= α < highest_order and -2^α < g < 0, in white noise."""

    def shape(lam: Array, theta: Array) -> Array:
        p = parameters(theta, highest_order)
        return _in_white(spectrum.fractional(lam, p.alpha, p.g), p.weight)

    alpha = np.array([0.0, 0.15, 0.3, 0.45, 0.6, 0.75, 0.9, 1.0, 1.1, 1.3, 1.5, 1.75, 1.95])
    u = np.array([1e-6, 1e-4, 1e-3, 4e-3, 0.01, 0.03, 0.08, 0.2, 0.35, 0.5, 0.65, 0.8, 0.92, 0.98])
    a, b, w = _grid(alpha[alpha <= highest_order], u, WEIGHTS)
    return Model("fractional", 4, coordinates(a, -(2.0**a) * b, w), _groups(a), shape, highest_order)


def held(name: str, value: float, h: float = 1.0) -> Model:
    """Return the fractional model in which "alpha", "g", "f" (in s^-α, h in s) or "F" has this value.

    With α held the coordinates are the other two of `fractional`; else that of the weight comes after log -g
    if F is held, and after α if another is.
    """
    if name == "alpha":
        free, w = _grid(FULL.starts[FULL.starts[:, 0] == 0][:: len(WEIGHTS), 1], logit(WEIGHTS))
    else:
        orders = _HELD_ORDERS[value < _HELD_ORDERS] if name == "F" else _HELD_ORDERS
        free, w = _grid(np.log(orders - value) if name == "F" else orders, logit(WEIGHTS))

    def shape(lam: Array, theta: Array) -> Array:
        if name == "alpha":
            return FULL.shape(lam, np.column_stack([np.full(len(theta), value), theta]))
        alpha = value + np.exp(theta[:, 0]) if name == "F" else theta[:, 0]
        g = {"g": value + 0 * alpha, "f": value * h**alpha, "F": value - alpha}[name]
        return FULL.shape(lam, coordinates(alpha, g, share(theta[:, 1])))

    starts = np.stack([free, w], axis=-1)
    return Model("fractional", 3, starts, _groups(free), shape, held=Held(name, value, h))


def ar1_coordinates(phi: ArrayLike, weight: ArrayLike) -> Array:
    """Return the coordinates (..., 2) of AR(1) in white noise."""
    return np.stack(np.broadcast_arrays(logit((1 + np.asarray(phi)) / 2), logit(weight)), axis=-1)


def ar1_parameters(theta: Array) -> tuple[Array, Array]:
    """Return the inverse of `ar1_coordinates`: φ and s2/(s2 + R)."""
    return 2 * share(theta[..., 0]) - 1, share(theta[..., 1])


def ar2_parameters(theta: Array) -> tuple[Array, Array, Array]:
    """Return φ1, φ2 and s2/(s2 + R) of coordinates (..., 3), of which two are partial correlations."""
    k1, k2 = 2 * share(theta[..., 0]) - 1, 2 * share(theta[..., 1]) - 1
    return k1 * (1 - k2), k2, share(theta[..., 2])


def two_ar1_parameters(theta: Array) -> tuple[Array, Array, Array, Array]:
    """Return two φ of coordinates (..., 4), and the shares of their innovations in the sum with R."""
    first = share(theta[..., 2])
    return (
        2 * share(theta[..., 0]) - 1,
        2 * share(theta[..., 1]) - 1,
        first,
        (1 - first) * share(theta[..., 3]),
    )


def _ar1() -> Model:
    # Near 0 too, for a little of a colour in much data.
    phi, w = _grid(np.append(_POLES, [-0.06, 0.06]), WEIGHTS)
    return Model("ar1", 3, ar1_coordinates(phi, w), _groups(phi), _ar1_shape)


def _ar2() -> Model:
    radius, angle = _grid(np.array([0.5, 0.8, 0.93, 0.985]), np.linspace(0, np.pi, 33)[1:-1])
    one, two = _grid(_POLES, _POLES)
    different = one > two
    phi1 = np.concatenate([2 * radius * np.cos(angle), (one + two)[different]])
    phi2 = np.concatenate([-(radius**2), -(one * two)[different]])
    which, w = _grid(np.arange(float(len(phi1))), WEIGHTS[::2])
    pair = which.astype(np.intp)
    k2 = phi2[pair]
    k1 = phi1[pair] / (1 - k2)
    starts = np.stack([logit((1 + k1) / 2), logit((1 + k2) / 2), logit(w)], axis=-1)
    # Poles near 0 too, from where the search can go either way.
    always = np.stack([*_grid(np.array([-0.5, 0.5]), np.array([-0.5, 0.5])), np.zeros(4)], axis=-1)
    return Model("ar2", 4, starts, pair, _ar2_shape, always=always)


def _two_ar1() -> Model:
    one, two, first, second = _grid(_POLES, _POLES, WEIGHTS, WEIGHTS[::2])
    keep = one > two
    starts = np.stack([logit((1 + one) / 2), logit((1 + two) / 2), logit(first), logit(second)], axis=-1)
    # Two poles at opposite ends, and a slow one beside one of no colour.
    always = np.array([[8.0, -8.0, 6.0, 3.0], [6.0, -3.0, 0.0, 0.0], [3.0, 0.0, 0.0, 0.0]])
    groups = _groups((one + 10 * two)[keep])
    return Model("two_ar1", 5, starts[keep], groups, _two_ar1_shape, always=always)


def _ar1_shape(lam: Array, theta: Array) -> Array:
    phi, weight = ar1_parameters(theta)
    return _in_white(spectrum.ar1(lam, phi), weight)


def _ar2_shape(lam: Array, theta: Array) -> Array:
    phi1, phi2, weight = ar2_parameters(theta)
    return _in_white(spectrum.ar2(lam, phi1, phi2), weight)


def _two_ar1_shape(lam: Array, theta: Array) -> Array:
    phi1, phi2, first, second = two_ar1_parameters(theta)
    w1, w2 = first[:, np.newaxis], second[:, np.newaxis]
    return np.asarray(w1 * spectrum.ar1(lam, phi1) + w2 * spectrum.ar1(lam, phi2) + (1 - w1 - w2))


def _in_white(part: Array, weight: Array) -> Array:
    """Return a part of unit innovations with `weight` (k,), and white noise with the rest."""
    w = weight[:, np.newaxis]
    return np.asarray(w * part + (1 - w))


def _grid(*axes: Array) -> list[Array]:
    return [np.asarray(axis.ravel()) for axis in np.meshgrid(*axes, indexing="ij")]


def _groups(values: Array) -> NDArray[np.intp]:
    return np.asarray(np.unique(values, return_inverse=True)[1], dtype=np.intp)


_HELD_ORDERS = np.linspace(0.02, 1.98, 25)
_POLES = np.array([-0.95, -0.6, -0.25, 0.25, 0.6, 0.85, 0.95, 0.985, 0.996, 0.999, 0.9999])

WHITE = Model(
    "white",
    1,
    np.zeros((1, 0)),
    np.zeros(1, dtype=np.intp),
    lambda lam, theta: np.ones((len(theta), len(lam))),
)
FULL = fractional()
UP_TO_ONE = fractional(1.0)
"""What white noise is tested against: orders above 1 are resonances and filters, and to search for those too
would cost the test power (its 5 % point at 3,000 samples is 12.6 with them and 6.3 without)."""
AR1 = _ar1()
AR2 = _ar2()
TWO_AR1 = _two_ar1()
