"""Estimate state, order and parameters of a fractional system sample by sample: reference FLTEA in numpy.

The equations are those of Macias & Sierociuk 2023, section 5, with one function for each filter. The code is
plain rather than fast, and faster implementations are compared with it. There are N states, d inputs, p
outputs and n_w parameters:

    x_{k+1} = h^α_{k+1} (A(w) x_k + B u_k) - sum_{j=1}^{L(k+1)} c_j(α_{k+1}) x_{k+1-j} + noise of variance Q
    y_k     = C x_k + noise of variance R

Here c_j(a) = (-1)^j binom(a, j), so c_1 = -a. The factor of x_k in x_{k+1} is thus F = h^α A(w) + α I. The
sampling period h is in s and A in s^-α. A stable scalar system has A < 0. With y in deg/s, x is in deg/s as
well.

One step runs KFo (order), KFw (parameters) and KFx (state), in this order. KFw uses the new order. KFx uses
the new order and the *old* parameters. The paper's indices contradict each other here; this is the
interpretation that we chose. The covariance sums of KFo and KFw start at i = 0, as is usual (in the paper: i
= 1).

The paper's algorithm can diverge. Then results are infinite or NaN and `Step.finite` is False. No error is
raised.
"""

from collections.abc import Iterable
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from fltea.lab.reference.system import OrderSettings, ParameterSettings, StateSettings, System, covariance
from fltea.noise.memory import NewestFirst
from fltea.noise.weights import weights
from fltea.records.arrays import Array

__all__ = ["Array", "Fltea", "OrderSettings", "ParameterSettings", "StateSettings", "Step", "System"]

# Constants of the unscented transformation (the paper, section 5.1). SPREAD (the paper's 𝔄) is the width of
# the sigma points. GAUSSIAN (the paper's 𝔅) is 2 for an estimate with a Gaussian distribution. As kappa is
# 3 - n, n + lambda is 3 for every dimension n.
SPREAD = 1.0
GAUSSIAN = 2.0


class FilterModel(NamedTuple):
    """Estimate of a quantity that is modelled as a random walk: of the order, or of the parameters.

    The order's filter KFo has n = 1, the parameters' filter KFw has n = n_w.
    """

    mean: Array
    """Estimate, (n,)."""
    P: Array
    """Covariance of the estimate, (n, n)."""
    Q: Array
    """Covariance of one step of the random walk, (n, n), adapted at every sample."""


class Step(NamedTuple):
    """All estimates after one sample. The arrays are not changed by later steps."""

    x: Array
    """Posterior state, (N,)."""
    P: Array
    """Covariance of the state, (N, N)."""
    order: float
    order_variance: float
    w: Array
    """Parameters, (n_w,)."""
    Pw: Array
    """Covariance of the parameters, (n_w, n_w)."""
    innovation: Array
    """Innovation: the measurement less its prediction, y - C x̃, (p,); NaN if there is no measurement."""
    innovation_variance: Array
    """Variance of the innovation, C P̃ C' + R, (p, p). P̃ is the predicted covariance of the state."""
    finite: bool
    """False if any estimate or covariance is infinite or NaN. Then the filter has diverged for good."""


class Difference(NamedTuple):
    """The fractional difference of past states for one order.

    The filters of parameters (KFw) and state (KFx) share one `Difference`, for the newest order estimate.
    """

    order: np.float64
    gain: np.float64
    """The factor h^α, where h is the sampling period and α the order."""
    c: Array
    """The weights c_0 .. c_L(k) for the order α, (L(k)+1,). L(k) is the number of past states."""
    past: Array
    """Weighted sum of the past states x̂ with the weights `c`, sum_{j=1}^{L(k)} c_j x̂_{k-j}, (N,)."""


def difference(order: np.float64, h: float, states: Array) -> Difference:
    """Return the fractional difference of past states (L(k), N), the newest first, for `order`.

    `h`: sampling period [s]. The paper defines the difference in section 4.
    """
    c = weights(order, len(states))
    return Difference(order, np.power(h, order), c, c[1:] @ states)


def order_filter(
    prior: FilterModel, y: Array, rate: Array, states: Array, system: System, R: Array, delta: float
) -> FilterModel:
    """Run KFo (the paper, section 5.1): estimate the order from the model's outputs at three sigma points.

    `rate` is A(ŵ_{k-1}) x̂_{k-1} + B u_{k-1}, shape (N,); `y` and `R` have shapes (p,) and (p, p).
    """
    points = sigma_points(prior.mean, prior.P + prior.Q)  # P̃o_k, the predicted variance of the order
    orders = points[:, 0]
    c = weights(orders, len(states))
    # the state if the order is that of sigma point i: χ_i = h^α_i rate - sum_{j=1}^{L(k)} c_j(α_i) x̂_{k-j}
    chi = np.power(system.h, orders)[:, np.newaxis] * rate - c[:, 1:] @ states
    return unscented_update(prior, points, chi @ system.C.T, y, R, delta)


