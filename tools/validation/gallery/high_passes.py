"""Noise whose low frequencies have been removed by AC coupling or by an auto-zero."""

import math
from typing import NamedTuple

import numpy as np
from fltea.records.arrays import Array
from scipy.signal import butter, freqz

from tools.validation.gallery.parts import Relaxation
from tools.validation.recursions import Stream

SETTLED = 20.0
"""Number of time constants after which a filter has forgotten its initial state."""


class Coupled(NamedTuple):
    """White noise and relaxations after a high-pass filter.

    The filter has one pole, or is a Butterworth filter with more poles.
    """

    hz: float
    poles: int = 1
    inner: tuple[Relaxation, ...] = ()

    def coefficients(self, rate_hz: float) -> tuple[list[float], list[float]]:
        """Return the numerator and the denominator of the filter as polynomials in z⁻¹."""
        if self.poles == 1:
            pole = math.exp(-2 * math.pi * self.hz / rate_hz)
            return [1.0, -1.0], [1.0, -pole]
        b, a = butter(self.poles, 2 * self.hz / rate_hz, "high")
        return b.tolist(), a.tolist()

    def draw(self, n: int, rate_hz: float, rng: np.random.Generator) -> Array:
        """Return `n` samples."""
        before = math.ceil(SETTLED * rate_hz / (2 * math.pi * self.hz))
        y = rng.standard_normal(before + n)
        for one in self.inner:
            y += one.draw(before + n, rate_hz, rng)
        return Stream(*self.coefficients(rate_hz)).run(y)[before:]

    def gain(self, lam: Array, rate_hz: float) -> Array:
        """Return the squared gain of the high-pass."""
        return np.asarray(np.abs(freqz(*self.coefficients(rate_hz), worN=lam)[1]) ** 2)

    def spectrum(self, lam: Array, rate_hz: float) -> Array:
        """See `Part`."""
        before = 1.0 + sum(one.spectrum(lam, rate_hz) for one in self.inner)
        return np.asarray(before * self.gain(lam, rate_hz))


class AutoZeroed(NamedTuple):
    """White noise minus the mean of the last `t_s` seconds, including the newest sample."""

    t_s: float

    def draw(self, n: int, rate_hz: float, rng: np.random.Generator) -> Array:
        """Return `n` samples."""
        m = round(self.t_s * rate_hz)
        y = rng.standard_normal(n + m)
        sums = np.append(0.0, np.cumsum(y))
        return np.asarray(y[m:] - (sums[m + 1 :] - sums[1:-m]) / m)

    def spectrum(self, lam: Array, rate_hz: float) -> Array:
        """See `Part`."""
        m = round(self.t_s * rate_hz)
        mean = np.exp(-0.5j * (m - 1) * lam) * np.sin(m * lam / 2) / (m * np.sin(lam / 2))
        return np.asarray(np.abs(1 - mean) ** 2)
