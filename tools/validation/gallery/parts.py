"""What noises are made of: each part draws samples and knows its own spectrum in closed form.

Spectra are normalised so that white noise of variance R has R, over λ in rad a sample. All parts of a noise
have one scale: the density of its white noise is 1, whatever the rate is, as that of a sensor would be.
"""

import math
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from tools.validation.gallery.recursions import (
    OnePole,
    Relaxing,
    convolved,
    fractional_difference,
    inverse_series,
    stationary_order,
)

Array = NDArray[np.float64]

LONGEST_MEMORY = 1 << 21
"""Samples, of the project's own noise: its response has fallen off long before."""
A_DECADE = 8
"""Relaxations, in 1/f noise that is drawn as their sum: within 0.1 % of it."""


class Part(Protocol):
    """A noise, or a part of one."""

    def draw(self, n: int, rate_hz: float, rng: np.random.Generator) -> Array:
        """So many samples."""
        ...

    def spectrum(self, lam: Array, rate_hz: float) -> Array:
        """Its density at λ."""
        ...


class White(NamedTuple):
    """White noise of variance 1."""

    tails: str = "gaussian"
    """gaussian, t4 or laplace"""

    def draw(self, n: int, rate_hz: float, rng: np.random.Generator) -> Array:
        """See `Part`."""
        if self.tails == "t4":
            return rng.standard_t(4, n) / math.sqrt(2)
        if self.tails == "laplace":
            return rng.laplace(size=n) / math.sqrt(2)
        return rng.standard_normal(n)

    def spectrum(self, lam: Array, rate_hz: float) -> Array:
        """See `Part`."""
        return np.ones_like(lam)


class Relaxation(NamedTuple):
    """AR(1), the pole at exp(-2π hz / rate)."""

    hz: float
    height: float
    """density at low frequencies"""

    def draw(self, n: int, rate_hz: float, rng: np.random.Generator) -> Array:
        """See `Part`."""
        return math.sqrt(self.height) * Relaxing(self.hz, rate_hz, rng).next(n)

    def spectrum(self, lam: Array, rate_hz: float) -> Array:
        """See `Part`."""
        pole = math.exp(-2 * math.pi * self.hz / rate_hz)
        return np.asarray(self.height * (1 - pole) ** 2 / ((1 - pole) ** 2 + 4 * pole * np.sin(lam / 2) ** 2))


class AR1(NamedTuple):
    """AR(1) of a given coefficient, whatever the rate; may be negative."""

    pole: float
    step: float
    """variance of its innovations"""

    def draw(self, n: int, rate_hz: float, rng: np.random.Generator) -> Array:
        """See `Part`."""
        start = rng.standard_normal() / math.sqrt(1 - self.pole**2)
        x = OnePole(self.pole, start).run(rng.standard_normal(n))
        return math.sqrt(self.step) * np.asarray(x, dtype=np.float64)

    def spectrum(self, lam: Array, rate_hz: float) -> Array:
        """See `Part`."""
        return np.asarray(self.step / ((1 - self.pole) ** 2 + 4 * self.pole * np.sin(lam / 2) ** 2))


class Arfima(NamedTuple):
    """ARFIMA(p, d, q) with p, q of 0 or 1, by its autocovariance and then its poles and zeros."""

    d: float
    step: float
    ar: float = 0.0
    ma: float = 0.0

    def draw(self, n: int, rate_hz: float, rng: np.random.Generator) -> Array:
        """See `Part`."""
        before = 0 if self.ar == self.ma == 0 else 2_000  # the pole has forgotten its start by then
        x = stationary_order(self.d, n + before + 1, rng)
        if before:
            x[1:] += self.ma * x[:-1].copy()
            x = np.asarray(OnePole(self.ar).run(x), dtype=np.float64)
        return math.sqrt(self.step) * x[-n:]

    def spectrum(self, lam: Array, rate_hz: float) -> Array:
        """See `Part`."""
        z = np.exp(-1j * lam)
        short = np.abs((1 + self.ma * z) / (1 - self.ar * z)) ** 2
        return np.asarray(self.step * short * (2 * np.sin(lam / 2)) ** (-2 * self.d))


class Fractional(NamedTuple):
    """The project's own state, D^α x = f x + ω, by the impulse response of its recursion."""

    alpha: float
    f: float
    """in s^-α"""
    step: float
    """variance of a whole step"""

    def g(self, rate_hz: float) -> float:
        """h^α f; where a slow rate would make x grow, f is what gives half of the least g, -2^α."""
        return max(float(rate_hz**-self.alpha) * self.f, -float(2.0**self.alpha) / 2)

    def draw(self, n: int, rate_hz: float, rng: np.random.Generator) -> Array:
        """See `Part`."""
        if self.f == 0:
            # Begins a record before the first sample; what was earlier would be an offset.
            length = n + 1
            response = fractional_difference(self.alpha, length)
        else:
            length = min(LONGEST_MEMORY, 1 << (max(n, 1 << 16) - 1).bit_length())
            weights = fractional_difference(-self.alpha, length)
            weights[1] -= self.g(rate_hz)
            response = inverse_series(weights)
        return math.sqrt(self.step) * convolved(rng.standard_normal(n + length - 1), response, n)

    def spectrum(self, lam: Array, rate_hz: float) -> Array:
        """See `Part`."""
        z = np.exp(-1j * lam)
        return np.asarray(self.step / np.abs((1 - z) ** self.alpha - self.g(rate_hz) * z) ** 2)


