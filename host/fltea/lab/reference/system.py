"""Configure the reference estimator: the system, and the settings of its three filters.

The paper (Macias & Sierociuk 2023) gives the meaning of the settings in section 5, and their values in 6.1
and 7.1. If a number is given for a covariance, the covariance is that number times the identity matrix.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from fltea.records.arrays import Array


@dataclass(frozen=True)
class System:
    """The system D^α x_{k+1} = A(w) x_k + B u_k, y_k = C x_k, with sampling period h."""

    A: Callable[[Array], Array]
    """A function that maps parameters (n_w,) to the matrix A (N, N) in s^-α. It must not raise an error, even
    for infinite parameters.
    """
    B: Array | None
    """Input matrix, (N, d); None if the system has no input."""
    C: Array
    """Output matrix, (p, N)."""
    h: float
    """Sampling period [s]."""

    def __post_init__(self) -> None:
        if not (math.isfinite(self.h) and self.h > 0):
            raise ValueError(f"h is the sampling time in seconds and must be > 0, got {self.h}")
        object.__setattr__(self, "C", _matrix("C", self.C))
        if self.B is not None:
            object.__setattr__(self, "B", _matrix("B", self.B))

    def check(self, N: int, w: Array) -> None:
        """Raise ValueError unless A(w), B and C have shapes for N states, and w is a finite vector."""
        if w.ndim != 1 or len(w) == 0 or not np.isfinite(w).all():
            raise ValueError(f"w0 must be a list of at least one finite parameter, got {w}")
        shape = np.shape(self.A(w))
        if shape != (N, N):
            raise ValueError(f"A(w0) must have shape ({N}, {N}) for x0 of {N} states, got {shape}")
        if self.C.shape[1] != N:
            raise ValueError(f"C must have {N} columns, one for each state, got shape {self.C.shape}")
        if self.B is not None and self.B.shape[0] != N:
            raise ValueError(f"B must have {N} rows, one for each state, got shape {self.B.shape}")


@dataclass(frozen=True)
class OrderSettings:
    """Settings of KFo, the filter of the order (the paper, section 5.1).

    alpha0: initial order. P0: its variance. Q0: initial variance of a step of the order's random walk. delta:
    forgetting factor by which Q follows the corrections. R (p, p): covariance of the measurement noise, in
    the square of the unit of y. With P0 = Q0 = 0 the order stays fixed at alpha0.
    """

    P0: float
    Q0: float
    alpha0: float
    R: ArrayLike
    delta: float

    def __post_init__(self) -> None:
        covariance("order P0", self.P0, 1)
        covariance("order Q0", self.Q0, 1)
        if not math.isfinite(self.alpha0):
            raise ValueError(f"alpha0 must be a finite number, got {self.alpha0}")
        _check_delta("order", self.delta)


@dataclass(frozen=True)
class ParameterSettings:
    """Settings of KFw, the filter of the parameters (the paper, section 5.3).

    P0, Q0 (n_w, n_w): initial covariance of the estimate, and initial covariance of a step of its random
    walk. w0 (n_w,): initial parameters. R (p, p): covariance of the measurement noise.
    """

    P0: ArrayLike
    Q0: ArrayLike
    w0: ArrayLike
    R: ArrayLike
    delta: float

    def __post_init__(self) -> None:
        _check_delta("parameter", self.delta)


@dataclass(frozen=True)
class StateSettings:
    """Settings of KFx, the filter of the state (the paper, section 5.2).

    P0 (N, N): initial covariance of the state. Q (N, N): covariance of the process noise that one sampling
    period adds to the state. x0 (N,): initial state. R (p, p): covariance of the measurement noise.
    """

    P0: ArrayLike
    Q: ArrayLike
    x0: ArrayLike
    R: ArrayLike

    def __post_init__(self) -> None:
        x0 = np.atleast_1d(np.asarray(self.x0, dtype=np.float64))
        if x0.ndim != 1 or len(x0) == 0 or not np.isfinite(x0).all():
            raise ValueError(f"x0 must be a list of at least one finite state, got {x0}")


def covariance(name: str, value: ArrayLike, n: int, *, definite: bool = False) -> Array:
    """Return `value` as an (n, n) covariance matrix; a number stands for that number times the identity.

    Raise ValueError unless the matrix is symmetric and its eigenvalues are ≥ 0 (> 0 with `definite`).
    """
    P = np.array(value, dtype=np.float64)
    if P.ndim == 0:
        P = P * np.eye(n)
    if P.shape != (n, n):
        raise ValueError(f"{name} must be a number or have shape ({n}, {n}), got {P.shape}")
    if not np.isfinite(P).all() or not np.array_equal(P, P.T):
        raise ValueError(f"{name} must be finite and symmetric, got {P.tolist()}")
    smallest, largest = np.linalg.eigvalsh(P)[[0, -1]]
    if definite and smallest <= 0:
        raise ValueError(f"{name} must be positive: it is the noise of the measurement, got {P.tolist()}")
    if smallest < -1e-12 * abs(largest):
        raise ValueError(f"{name} is a covariance and must not be negative, got {P.tolist()}")
    return P


def _matrix(name: str, value: ArrayLike) -> Array:
    matrix = np.array(value, dtype=np.float64)
    if matrix.ndim != 2 or matrix.size == 0 or not np.isfinite(matrix).all():
        raise ValueError(f"{name} must be a finite matrix with two dimensions, got shape {matrix.shape}")
    return matrix


def _check_delta(name: str, delta: float) -> None:
    if not 0 <= delta <= 1:
        raise ValueError(f"{name} delta must lie in [0, 1] (0 keeps Q0 constant), got {delta}")
