"""Run other interpretations of the paper's algorithm, many runs at once, to see the effect of open choices.

The equations are those of `fltea.lab.reference`, for one state and one parameter with the full memory. The
fields of `Reading` say what an interpretation changes. With their defaults, the estimates equal those of the
engine (variant "triple", guard "off"). The code is plain numpy, and a hundred times slower than the engine,
which has only one interpretation.
"""

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from fltea.estimator.lane_settings import LaneSettings
from fltea.lab.reproduce.scenarios import Data
from fltea.noise.weights import weights
from fltea.records.arrays import Array


@dataclass(frozen=True)
class Reading:
    """One interpretation of section 5 of the paper. The defaults are those of this project."""

    kappa: float = 2.0
    """Scaling κ of the sigma points in the filters of order and parameter. The paper's section 5.1 calls it
    "usually chosen as 3 - L", where L is the number of estimated quantities, 1 in each of these filters.
    """
    sums_from: Literal[0, 1] = 0
    """Index of the first sigma point that counts in the covariances, in the filters of order and parameter.
    The paper begins at 1, which leaves out the mean. Other unscented Kalman filters begin at 0.
    """
    parameter_first: bool = False
    """Whether the parameter's filter runs before the order's. It then uses the previous order, and the
    order's filter uses the new parameter.
    """
    state_variance: bool = False
    """Whether the filters of order and parameter include the predicted variance of the state in P_yy, the
    variance of the output. The paper's equations lack that variance.
    """


class Estimated(NamedTuple):
    """State, parameter (s^-α) and order after every sample, each (n, runs)."""

    x: Array
    f: Array
    alpha: Array


class Walk(NamedTuple):
    """Estimate of a quantity that is modelled as a random walk: mean, variance, and step variance.

    Each array is (runs,).
    """

    mean: Array
    P: Array
    Q: Array


class Past(NamedTuple):
    """All states and their variances before sample k, each (runs, k), the newest first."""

    x: Array
    P: Array


class Weighed(NamedTuple):
    """Weighted sums of the past states and their variances, for the order of each run.

    All fields are (runs,).
    """

    order: Array
    gain: Array
    """The factor h^α, where h is the sampling period and α the order."""
    x: Array
    """Weighted sum of the past states x̂: the sum over j = 1 … k of c_j x̂_{k-j}, with the order's weights
    c_j.
    """
    P: Array
    """Weighted sum of the past states' variances P: the sum over j = 2 … k of c_j² P_{k-j}."""


def run(filters: LaneSettings, reading: Reading, data: Data) -> Estimated:
    """Run the three filters over all runs of `data`, and return the estimates.

    Estimates that diverge become infinite or NaN. The settings in `filters` have to be plain numbers, with
    one R for all three filters.
    """
    n, runs = data.y.shape
    x, P = np.empty((2, runs, n + 1))
    x[:, 0], P[:, 0] = filters.config.state.x0, filters.config.state.P0
    u = np.zeros_like(data.y) if data.u is None else data.u
    step = _Step(filters, reading, runs)
    alpha, f = np.empty((2, n, runs))
    with np.errstate(all="ignore"):
        for k in range(1, n + 1):
            past = Past(x[:, k - 1 :: -1], P[:, k - 1 :: -1])
            x[:, k], P[:, k] = step(data.y[k - 1], u[k - 1], past)
            alpha[k - 1], f[k - 1] = step.order.mean, step.parameter.mean
    return Estimated(x[:, 1:].T, f, alpha)