def flicker(corner_hz: float, rate_hz: float) -> Fractional:
    """1/f noise, the order 1/2 exactly, as dense as white noise of 1 at its corner."""
    return Fractional(0.5, 0.0, 2 * math.pi * corner_hz / rate_hz)


class Flicker(NamedTuple):
    """1/f noise by fractional differencing of order 1/2."""

    corner_hz: float
    """where it is as dense as the white noise"""

    def draw(self, n: int, rate_hz: float, rng: np.random.Generator) -> Array:
        """See `Part`."""
        return flicker(self.corner_hz, rate_hz).draw(n, rate_hz, rng)

    def spectrum(self, lam: Array, rate_hz: float) -> Array:
        """See `Part`."""
        return flicker(self.corner_hz, rate_hz).spectrum(lam, rate_hz)


class Ladder(NamedTuple):
    """Relaxations of equal power, so many a decade from low_hz to high_hz: 1/f noise between these."""

    low_hz: float
    high_hz: float
    a_decade: float
    corner_hz: float
    """where 1/f noise of its level is as dense as the white noise"""

    @property
    def steps(self) -> tuple[Relaxation, ...]:
        """One by one."""
        count = round(math.log10(self.high_hz / self.low_hz) * self.a_decade) + 1
        corners = np.geomspace(self.low_hz, self.high_hz, count).tolist()
        # Of heights L / c the sum over the corners c at f is about L a_decade / ln 10 · π / (2 f).
        level = self.corner_hz * math.log(10) / (self.a_decade * math.pi / 2)
        return tuple(Relaxation(corner, level / corner) for corner in corners)

    def draw(self, n: int, rate_hz: float, rng: np.random.Generator) -> Array:
        """See `Part`."""
        y = np.zeros(n)
        for one in self.steps:
            y += one.draw(n, rate_hz, rng)
        return y

    def spectrum(self, lam: Array, rate_hz: float) -> Array:
        """See `Part`."""
        return np.asarray(np.sum([one.spectrum(lam, rate_hz) for one in self.steps], axis=0))


class Walk(NamedTuple):
    """A random walk."""

    corner_hz: float
    """where it is as dense as the white noise"""

    def _step(self, rate_hz: float) -> float:
        return 2 * math.pi * self.corner_hz / rate_hz

    def draw(self, n: int, rate_hz: float, rng: np.random.Generator) -> Array:
        """See `Part`."""
        return np.cumsum(self._step(rate_hz) * rng.standard_normal(n))

    def spectrum(self, lam: Array, rate_hz: float) -> Array:
        """See `Part`."""
        return np.asarray((self._step(rate_hz) / (2 * np.sin(lam / 2))) ** 2)


class Resonance(NamedTuple):
    """A pair of complex poles at a share of the sample rate."""

    share: float
    """of the sample rate"""
    q: float
    """centre over width at half the power"""
    peak: float
    """density at the peak, about"""

    @property
    def pole(self) -> complex:
        """The one of positive frequency."""
        at = 2 * math.pi * self.share
        return complex(math.exp(-at / (2 * self.q)) * np.exp(1j * at))

    def draw(self, n: int, rate_hz: float, rng: np.random.Generator) -> Array:
        """See `Part`."""
        p = self.pole
        before = min(int(40 * self.q / self.share / (2 * math.pi)), 1 << 20)
        x = OnePole(p).run(rng.standard_normal(n + before))
        y = (2 * p / (p - p.conjugate()) * x).real
        return math.sqrt(self.peak * self._scale) * np.asarray(y[before:])

    def spectrum(self, lam: Array, rate_hz: float) -> Array:
        """See `Part`."""
        return np.asarray(self.peak * self._scale * self._raw(np.asarray(lam)))

    @property
    def _scale(self) -> float:
        return 1 / float(self._raw(np.array([2 * math.pi * self.share]))[0])

    def _raw(self, lam: Array) -> Array:
        z = np.exp(-1j * lam)
        return np.asarray(1 / np.abs((1 - self.pole * z) * (1 - self.pole.conjugate() * z)) ** 2)


class Differenced(NamedTuple):
    """The difference of neighbours of white noise."""

    power: float

    def draw(self, n: int, rate_hz: float, rng: np.random.Generator) -> Array:
        """See `Part`."""
        return math.sqrt(self.power) * np.diff(rng.standard_normal(n + 1))

    def spectrum(self, lam: Array, rate_hz: float) -> Array:
        """See `Part`."""
        return np.asarray(self.power * 4 * np.sin(lam / 2) ** 2)
