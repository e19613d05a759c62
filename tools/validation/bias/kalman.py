"""A plain Kalman filter for the rate of a sensor at rest, as navigation programs have it.

It is written in numpy, with the equations of textbooks.

Its states are a bias with a random walk and Gauss-Markov processes. It shares no code with fltea's filters.
"""

import math
from typing import NamedTuple

import numpy as np
from fltea.records.arrays import Array


class Model(NamedTuple):
    """The noise figures of the filter, in degrees and seconds."""

    N: float
    """Angle random walk N [(deg/s)/√Hz]."""
    K: float
    """Rate random walk K of the bias [deg/s/√s]."""
    gauss_markov: tuple[tuple[float, float], ...]
    """Standard deviation σ [deg/s] and correlation time τ [s] of each Gauss-Markov state."""
    bias: float
    bias_std: float


class Plain:
    """The Kalman filter. `h`: sampling period [s]."""

    def __init__(self, model: Model, h: float) -> None:
        sigma, tau = (np.array([one[i] for one in model.gauss_markov]) for i in (0, 1))
        decay = np.exp(-h / tau)
        self._h, self._R = h, model.N**2 / h
        self._phi = np.append(1.0, decay)
        self._Q = np.append(model.K**2 * h, sigma**2 * (1 - decay**2))
        self.P = np.diag(np.append(model.bias_std**2, sigma**2))
        self.x = np.zeros(len(self._phi))
        self.x[0] = model.bias

    def run(self, y: Array) -> None:
        """Filter the samples `y` of shape (n,).

        Loops over numbers are used, since they are faster than arrays for so few states.
        """
        phi, Q, R = self._phi.tolist(), self._Q.tolist(), self._R
        x, P = self.x.tolist(), self.P.tolist()
        states = range(len(x))
        for sample in y.tolist():
            x = [phi[i] * x[i] for i in states]
            P = [[phi[i] * phi[j] * P[i][j] for j in states] for i in states]
            for i in states:
                P[i][i] += Q[i]
            column = [sum(row) for row in P]
            whole, off = sum(column) + R, sample - sum(x)
            x = [x[i] + column[i] * off / whole for i in states]
            P = [[P[i][j] - column[i] * column[j] / whole for j in states] for i in states]
        self.x, self.P = np.array(x), np.array(P)

    def heading(self, n: int) -> tuple[float, float]:
        """Return the angle to which the bias adds up during the next n samples.

        The second value is the standard deviation of this angle.
        """
        size = len(self._phi)
        step, noise = np.zeros((size + 1, size + 1)), np.zeros((size + 1, size + 1))
        step[:size, :size], step[size, :size], step[size, size] = np.diag(self._phi), self._h * self._phi, 1.0
        noise[:size, :size] = np.diag(self._Q)
        noise[size, :size] = noise[:size, size] = self._h * self._Q
        noise[size, size] = self._h**2 * (self._Q.sum() + self._R)
        F, Q = np.eye(size + 1), np.zeros((size + 1, size + 1))
        while n:  # Predict over n samples by repeatedly doubling the length of the step.
            if n & 1:
                F, Q = step @ F, step @ Q @ step.T + noise
            step, noise, n = step @ step, step @ noise @ step.T + noise, n >> 1
        row = F[size, :size]
        return float(row @ self.x), math.sqrt(float(row @ self.P @ row) + float(Q[size, size]))
