"""Fit a fractional state in white noise by exact maximum likelihood. The search starts at the Whittle fit.

The state is D^α x = f x + ω. Let g = h^α f, where h is the sampling period, s2 the variance of the steps ω,
and R the variance of the white noise. scipy's quasi-Newton method (BFGS) searches for the best α,
logit(-g / 2^α) and log s2/R. It begins with the curvature of Whittle's likelihood, so it needs only a few of
the exact likelihoods, which are slow to compute.
"""

import math
from typing import NamedTuple

import numpy as np
from fltea.noise import spectra
from fltea.noise.free_parameters import g_of_eta
from fltea.records.arrays import Array
from fltea.spectrum.candidate_models import native, order_in_white
from fltea.spectrum.intervals import CRITICAL
from fltea.spectrum.periodogram import binned, periodogram
from scipy.optimize import minimize

from tools.validation.evaluate.exact_likelihood import Likelihood, of_spectrum

STEPS = 12
SLOPE = 0.05
"""The search ends when the slope of -log L (L: likelihood) along each parameter is less than this."""
DIFFERENCE = 1e-5
"""Step of the parameters for the finite differences from which slopes of -log L are computed."""
LEAST_CURVATURE = 0.02
"""The search assumes at least this curvature of -log L in each direction, so that none of its steps is longer
than a few units.
"""
ORDERS = 0.01, 1.99
IMPOSSIBLE = 1e9
"""The search gets this value instead of -log L for orders outside the limits. It also gets it for orders so
near a limit that rounding errors would decide.
"""


class ExactFit(NamedTuple):
    """The best fit of one series."""

    alpha: float
    s2: float
    R: float
    nll: float
    theta: Array
    """Parameters as the search uses them: α, logit(-g / 2^α) and log s2/R (symbols: see the module)."""


class ExactSeries:
    """Fits one series y (n,) by its exact likelihood. `h`: sampling period [s]."""

    def __init__(self, y: Array, h: float) -> None:
        self._y = np.asarray(y, dtype=np.float64)
        data = binned(periodogram(self._y, h))
        self._fits, self._counts = native(data, h, len(y)), data.counts
        found = order_in_white(self._fits)
        self._codes, (R, alpha, logit, s2) = list(found.codes), found.eta
        self.whittle = np.array([alpha, logit, s2 - R])

    def fit(self, *starts: Array) -> ExactFit:
        """Return the best of the fits that begin at the Whittle fit and at `starts`.

        `starts`: further parameters, transformed as in `ExactFit.theta`, at which a search begins.
        """
        theta, nll = min((self._search(one) for one in (self.whittle, *starts)), key=lambda one: one[1])
        R = self._likelihood(theta).scale
        return ExactFit(float(theta[0]), R * math.exp(theta[2]), R, nll, theta)

    def covers(self, alpha: float, found: ExactFit) -> tuple[bool, ExactFit]:
        """Return whether the order's 95 % interval (profile likelihood) contains `alpha`; and the best fit.

        `found`: the best fit so far. It is replaced if the search with the order `alpha` finds a better one.
        """
        theta, nll = self._search(found.theta, alpha)
        if nll < found.nll:
            found = self.fit(theta)
        return 2 * (nll - found.nll) <= CRITICAL, found

    def nll(self, theta: Array) -> float:
        """Return the exact -log L at the transformed parameters `theta`.

        These parameters give the spectrum but for a factor. The factor, R, is the most likely one.
        """
        if not ORDERS[0] <= theta[0] <= ORDERS[1]:
            return IMPOSSIBLE
        try:
            return self._likelihood(theta).nll
        except ValueError:
            return IMPOSSIBLE

    def _likelihood(self, theta: Array) -> Likelihood:
        alpha, ratio, g = float(theta[0]), math.exp(theta[2]), g_of_eta(theta.tolist())
        return of_spectrum(lambda lam: 1 + ratio * spectra.fractional(lam, alpha, g), self._y)

    def inverse_curvature(self, theta: Array, first: int = 0) -> Array:
        """Return the inverse of the curvature of Whittle's -log L by the transformed parameters `theta`.

        Only the parameters from index `first` on are free; those before are fixed. R is free, too.
        """
        rows = np.empty((4, len(self._counts)))
        self._fits.slopes(self._codes, [0.0, *theta], np.empty(len(self._counts)), rows)
        # Each row has the derivatives of the log spectrum by one parameter. Row 0 is for log R at fixed s2,
        # row 3 for log s2. If R changes at a fixed s2/R, both change alike, so the two rows are added.
        rows[0] += rows[3]
        whole = (rows * self._counts) @ rows.T
        rest = whole[1:, 1:] - np.outer(whole[1:, 0], whole[0, 1:]) / whole[0, 0]
        values, vectors = np.linalg.eigh(rest[first:, first:])
        half = vectors / np.sqrt(np.maximum(values, LEAST_CURVATURE))
        return np.asarray(half @ half.T)

    def _search(self, start: Array, alpha: float | None = None) -> tuple[Array, float]:
        """Return the transformed parameters (3,) of the best fit near `start`, and its -log L.

        `alpha`: the order, if it is fixed.
        """
        held = [] if alpha is None else [alpha]
        inverse = self.inverse_curvature(np.append(held, start[len(held) :]), len(held))
        found = minimize(
            lambda x: self.nll(np.append(held, x)),
            start[len(held) :],
            method="BFGS",
            options={"maxiter": STEPS, "gtol": SLOPE, "eps": DIFFERENCE, "hess_inv0": inverse},
        )
        return np.append(held, found.x), float(found.fun)
