"""The fractional state in white noise by exact maximum likelihood, beginning at Whittle's answer.

The search is scipy's quasi-Newton one, in the coordinates of `fltea.spectrum.models`, in which nothing has
bounds. Its first curvature is that of Whittle's likelihood, so that few of the dear exact ones are needed.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from fltea.spectrum.models import FULL, parameters
from fltea.spectrum.periodogram import binned, periodogram
from fltea.spectrum.profile import CRITICAL
from fltea.spectrum.whittle import fit, negative_log_likelihood
from numpy.typing import NDArray
from scipy.optimize import minimize

from tools.validation.evaluate.exact_likelihood import of_spectrum

Array = NDArray[np.float64]
Cost = Callable[[Array], float]

STEPS = 12
SLOPE = 0.05
"""The search ends where -log L changes by less than this along each coordinate."""
DIFFERENCE = 1e-5
"""Step of the slopes, which are differences."""
LEAST_CURVATURE = 0.02
"""A direction that is flatter is taken to be as curved as this: steps of a few units at most."""
IMPOSSIBLE = 1e9
"""-log L so near a bound that rounding decides."""


class ExactFit(NamedTuple):
    """The best of one series."""

    alpha: float
    s2: float
    R: float
    nll: float
    theta: Array
    """(3,) coordinates"""


class ExactSeries:
    """One series y (n,), at a sampling period of h s."""

    def __init__(self, y: Array, h: float) -> None:
        self._y = np.asarray(y, dtype=np.float64)
        self._data = binned(periodogram(self._y, h))
        self.whittle = fit(self._data, FULL).theta[0]

    def fit(self, *starts: Array) -> ExactFit:
        """The best of all; starts: coordinates (3,) to begin at beside Whittle's."""
        theta, nll = min((self._search(one) for one in (self.whittle, *starts)), key=lambda one: one[1])
        p = parameters(theta)
        scale = of_spectrum(lambda lam: FULL.shape(lam, theta[np.newaxis])[0], self._y).scale
        return ExactFit(float(p.alpha), float(p.weight) * scale, (1 - float(p.weight)) * scale, nll, theta)

    def covers(self, alpha: float, found: ExactFit) -> tuple[bool, ExactFit]:
        """Whether an order is in the 95 % interval of the profile, and a better fit, should one turn up."""
        theta, nll = self._search(found.theta, alpha)
        if nll < found.nll:
            found = self.fit(theta)
        return 2 * (nll - found.nll) <= CRITICAL, found

    def nll(self, theta: Array) -> float:
        """The exact -log L at coordinates (3,)."""
        try:
            return of_spectrum(lambda lam: FULL.shape(lam, theta[np.newaxis])[0], self._y).nll
        except ValueError:
            return IMPOSSIBLE

    def _approximate(self, theta: Array) -> float:
        shape = FULL.shape(self._data.lam, theta[np.newaxis])
        return float(negative_log_likelihood(self._data, shape, np.zeros(1, dtype=np.intp))[0][0])

    def _search(self, start: Array, alpha: float | None = None) -> tuple[Array, float]:
        """Coordinates (3,) and -log L of the best fit near `start`; alpha: held, if it is given."""
        held = [] if alpha is None else [alpha]
        free = start[len(held) :]
        inverse = inverse_curvature(lambda x: self._approximate(np.append(held, x)), free)
        found = minimize(
            lambda x: self.nll(np.append(held, x)),
            free,
            method="BFGS",
            options={"maxiter": STEPS, "gtol": SLOPE, "eps": DIFFERENCE, "hess_inv0": inverse},
        )
        return np.append(held, found.x), float(found.fun)


def inverse_curvature(cost: Cost, x: Array, size: float = 0.03) -> Array:
    """Inverse (p, p) of the second derivatives of `cost` at x, concave and flat directions made convex."""
    steps = size * np.eye(len(x))
    second = np.empty((len(x), len(x)))
    for i, a in enumerate(steps):
        for j, b in enumerate(steps):
            corners = cost(x + a + b) - cost(x + a - b) - cost(x - a + b) + cost(x - a - b)
            second[i, j] = corners / (4 * size * size)
    values, vectors = np.linalg.eigh((second + second.T) / 2)
    half = vectors / np.sqrt(np.maximum(np.abs(values), LEAST_CURVATURE))
    return np.asarray(half @ half.T)