def parameter_filter(
    prior: FilterModel,
    y: Array,
    x: Array,
    drive: Array,
    at: Difference,
    system: System,
    R: Array,
    delta: float,
) -> FilterModel:
    """Run KFw (the paper, section 5.3): estimate the parameters from the outputs at 2 n_w + 1 sigma points.

    The outputs use the new order α̂_k. `x` (N,) is x̂_{k-1}, `drive` (N,) is B u_{k-1}. `at` has the weighted
    sum of the past states. It does not depend on the parameters, so all sigma points share it.
    """
    points = sigma_points(prior.mean, prior.P + prior.Q)  # P̃w_k, the predicted covariance of the parameters
    # the state with the parameters of sigma point i: χ_i = h^α̂_k (A(w_i) x̂_{k-1} + B u_{k-1}) - past
    chi = at.gain * (np.array([system.A(w) @ x for w in points]) + drive) - at.past
    return unscented_update(prior, points, chi @ system.C.T, y, R, delta)


def predict_state(A: Array, rate: Array, at: Difference, covariances: Array, Q: Array) -> tuple[Array, Array]:
    """Return the prediction of KFx (the paper, 5.2) before y_k is used: state x̃_k (N,) and covariance P̃_k.

    `A` is A(ŵ_{k-1}), `rate` is A x̂_{k-1} + B u_{k-1}. `at`: difference of the past states for order α̂_k.
    """
    L, N, _ = covariances.shape
    x = at.gain * rate - at.past
    F = at.gain * A + at.order * np.eye(N)
    # F is the factor of x_{k-1} in x_k. Its second term is there because the sum of past states has x_{k-1},
    # too, with the weight c_1 = -α. An older state x_{k-j} has the weight c_j, so it adds c_j² times its
    # covariance.
    V = ((at.c[2:] * at.c[2:]) @ covariances[1:].reshape(L - 1, N * N)).reshape(N, N)
    P = F @ covariances[0] @ F.T + Q + V
    return x, symmetric(P)


def state_filter(x: Array, P: Array, y: Array, C: Array, R: Array) -> tuple[Array, Array, Array, Array]:
    """Run the measurement update of the state's filter KFx: return x̂, P, the innovation and its variance.

    P is computed in Joseph form. In exact arithmetic this equals (I - K C) P̃ of the paper, section 5.2. In
    floating point, the Joseph form stays symmetric and non-negative.
    """
    innovation = y - C @ x
    S = symmetric(C @ P @ C.T + R)
    K = kalman_gain(P @ C.T, S)
    kept = np.eye(len(x)) - K @ C
    return x + K @ innovation, symmetric(kept @ P @ kept.T + K @ R @ K.T), innovation, S


def unscented_update(
    prior: FilterModel, points: Array, Y: Array, y: Array, R: Array, delta: float
) -> FilterModel:
    """Run the measurement update that the filters of order and parameters share (the paper, 5.1 and 5.3).

    `points` (2n+1, n): the sigma points, spread about the mean as the predicted covariance P̃ says. `Y`
    (2n+1, p): the outputs that the model predicts at these points. `delta`: the forgetting factor with which
    Q follows the corrections (Robbins-Monro).
    """
    Wm, Wc = unscented_weights(len(prior.mean))
    y_mean = Wm @ Y
    dx, dy = points - prior.mean, Y - y_mean
    weighted = Wc[:, np.newaxis] * dy
    Pyy = dy.T @ weighted + R
    K = kalman_gain(dx.T @ weighted, Pyy)
    correction = K @ (y - y_mean)
    # The paper's P is P̃ - K Pyy K', with the gain K and the outputs' covariance Pyy. Here the same P is
    # computed as a sum of squares, which rounding cannot make negative. (P̃ is the weighted sum of dx' dx.)
    left = dx - dy @ K.T
    return FilterModel(
        mean=prior.mean + correction,
        P=symmetric(left.T @ (Wc[:, np.newaxis] * left) + K @ R @ K.T),
        Q=(1 - delta) * prior.Q + delta * (correction[:, np.newaxis] * correction),
    )


