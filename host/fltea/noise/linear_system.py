"""A linear state-space model (a system) of a sensor's noise, and states that can be added to it.

    x_k+1 = A x_k + w_k,   cov w = Q
    y_k   = offset + c x_k + v_k,   var v = R

A is diagonal except for the two states of each complex pole, so that a filter needs only a few products per
state and sample.
"""

import math
from typing import NamedTuple

import numpy as np

from fltea.records.arrays import Array

DIFFUSE = 1e4
"""The prior variance of an unknown offset is this many times the variance of the noise."""
STRAIGHT = 100
"""The state that stands for a slope of the offset decays with a time constant of this many lengths of the
record.
"""


class Coordinate(NamedTuple):
    """An additional state of a system, which depends on no other state.

    It is added to each sample with weight 1.
    """

    a: float
    q: float
    """Variance of the noise that is added to the state in each step."""
    variance: float
    """Variance of the state before the first sample."""
    signal: float
    """1 if the state is signal, which is part of the bias; 0 if it is coloured noise."""
    shared: float = 0.0
    """Variance that is added to the prior variance of the state before this one. The prior covariance of the
    two states is minus this value. If it equals `variance`, their sum has the prior variance that the state
    before had alone.
    """


def offset_of(power: float, q: float = 0.0, *, of_state: bool = False) -> Coordinate:
    """Return the state for an offset of unknown value. Further arguments are those of `System.with_offset`.

    `power`: prior variance of a sample, without the offset.
    """
    return Coordinate(1.0, q, DIFFUSE * power, float(of_state))


def relaxation_of(variance: float, a: float) -> Coordinate:
    """Return the state for an additional relaxation. The arguments are those of `System.with_relaxation`."""
    return Coordinate(a, variance * (1 - a * a), variance, 1.0)


def ramp_of(slope: float, samples: int) -> Coordinate:
    """Return the state for a slope of the offset. It has to be added directly after the state of the offset.

    The arguments are those of `System.with_ramp`.
    """
    slow = STRAIGHT * samples
    variance = (slope * slow) ** 2
    # A sample contains the offset plus this state. Without a correction, the new state would make the
    # variance of the first samples larger. So the last argument (`shared`) says that the offset begins with
    # minus this state, and their sum has the variance that the offset had alone.
    return Coordinate(math.exp(-1 / slow), 0.0, variance, 0.0, variance)


class System(NamedTuple):
    """A linear state-space model of a sensor's noise, with n states.

    The states of complex pole pairs come first; the two states of a pair are neighbours.
    """

    pairs: int
    """Number of pole pairs."""
    a: Array
    """Diagonal of A, (n,)."""
    b: Array
    """Imaginary parts of the poles, (n,): A[i, i + 1] = b[i], A[i + 1, i] = -b[i]; 0 for real poles."""
    Q: Array
    """Covariance of the noise that is added to the states in each step, (n, n)."""
    c: Array
    """Weight of each state in a sample, (n,)."""
    signal: Array
    """1 for each state that is signal (part of the bias), 0 for coloured noise, (n,)."""
    P0: Array
    """Covariance of the states before the first sample, (n, n)."""
    R: float
    walks: bool
    """Whether the signal has no mean, as with a random walk. Then an offset cannot be distinguished from the
    signal.
    """

    @property
    def A(self) -> Array:
        """Matrix by which the states are multiplied in each step, (n, n)."""
        result = np.diag(self.a)
        for i in range(0, 2 * self.pairs, 2):
            result[i, i + 1], result[i + 1, i] = self.b[i], -self.b[i]
        return result

    @property
    def bias(self) -> Array:
        """Weight of each state in the bias, (n,).

        The bias is the sum of signal, offset and slope of the offset.
        """
        of_offset = (self.a == 1.0) | (np.diag(self.Q) == 0.0)
        return np.asarray(np.maximum(self.signal, of_offset) * self.c)

    def with_offset(self, q: float = 0.0, *, of_state: bool = False) -> "System":
        """Return the system with an offset of unknown value as its last state.

        `q`: variance of a step of the offset's random walk. `of_state`: whether the offset counts as signal
            (its element of `signal` is then 1), like a random walk among the parts of the noise.
        """
        found = self.with_coordinate(offset_of(self.power, q, of_state=of_state))
        return found._replace(walks=self.walks or of_state)

    def with_relaxation(self, variance: float, a: float) -> "System":
        """Return the system with one more relaxation as its last state, which is a part of the bias.

        `variance`, `a`: variance and pole of the relaxation.
        """
        return self.with_coordinate(relaxation_of(variance, a))

    def with_ramp(self, slope: float, samples: int) -> "System":
        """Return the system with a slope of the offset as its last state.

        With the slope, the offset is a straight line in time. The last state so far has to be the constant
        offset. A is diagonal except for pairs of poles, which allows no exact slope. So the slope is
        described as a slowly decaying relaxation without noise. Within the record, the line bends by less
        than 1 / `STRAIGHT` of its rise.

        Args:
            slope: prior standard deviation of the slope, per sample.
            samples: length of the record.

        Raises:
            ValueError: the last state is no offset.
        """
        if not (len(self.a) and self.a[-1] == 1.0):
            raise ValueError("only an offset can have a slope, and it has to be the last state")
        return self.with_coordinate(ramp_of(slope, samples))

    def with_coordinate(self, one: Coordinate) -> "System":
        """Return the system with one more state, `one`, as its last."""
        n = len(self.a)
        Q, P0 = np.zeros((n + 1, n + 1)), np.zeros((n + 1, n + 1))
        Q[:n, :n], P0[:n, :n], Q[n, n], P0[n, n] = self.Q, self.P0, one.q, one.variance
        if one.shared:
            P0[n - 1, n - 1] += one.shared
            P0[n - 1, n] = P0[n, n - 1] = -one.shared
        columns = zip((self.a, self.b, self.c, self.signal), (one.a, 0.0, 1.0, one.signal), strict=True)
        longer = [np.append(column, value) for column, value in columns]
        return System(self.pairs, longer[0], longer[1], Q, longer[2], longer[3], P0, self.R, self.walks)

    @property
    def power(self) -> float:
        """Variance of a sample, computed from the covariance of the states before the first sample."""
        return self.R + float(self.c @ self.P0 @ self.c)

    @property
    def numbers(self) -> tuple[int, Array, Array, Array, Array, Array, Array, Array, float]:
        """The system as arguments of the native module.

        The native `signal` is the weight of each state in a sample if the state is signal, and else 0.
        """
        signal = self.signal * self.c
        return self.pairs, self.a, self.b, self.Q, self.c, signal, self.bias, self.P0, self.R

    def spectrum(self, lam: Array) -> Array:
        """Return the spectrum that samples of the system have at λ > 0, in rad per sample."""
        n = len(self.a)
        turn = np.exp(1j * np.asarray(lam))[:, None, None] * np.eye(n)
        row = np.linalg.solve(
            np.swapaxes(turn - self.A, 1, 2), np.broadcast_to(self.c[:, None], (len(lam), n, 1))
        )
        row = row[:, :, 0]
        return np.asarray(np.einsum("ki,ij,kj->k", row, self.Q, row.conj()).real + self.R)
