"""Simulate fractional noise and fractional systems of known order and parameter.

The model (Macias & Sierociuk 2023, sections 3, 4 and 6) has one state and the time step h in s:

    x_{k+1} = h^α_{k+1} (f x_k + u_k + ω_k) - sum_{j=1}^{min(k+1, window)} c_j(α_{k+1}) x_{k+1-j}
    y_k = x_k + v_k,    var ω = Q,    var v = R

The weights c_j are those of `fltea.noise.weights`. y and x are in deg/s, f in s^-α, Q in (deg/s)² s^-2α, R in
(deg/s)². Q = 0 gives white noise. Q here is the variance of ω, before the factor h^α. The Q of the paper's
state filter is the variance that one step adds to the state, which is h^2α times the Q here.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fltea.noise.memory import NewestFirst
from fltea.noise.spectra import HIGHEST_ORDER, stationary
from fltea.noise.weights import weights
from fltea.records.arrays import Array

Order = float | Sequence[float] | Array


class FractionalNoise:
    """Endless fractional noise. `step()` returns the next measurement, and the state without white noise.

    Args:
        alpha: order of all samples, or a sequence: alpha[k-1] is the order of sample k = 1, 2, ..., and the
            last value is the order of all later samples.
        f: parameter in s^-α.
        Q: variance of ω, the noise that drives the state.
        R: variance of v, the white noise.
        h: time step [s].
        window: length of the memory in samples.
        seed: an integer or a numpy Generator; equal seeds give equal samples.
        warmup: number of steps, with the first order, that are computed and discarded before the first
            sample, so that a stationary state starts near its stationary variance rather than at 0.

    Raises:
        ValueError: Q or R < 0, h <= 0, window < 1, numbers that are not finite, or noise that diverges.
    """

    def __init__(
        self,
        alpha: Order,
        f: float,
        Q: float,
        R: float,
        h: float,
        window: int = 3000,
        seed: int | np.random.Generator = 0,
        *,
        warmup: int = 0,
    ) -> None:
        _check_system(f, Q, R, h)
        if warmup < 0:
            raise ValueError(f"warmup must be >= 0 samples, got {warmup}")
        self._orders = np.atleast_1d(np.asarray(alpha, dtype=np.float64))
        if self._orders.ndim != 1 or not len(self._orders) or not np.isfinite(self._orders).all():
            raise ValueError("alpha must be a finite number, or a sequence of them")
        if Q:
            for order in (self._orders.min(), self._orders.max()):
                _check_bounded(float(order), f, h)
        self._f, self._h = f, h
        self._omega_std, self._v_std = math.sqrt(Q), math.sqrt(R)
        self._rng = np.random.default_rng(seed)
        self._history = NewestFirst(window)
        self._history.push(0.0)
        self._x = 0.0
        self._k = 0
        # Cache of the fractional difference's weights for the last order. If the order is constant, they are
        # computed only once.
        self._weights_of: float | None = None
        self._weights = np.empty(0)
        self._advance(0.0, warmup)

    def step(self, u: float = 0.0) -> tuple[float, float]:
        """Return measurement and state (y_k, x_k) for the next k = 1, 2, ...; `u` is the input u_{k-1}."""
        self._advance(u, 1)
        self._k += 1
        return self._x + self._v_std * self._rng.standard_normal(), self._x

    def samples(self, n: int) -> tuple[Array, Array]:
        """Return the next n measurements y and states x, each of shape (n,)."""
        pairs = np.array([self.step() for _ in range(n)]).reshape(n, 2)
        return pairs[:, 0], pairs[:, 1]

    def _advance(self, u: float, steps: int) -> None:
        alpha = float(self._orders[min(self._k, len(self._orders) - 1)])
        if alpha != self._weights_of:
            self._weights = weights(alpha, self._history.window)
            self._weights_of = alpha
        c, gain = self._weights, self._h**alpha
        for _ in range(steps):
            past = self._history.values
            omega = self._omega_std * self._rng.standard_normal()
            self._x = float(gain * (self._f * self._x + u + omega) - c[1 : len(past) + 1] @ past)
            self._history.push(self._x)


def quantise(y_dps: ArrayLike, lsb_per_dps: float, full_scale_dps: float) -> NDArray[np.int16]:
    """Return the counts that a sensor with `lsb_per_dps` and range ±`full_scale_dps` reads for rates `y_dps`.

    Counts saturate at ±full_scale_dps or at the limits of int16, whichever is smaller (at ±2000 deg/s and
    16.4 LSB/(deg/s), the limits of int16 are). Raises ValueError for NaN and for scales <= 0.
    """
    _check_positive("lsb_per_dps", lsb_per_dps)
    _check_positive("full_scale_dps", full_scale_dps)
    y = np.asarray(y_dps, dtype=np.float64)
    if np.isnan(y).any():
        raise ValueError("a NaN has no count: leave missing samples out")
    counts = np.rint(np.clip(y, -full_scale_dps, full_scale_dps) * lsb_per_dps)
    limits = np.iinfo(np.int16)
    return np.clip(counts, limits.min, limits.max).astype(np.int16)


def _check_positive(name: str, value: float) -> None:
    if not (math.isfinite(value) and value > 0):
        raise ValueError(f"{name} must be > 0, got {value}")


def _check_system(f: float, Q: float, R: float, h: float) -> None:
    _check_positive("h", h)
    if not math.isfinite(f):
        raise ValueError(f"f must be a finite number, got {f}")
    for name, value in (("Q", Q), ("R", R)):
        if not (math.isfinite(value) and value >= 0):
            raise ValueError(f"{name} is a variance and must be >= 0, got {value}")


def _check_bounded(alpha: float, f: float, h: float) -> None:
    """Raise ValueError if the state x diverges with these parameters of the noise.

    f = 0 gives integrated noise, which wanders but is accepted.
    """
    if f == 0 and abs(alpha) <= HIGHEST_ORDER:
        return
    if not abs(alpha) < HIGHEST_ORDER:
        raise ValueError(f"alpha = {alpha:g}: such noise runs away; give an order below {HIGHEST_ORDER:g}")
    if stationary(alpha, h**alpha * f):
        return
    lowest = -((2 / h) ** alpha)
    why = f"f = {f:g}: at alpha = {alpha:g} and {1 / h:g} Hz noise runs away below f = {lowest:.3g}"
    if f > 0:
        why = f"f = {f:g}: noise runs away where f is positive; give 0 or below"
    raise ValueError(why)