class _Step:
    """The filters of order and parameter for all runs. Each call processes one sample."""

    def __init__(self, filters: LaneSettings, reading: Reading, runs: int) -> None:
        order, parameter = filters.config.order, filters.config.parameter
        self.settings, self.reading = filters.config, reading
        self.h, self.R = float(np.asarray(filters.h)), float(np.asarray(filters.R))
        ones = np.ones(runs)
        self.order = Walk(order.alpha0 * ones, order.P0 * ones, order.Q0 * ones)
        self.parameter = Walk(parameter.f0 * ones, parameter.P0 * ones, parameter.Q0 * ones)
        self.V = 0 * ones
        """Variance of the weighted sum of past states at the previous sample, without their newest."""

    def __call__(self, y: Array, u: Array, past: Past) -> tuple[Array, Array]:
        """Process y_k and u_{k-1}, each (runs,), and return the posterior state and its variance."""
        f = self.parameter.mean
        if self.reading.parameter_first:
            self._move_parameter(y, u, past, self._weigh(past))
            self._move_order(y, u, past)
            at = self._weigh(past)
        else:
            self._move_order(y, u, past)
            at = self._weigh(past)
            self._move_parameter(y, u, past, at)
        # The state's filter (the paper, section 5.2) uses the parameter from before this sample.
        x = at.gain * (f * past.x[:, 0] + u) - at.x
        P = self._predicted_variance(f, past, at)
        self.V = at.P
        K = P / (P + self.R)
        return x + K * (y - x), (1 - K) ** 2 * P + K**2 * self.R

    def _weigh(self, past: Past) -> Weighed:
        """Return the weighted sums of past states, with the weights for the present estimate of the order."""
        order = self.order.mean
        c = weights(order, past.x.shape[1])[:, 1:]
        V = np.einsum("rj,rj,rj->r", c[:, 1:], c[:, 1:], past.P[:, 1:])
        return Weighed(order, self.h**order, np.einsum("rj,rj->r", c, past.x), V)

    def _predicted_variance(self, f: Array, past: Past, at: Weighed) -> Array:
        F = at.gain * f + at.order
        return np.asarray(F**2 * past.P[:, 0] + self.settings.state.Q + at.P)

    def _move_order(self, y: Array, u: Array, past: Past) -> None:
        """Run the order's filter (the paper, section 5.1) for one sample."""
        f, before = self.parameter.mean, self.order
        points = self._sigma_points(before)
        c = weights(points.ravel(), past.x.shape[1]).reshape(*points.shape, -1)[:, :, 1:]
        Y = self.h**points * (f * past.x[:, 0] + u) - np.einsum("irj,rj->ir", c, past.x)
        R = np.full(len(y), self.R)
        if self.reading.state_variance:
            at = Weighed(before.mean, self.h**before.mean, past.x[:, 0], self.V)
            R += self._predicted_variance(f, past, at)
        self.order = self._updated(before, points, Y, y, R, self.settings.order.delta)

    def _move_parameter(self, y: Array, u: Array, past: Past, at: Weighed) -> None:
        """Run the parameter's filter (the paper, section 5.3) for one sample.

        `at`: sums of the past states, weighted for the present estimate of the order.
        """
        before = self.parameter
        points = self._sigma_points(before)
        Y = at.gain * (points * past.x[:, 0] + u) - at.x
        R = np.full(len(y), self.R)
        if self.reading.state_variance:
            R += self._predicted_variance(before.mean, past, at)
        self.parameter = self._updated(before, points, Y, y, R, self.settings.parameter.delta)

    def _sigma_points(self, walk: Walk) -> Array:
        """Return the sigma points: the mean, and the mean ± sqrt((1 + κ) P̃), (3, runs).

        P̃ is the predicted variance. The paper has λ in place of κ. Both are equal for one quantity and a
        width of the sigma points of 1 (the paper's 𝔄).
        """
        root = np.sqrt((1 + self.reading.kappa) * (walk.P + walk.Q))
        return np.stack([walk.mean, walk.mean + root, walk.mean - root])

    def _updated(self, walk: Walk, points: Array, Y: Array, y: Array, R: Array, delta: float) -> Walk:
        """Run the measurement update that the filters of order and parameter share.

        `points`: sigma points, (3, runs). `Y`: the output that the model predicts at each sigma point, (3,
        runs).
        """
        scale = 1 + self.reading.kappa
        sides = 1 / (2 * scale)
        mean = np.array([[self.reading.kappa / scale], [sides], [sides]])
        covariance = mean.copy()
        # The paper adds 1 - 𝔄² + 𝔅 to the weight of the mean in the covariances. Here 𝔄, the width of the
        # sigma points, is 1, and 𝔅 is 2 for a Gaussian distribution.
        covariance[0] += 2
        covariance[: self.reading.sums_from] = 0
        dx, dy = points - points[0], Y - np.sum(mean * Y, axis=0)
        Pyy = np.sum(covariance * dy * dy, axis=0) + R
        K = np.sum(covariance * dx * dy, axis=0) / Pyy
        correction = K * (y - np.sum(mean * Y, axis=0))
        # This variance equals the paper's P̃ - K Pyy K (K: gain, Pyy: variance of the output), but rounding
        # cannot make it negative.
        P = np.sum(covariance * (dx - K * dy) ** 2, axis=0) + K**2 * R
        return Walk(walk.mean + correction, P, (1 - delta) * walk.Q + delta * correction**2)
