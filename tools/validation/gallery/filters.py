"""Low-passes as chips have them: noise at an inner rate goes through the filter, and every m-th is kept."""

import cmath
import math
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from tools.validation.gallery.parts import Relaxation
from tools.validation.gallery.recursions import OnePole, Relaxing, TwoPoles

Array = NDArray[np.float64]

AT_ONCE = 1 << 22
"""Inner samples, so that of a long record little is in memory."""
OVER_CORNER = 8.0
"""Inner rate over the corner, at least."""


class Filter(Protocol):
    """A low-pass with a gain of 1 at low frequencies."""

    def every(self, rate_hz: float) -> int:
        """Inner samples to one that is kept."""
        ...

    def running(self, inner_hz: float) -> "Running":
        """One that has seen nothing yet."""
        ...

    def power(self, lam: Array, inner_hz: float) -> Array:
        """Its gain, squared, at λ in rad an inner sample."""
        ...


class Running(Protocol):
    """A filter at work, piece by piece."""

    def run(self, e: Array) -> Array:
        """The output of one piece."""
        ...


class _Gained:
    def __init__(self, pole: float) -> None:
        self._gain, self._recursion = 1 - pole, OnePole(pole)

    def run(self, e: Array) -> Array:
        return np.asarray(self._recursion.run(self._gain * e), dtype=np.float64)


class _Taps:
    def __init__(self, taps: Array) -> None:
        self._taps, self._before = taps, np.zeros(len(taps) - 1)

    def run(self, e: Array) -> Array:
        full = np.concatenate([self._before, e])
        self._before = full[len(full) - len(self._before) :]
        return np.asarray(np.convolve(full, self._taps, mode="valid"))


class OneRealPole(NamedTuple):
    """exp(-2π hz / inner rate)."""

    hz: float
    inner_hz: float = 0.0
    """of the chip; 0: several times the corner"""

    def every(self, rate_hz: float) -> int:
        """See `Filter`."""
        wanted = self.inner_hz or OVER_CORNER * self.hz
        return max(1, math.ceil(wanted / rate_hz - 1e-9))

    def _pole(self, inner_hz: float) -> float:
        return math.exp(-2 * math.pi * self.hz / inner_hz)

    def running(self, inner_hz: float) -> Running:
        """See `Filter`."""
        return _Gained(self._pole(inner_hz))

    def power(self, lam: Array, inner_hz: float) -> Array:
        """See `Filter`."""
        p = self._pole(inner_hz)
        return np.asarray((1 - p) ** 2 / ((1 - p) ** 2 + 4 * p * np.sin(lam / 2) ** 2))


class Butterworth2(NamedTuple):
    """Two poles at hz, 45 degrees off the axis, mapped by exp(s / inner rate)."""

    hz: float

    def every(self, rate_hz: float) -> int:
        """See `Filter`."""
        return max(1, math.ceil(OVER_CORNER * self.hz / rate_hz - 1e-9))

    def _pole(self, inner_hz: float) -> complex:
        return cmath.exp(2 * math.pi * self.hz / inner_hz * cmath.exp(0.75j * math.pi))

    def running(self, inner_hz: float) -> Running:
        """See `Filter`."""
        return TwoPoles(self._pole(inner_hz))

    def power(self, lam: Array, inner_hz: float) -> Array:
        """See `Filter`."""
        p, z = self._pole(inner_hz), np.exp(-1j * lam)
        return np.asarray(abs(1 - p) ** 4 / np.abs((1 - p * z) * (1 - p.conjugate() * z)) ** 2)


class Fir(NamedTuple):
    """A finite response at the output's own rate."""

    taps: tuple[float, ...]

    def every(self, rate_hz: float) -> int:
        """See `Filter`."""
        return 1

    def running(self, inner_hz: float) -> Running:
        """See `Filter`."""
        return _Taps(np.array(self.taps))

    def power(self, lam: Array, inner_hz: float) -> Array:
        """See `Filter`."""
        return np.asarray(np.abs(np.exp(-1j * np.outer(lam, np.arange(len(self.taps)))) @ self.taps) ** 2)


def moving_average(taps: int) -> Fir:
    """The mean of the last so many."""
    return Fir((1 / taps,) * taps)


def windowed_sinc(cut: float, taps: int = 31) -> Fir:
    """Hamming's window; cut: share of the sample rate."""
    k = np.arange(taps) - (taps - 1) / 2
    response = np.sinc(2 * cut * k) * np.hamming(taps)
    return Fir(tuple((response / response.sum()).tolist()))


MPU9250_DLPF = {250: 0.97, 184: 2.9, 92: 3.9, 41: 5.9, 20: 9.9, 10: 17.85, 5: 33.48}
"""Bandwidths in Hz and delays in ms of the gyroscope, from the register map."""
CONSTANT_DELAY_MS = 1.9
"""What the delays have beyond that of one pole, 0.159 / bandwidth: so the filter is one pole."""


def mpu9250(bandwidth_hz: int) -> OneRealPole:
    """As the delays say; inside it runs at 1 kHz, or at 8 kHz with 250 Hz."""
    return OneRealPole(bandwidth_hz, 8_000.0 if bandwidth_hz == 250 else 1_000.0)


class Through(NamedTuple):
    """White noise, and relaxations, that have gone through a filter."""

    low_pass: Filter
    inner: tuple[Relaxation, ...] = ()

    def draw(self, n: int, rate_hz: float, rng: np.random.Generator) -> Array:
        """See `Part`."""
        m = self.low_pass.every(rate_hz)
        inner_hz = m * rate_hz
        running = self.low_pass.running(inner_hz)
        running.run(rng.standard_normal(1 << 14))  # so that it has forgotten its start
        slow = [(math.sqrt(one.height), Relaxing(one.hz, inner_hz, rng)) for one in self.inner]
        out, piece = np.empty(n), max(1, AT_ONCE // m)
        for at in range(0, n, piece):
            count = min(piece, n - at) * m
            e = rng.standard_normal(count)
            for size, one in slow:
                e += size * one.next(count)
            # m times the variance is the same density below the corner.
            out[at : at + count // m] = running.run(math.sqrt(m) * e)[::m]
        return out

    def spectrum(self, lam: Array, rate_hz: float) -> Array:
        """See `Part`; folded at half the rate as often as it is."""
        m = self.low_pass.every(rate_hz)
        found = np.zeros_like(lam)
        for k in range(m):
            inside = (lam + 2 * np.pi * k) / m
            before = 1.0 + sum(one.spectrum(inside, m * rate_hz) for one in self.inner)
            found += before * self.low_pass.power(inside, m * rate_hz)
        return found