def sigma_points(mean: Array, P: Array) -> Array:
    """Return the sigma points: mean, and mean ± columns of sqrt((n + λ) P), shape (2n+1, n).

    n + λ is 3 (the paper, section 5.1).
    """
    root = cholesky(P) * np.sqrt(SPREAD**2 * 3)
    return np.concatenate((mean[np.newaxis], mean + root.T, mean - root.T))


@lru_cache(maxsize=8)
def unscented_weights(n: int) -> tuple[Array, Array]:
    """Return the sigma points' weights for means and covariances, each (2n+1,); see the paper, 5.1."""
    scale = SPREAD**2 * 3  # n + λ of the paper
    Wm = np.full(2 * n + 1, 1 / (2 * scale))
    Wm[0] = (scale - n) / scale
    Wc = Wm.copy()
    Wc[0] += 1 - SPREAD**2 + GAUSSIAN
    for weight in (Wm, Wc):
        weight.flags.writeable = False
    return Wm, Wc


def kalman_gain(Pxy: Array, Pyy: Array) -> Array:
    """Return the Kalman gain K = Pxy Pyy^-1 of shape (n, p), filled with NaN if Pyy has no inverse."""
    if Pyy.shape == (1, 1):
        return Pxy / Pyy
    try:
        # The transposed equation is solved, since Pyy is symmetric: Pyy K' = Pxy'.
        return np.asarray(np.linalg.solve(Pyy, Pxy.T).T, dtype=np.float64)
    except np.linalg.LinAlgError:
        return np.full_like(Pxy, np.nan)


def cholesky(P: Array) -> Array:
    """Return the lower triangular root of P (n, n); NaN if P is indefinite or not finite.

    Unlike LAPACK's routine, this one accepts semidefinite matrices, since P = 0 holds a parameter fixed.
    """
    n = len(P)
    root = np.zeros_like(P)
    tolerance = 1e-12 * P.diagonal().max()
    for j in range(n):
        pivot = P[j, j] - root[j, :j] @ root[j, :j]
        if pivot > 0:
            root[j, j] = np.sqrt(pivot)
            if j + 1 < n:
                root[j + 1 :, j] = (P[j + 1 :, j] - root[j + 1 :, :j] @ root[j, :j]) / root[j, j]
        elif not pivot >= -tolerance:
            return np.full_like(P, np.nan)
    return root


def symmetric(P: Array) -> Array:
    """Return the symmetric part of P.

    Without it, rounding would destroy the symmetry of P over thousands of steps.
    """
    return P if P.shape == (1, 1) else (P + P.T) / 2


