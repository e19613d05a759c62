"""The fractional state in white noise by exact maximum likelihood, beginning at Whittle's answer.

The search is a quasi-Newton one in the coordinates of `fltea.spectrum.models`, in which nothing has bounds;
slopes are differences, and the first curvature is that of Whittle's likelihood.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fltea.lab.reference.exact_likelihood import of_spectrum
from fltea.spectrum.models import FULL, parameters
from fltea.spectrum.periodogram import binned, periodogram
from fltea.spectrum.profile import CRITICAL
from fltea.spectrum.whittle import fit, negative_log_likelihood

Array = NDArray[np.float64]
Cost = Callable[[Array], float]

STEPS = 12
ENOUGH = 5e-4
"""The search ends where a step promises no more of -log L than this."""
LEAST_CURVATURE = 0.02
"""A direction that is flatter is taken to be as curved as this: steps of a few units at most."""
LONGEST = 2.0
"""Coordinate by coordinate, of a step."""
ROOT_STEPS = 6
"""Of the search for an end of an interval."""


class ExactFit(NamedTuple):
    """The best of one series."""

    alpha: float
    g: float
    s2: float
    R: float
    mean: float
    nll: float
    theta: Array
    """(3,) coordinates"""


class ExactSeries:
    """One series y (n,), at a sampling period of h s."""

    def __init__(self, y: Array, h: float) -> None:
        self._y = np.asarray(y, dtype=np.float64)
        self._data = binned(periodogram(self._y, h))
        self._whittle = fit(self._data, FULL).theta[0]

    def fit(self, starts: tuple[Array, ...] = ()) -> ExactFit:
        """The best of all; starts: coordinates (3,) to begin at beside Whittle's."""
        found = [self._search(start, None) for start in (self._whittle, *starts)]
        theta, nll = min(found, key=lambda one: one[1])
        exact = of_spectrum(lambda lam: FULL.shape(lam, theta[np.newaxis])[0], self._y)
        p = parameters(theta)
        weight = float(p.weight)
        return ExactFit(
            float(p.alpha),
            float(p.g),
            weight * exact.scale,
            (1 - weight) * exact.scale,
            exact.mean,
            nll,
            theta,
        )

    def held(self, alpha: float, start: Array) -> tuple[float, Array]:
        """-log L of the best fit with this order, and its coordinates (3,); start: (3,)."""
        theta, nll = self._search(np.array([alpha, *start[1:]]), alpha)
        return nll, theta

    def covers(self, alpha: float, found: ExactFit) -> tuple[bool, ExactFit]:
        """Whether an order is in the 95 % interval of the profile, and a better fit, should one turn up."""
        nll, theta = self.held(alpha, found.theta)
        if nll < found.nll:
            found = self.fit((theta,))
        return 2 * (nll - found.nll) <= CRITICAL, found

    def interval(self, found: ExactFit, highest: float = 1.999) -> tuple[float, float]:
        """The ends of that interval, at most 0 and `highest`."""
        return self._end(found, 0.0), self._end(found, highest)

    def _end(self, found: ExactFit, limit: float) -> float:
        """Regula falsi on the root of the deviance, which is nearly straight in α."""
        nll, theta = self.held(limit, found.theta)
        goal = np.sqrt(CRITICAL)
        inner, outer = (found.alpha, -goal), (limit, _root(nll, found.nll) - goal)
        if outer[1] <= 0:
            return limit
        theta = found.theta
        for _ in range(ROOT_STEPS):
            share = np.clip(inner[1] / (inner[1] - outer[1]), 0.1, 0.9)
            alpha = inner[0] + share * (outer[0] - inner[0])
            nll, theta = self.held(alpha, theta)
            here = _root(nll, found.nll) - goal
            if abs(here) < 0.01:
                return float(alpha)
            if here < 0:
                inner = alpha, here
            else:
                outer = alpha, here
        share = inner[1] / (inner[1] - outer[1])
        return float(inner[0] + share * (outer[0] - inner[0]))

    def _search(self, start: Array, alpha: float | None) -> tuple[Array, float]:
        """Coordinates (3,) and -log L of the best fit near `start`; alpha: held, or None."""
        free = slice(0 if alpha is None else 1, 3)

        def whole(x: Array) -> Array:
            theta = np.array(start)
            theta[free] = x
            return theta

        def exact(x: Array) -> float:
            return self._exact(whole(x))

        def whittle(x: Array) -> float:
            return self._approximate(whole(x))

        x, nll = minimise_smooth(exact, np.array(start[free]), curvature(whittle, np.array(start[free])))
        return whole(x), nll

    def _exact(self, theta: Array) -> float:
        try:
            return of_spectrum(lambda lam: FULL.shape(lam, theta[np.newaxis])[0], self._y).nll
        except ValueError:  # so near a bound that rounding decides
            return float("inf")

    def _approximate(self, theta: Array) -> float:
        shape = FULL.shape(self._data.lam, theta[np.newaxis])
        return float(negative_log_likelihood(self._data, shape, np.zeros(1, dtype=np.intp))[0][0])


def minimise_smooth(cost: Cost, x: Array, curved: Array) -> tuple[Array, float]:
    """Return where `cost` is least near x (p,), and how much; curved: its second derivatives, about."""
    here = cost(x)
    inverse: Array = np.asarray(np.linalg.inv(curved), dtype=np.float64)
    slope = _slopes(cost, x, here, curved)
    for _ in range(STEPS):
        step = -inverse @ slope
        step *= min(1.0, LONGEST / float(np.abs(step).max() + 1e-12))
        if -slope @ step < 2 * ENOUGH:
            break
        length = 1.0
        while (there := cost(x + length * step)) > here and length > 0.02:
            length /= 3
        if there > here:
            break
        new_slope = _slopes(cost, x + length * step, there, curved)
        inverse = _updated(inverse, length * step, new_slope - slope)
        x, here, slope = x + length * step, there, new_slope
    return x, here


def curvature(cost: Cost, x: Array, size: float = 0.03) -> Array:
    """Second derivatives (p, p) of `cost` at x (p,), flat and concave directions made convex."""
    steps = size * np.eye(len(x))
    second = np.empty((len(x), len(x)))
    for i, a in enumerate(steps):
        for j, b in enumerate(steps):
            corners = cost(x + a + b) - cost(x + a - b) - cost(x - a + b) + cost(x - a - b)
            second[i, j] = corners / (4 * size * size)
    values, vectors = np.linalg.eigh((second + second.T) / 2)
    return np.asarray((vectors * np.maximum(np.abs(values), LEAST_CURVATURE)) @ vectors.T)


def _slopes(cost: Cost, x: Array, here: float, curved: Array) -> Array:
    """By differences forward; of what they are off the curvature says the first order."""
    slopes = np.empty(len(x))
    for i, bend in enumerate(np.diag(curved)):
        size = float(np.clip(0.01 / np.sqrt(bend), 1e-4, 0.02))
        step = np.zeros(len(x))
        step[i] = size
        slopes[i] = (cost(x + step) - here) / size - 0.5 * size * bend
    return slopes


def _updated(inverse: Array, moved: Array, change: Array) -> Array:
    """Broyden, Fletcher, Goldfarb and Shanno's update; left as it is where the slope did not rise."""
    along = float(moved @ change)
    if along <= 1e-8:
        return inverse
    turn = np.eye(len(moved)) - np.outer(moved, change) / along
    return np.asarray(turn @ inverse @ turn.T + np.outer(moved, moved) / along)


def _root(nll: float, best: float) -> float:
    return float(np.sqrt(max(2 * (nll - best), 0.0)))
