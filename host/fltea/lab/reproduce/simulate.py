"""Simulate many fractional systems of one state at once. Samples equal those of `fltea.noise.simulation`.

    x_k = h^α_k (f x_{k-1} + u_{k-1} + ω_{k-1}) - sum_{j=1}^{k} c_j(α_k) x_{k-j},    x_0 = 0

(Macias & Sierociuk 2023, section 6, equations (1) and (2), with the full memory; c_j = (-1)^j binom(α, j)).

All runs share the orders α_k. For a block of samples, the sum over states before the block is one matrix
product for all runs. Only the sum over states within the block is computed sample by sample. Runs are
processed in groups of a fixed width, so that the samples of one seed do not depend on the number of runs.
"""

import numpy as np

from fltea.noise.weights import weights
from fltea.records.arrays import Array

BLOCK = 64
"""Number of samples in a block. The states before a block are summed for all samples of the block at once."""
WIDTH = 64
"""Number of runs in one matrix product."""


def fractional_states(alpha: Array, f: float, drive: Array, h: float) -> Array:
    """Return the states x_1 .. x_n of many runs of one system, shape (n, runs).

    Args:
        alpha: orders α_1 .. α_n, (n,).
        f: parameter in s^-α.
        drive: input and noise u_{k-1} + ω_{k-1} in row k-1, (n, runs).
        h: step [s].
    """
    n, runs = drive.shape
    if runs > WIDTH:
        groups = (drive[:, left : left + WIDTH] for left in range(0, runs, WIDTH))
        return np.hstack([fractional_states(alpha, f, group, h) for group in groups])
    gain = h**alpha
    x = np.zeros((n + 1, WIDTH))  # row k is x_k, and row 0 the initial state x_0
    driven = np.zeros((n, WIDTH))
    driven[:, :runs] = gain[:, np.newaxis] * drive
    for start in range(1, n + 1, BLOCK):
        stop = min(start + BLOCK, n + 1)
        c = weights(alpha[start - 1 : stop - 1], stop - 1)
        # Row i of the weights is for sample k = start + i. It multiplies x_m by c_{k-m}(α_k), for m from 0 to
        # start - 1.
        lags = np.arange(start, stop)[:, np.newaxis] - np.arange(start)
        past = np.take_along_axis(c, lags, axis=1) @ x[:start]
        for i, k in enumerate(range(start, stop)):
            near = c[i, 1 : i + 1][::-1] @ x[start:k]
            x[k] = gain[k - 1] * f * x[k - 1] + driven[k - 1] - past[i] - near
    return x[1:, :runs]


def noises(seed: int, n: int, Q: float, R: float) -> tuple[Array, Array]:
    """Return process noise ω_0 .. ω_{n-1} and measurement noise v_1 .. v_n, with variances Q and R.

    Values of ω and v are drawn alternately, as in `fltea.noise.simulation`.
    """
    pairs = np.random.default_rng(seed).standard_normal((n, 2))
    return pairs[:, 0] * np.sqrt(Q), pairs[:, 1] * np.sqrt(R)