class Fltea:
    """The finite length triple estimation algorithm (the paper, section 5); call `step` for each sample.

    `window` is the implementation length L, the number of past samples that are used. With a window at least
    as long as the data, no past sample is dropped (full memory). Settings whose shapes do not fit the system
    raise ValueError. The memory starts with the initial state x0 and its covariance P0.
    """

    def __init__(
        self,
        system: System,
        order: OrderSettings,
        parameter: ParameterSettings,
        state: StateSettings,
        window: int = 3000,
    ) -> None:
        x0 = np.atleast_1d(np.asarray(state.x0, dtype=np.float64))
        w0 = np.atleast_1d(np.asarray(parameter.w0, dtype=np.float64))
        system.check(len(x0), w0)
        p, n_w = len(system.C), len(w0)
        self.system = system
        self.order = FilterModel(
            np.array([order.alpha0], dtype=np.float64), np.array([[order.P0]]), np.array([[order.Q0]])
        )
        self.parameter = FilterModel(
            w0.copy(),
            covariance("parameter P0", parameter.P0, n_w),
            covariance("parameter Q0", parameter.Q0, n_w),
        )
        self._order_R = covariance("order R", order.R, p, definite=True)
        self._parameter_R = covariance("parameter R", parameter.R, p, definite=True)
        self._R = covariance("state R", state.R, p, definite=True)
        self._Q = covariance("state Q", state.Q, len(x0))
        self._order_delta, self._parameter_delta = order.delta, parameter.delta
        self.states = NewestFirst(window, x0.shape)
        self.covariances = NewestFirst(window, (len(x0), len(x0)))
        self._remember(x0, covariance("state P0", state.P0, len(x0)))

    def step(self, y: ArrayLike | None, u: ArrayLike | None = None) -> Step:
        """Process the measurement y_k (p,) and the input u_{k-1} (d,) before it.

        If `u` is None, the input is 0. If `y` is None, there is no measurement, and `predict` is called.
        Wrong shapes and numbers that are not finite raise ValueError, and the estimates stay unchanged.
        """
        if y is None:
            return self.predict(u)
        measured = _vector("y", y, len(self.system.C))
        drive = self._drive(u)
        with np.errstate(all="ignore"):
            x = self.states.values[0]
            A = self.system.A(self.parameter.mean)
            rate = A @ x + drive
            self.order = order_filter(
                self.order, measured, rate, self.states.values, self.system, self._order_R, self._order_delta
            )
            at = difference(self.order.mean[0], self.system.h, self.states.values)
            self.parameter = parameter_filter(
                self.parameter,
                measured,
                x,
                drive,
                at,
                self.system,
                self._parameter_R,
                self._parameter_delta,
            )
            # `A` and `rate` still use the parameters from before this sample.
            predicted = predict_state(A, rate, at, self.covariances.values, self._Q)
            return self._finish(*state_filter(*predicted, measured, self.system.C, self._R))

    def retune(self, Q: ArrayLike, R: ArrayLike) -> None:
        """Change the variances of state and measurement noise in all three filters, but keep the memory."""
        p = len(self.system.C)
        self._Q = covariance("state Q", Q, len(self._Q))
        self._R = self._order_R = self._parameter_R = covariance("R", R, p, definite=True)

    def predict(self, u: ArrayLike | None = None) -> Step:
        """Advance by a sample whose measurement is missing; `u` as in `step`.

        The state moves on by the model alone and enters the memory with its predicted covariance, so that the
        history keeps one entry for each sample time. This is the fractional Kalman filter over a lossy link
        (the paper's references 18 and 20). The filters of order and parameters do not advance. Their Q is
        adapted at each measurement, so Q is the variance of a step between two measurements, even if samples
        are lost between them. (If the covariances of these filters grew in a gap, a loss of 20 % of the
        samples would move α on white noise from 0.39 to 0.60.)
        """
        drive = self._drive(u)
        with np.errstate(all="ignore"):
            A = self.system.A(self.parameter.mean)
            rate = A @ self.states.values[0] + drive
            at = difference(self.order.mean[0], self.system.h, self.states.values)
            x, P = predict_state(A, rate, at, self.covariances.values, self._Q)
            C = self.system.C
            return self._finish(x, P, np.full(len(C), np.nan), symmetric(C @ P @ C.T + self._R))

    def run(self, ys: Iterable[ArrayLike | None], us: Iterable[ArrayLike | None] | None = None) -> list[Step]:
        """Process a record and return all steps.

        None stands for a missing sample; us[k] is the input that led to ys[k]. Raises ValueError for the same
        reasons as `step`. It also raises ValueError if the lengths of `ys` and `us` differ, after the samples
        that are in both have been processed.
        """
        if us is None:
            return [self.step(y) for y in ys]
        return [self.step(y, u) for y, u in zip(ys, us, strict=True)]

    def _drive(self, u: ArrayLike | None) -> Array:
        """Return the effect B u of input `u` on the state, (N,)."""
        B = self.system.B
        if u is None:
            return np.zeros(len(self._Q))
        if B is None:
            raise ValueError("this system has no input: give System a matrix B or leave u out")
        return B @ _vector("u", u, B.shape[1])

    def _remember(self, x: Array, P: Array) -> None:
        self.states.push(x)
        self.covariances.push(P)

    def _finish(self, x: Array, P: Array, innovation: Array, innovation_variance: Array) -> Step:
        """Store the state in the memory, and return all estimates."""
        self._remember(x, P)
        order, parameter = self.order, self.parameter
        estimates = (x, P, order.mean, order.P, parameter.mean, parameter.P)
        return Step(
            x=x,
            P=P,
            order=float(order.mean[0]),
            order_variance=float(order.P[0, 0]),
            w=parameter.mean,
            Pw=parameter.P,
            innovation=innovation,
            innovation_variance=innovation_variance,
            finite=all(np.isfinite(estimate).all() for estimate in estimates),
        )


def _vector(name: str, value: ArrayLike, size: int) -> Array:
    """Return `value` as a finite vector (size,); a plain number is accepted for size 1."""
    vector = np.atleast_1d(np.asarray(value, dtype=np.float64))
    if vector.shape != (size,):
        raise ValueError(f"{name} must have shape ({size},), got {vector.shape}")
    if not np.isfinite(vector).all():
        raise ValueError(f"{name} must be finite, got {vector}; pass y=None for a missing measurement")
    return vector
