"""The parts of noises. Each part can draw samples, and can compute its spectrum in closed form.

Spectra are normalised so that white noise of variance R has density R, over λ [rad per sample]. All parts of
a noise have the same scale: the density of its white part is 1 at any sample rate, as for a sensor.
"""

import cmath
import math
from typing import NamedTuple, Protocol

import numpy as np
from fltea.records.arrays import Array
from scipy.signal import freqz, iirnotch, lfilter

from tools.validation.recursions import (
    Stream,
    convolved,
    fractional_difference,
    fractional_noise,
    inverse_series,
)

LONGEST_MEMORY = 1 << 21
"""The fractional state is drawn with at most this memory [samples]. Its impulse response decays in less time.
"""
A_DECADE = 8
"""1/f noise is drawn as a sum of this many relaxations (first-order Gauss-Markov processes) per decade of
frequency. The density of the sum is within 0.1 % of 1/f.
"""


class Part(Protocol):
    """A noise, or one of the parts of a noise."""

    def draw(self, n: int, rate_hz: float, rng: np.random.Generator) -> Array:
        """Return `n` samples."""
        ...

    def spectrum(self, lam: Array, rate_hz: float) -> Array:
        """Return the density at the frequencies `lam` [rad per sample]."""
        ...


class White(NamedTuple):
    """White noise of variance 1. `tails`: its distribution (gaussian, t4 or laplace)."""

    tails: str = "gaussian"

    def draw(self, n: int, rate_hz: float, rng: np.random.Generator) -> Array:
        if self.tails == "t4":
            return rng.standard_t(4, n) / math.sqrt(2)
        if self.tails == "laplace":
            return rng.laplace(size=n) / math.sqrt(2)
        return rng.standard_normal(n)

    def spectrum(self, lam: Array, rate_hz: float) -> Array:
        return np.ones_like(lam)


class Telegraph(NamedTuple):
    """Noise whose values are plus or minus `size`.

    It changes its sign at random times, every `stay_s` seconds on average.
    """

    stay_s: float
    size: float

    def _changes(self, rate_hz: float) -> float:
        """Return the probability that the sign changes from one sample to the next."""
        return -math.expm1(-1 / (self.stay_s * rate_hz))

    def draw(self, n: int, rate_hz: float, rng: np.random.Generator) -> Array:
        changed = np.cumsum(rng.random(n) < self._changes(rate_hz)) + rng.integers(2)
        return np.asarray(self.size * (1.0 - 2.0 * (changed % 2)))

    def spectrum(self, lam: Array, rate_hz: float) -> Array:
        again = 1 - 2 * self._changes(rate_hz)  # the autocorrelation of neighbouring samples
        return self.size**2 * (1 - again**2) / ((1 - again) ** 2 + 4 * again * np.sin(lam / 2) ** 2)


class AR1(NamedTuple):
    """AR(1) noise: x_k = pole x_{k-1} + a random step of standard deviation `size`.

    Neither `pole` nor `size` depends on the sample rate.
    """

    pole: float
    size: float

    def stream(self, rng: np.random.Generator) -> Stream:
        """Return the recursion that turns steps into samples.

        Its start is drawn so that the samples are stationary from the first one.
        """
        start = self.size * rng.standard_normal() / math.sqrt(1 - self.pole**2)
        return Stream([1.0], [1.0, -self.pole], self.pole * start)

    def draw(self, n: int, rate_hz: float, rng: np.random.Generator) -> Array:
        return self.stream(rng).run(self.size * rng.standard_normal(n))

    def spectrum(self, lam: Array, rate_hz: float) -> Array:
        return np.asarray(self.size**2 / ((1 - self.pole) ** 2 + 4 * self.pole * np.sin(lam / 2) ** 2))


class Relaxation(NamedTuple):
    """AR(1) with the pole exp(-2π hz / rate) and density `height` at low frequencies."""

    hz: float
    height: float

    def sampled(self, rate_hz: float) -> AR1:
        """Return the AR(1) process at a sample rate."""
        pole = math.exp(-2 * math.pi * self.hz / rate_hz)
        return AR1(pole, (1 - pole) * math.sqrt(self.height))

    def draw(self, n: int, rate_hz: float, rng: np.random.Generator) -> Array:
        return self.sampled(rate_hz).draw(n, rate_hz, rng)

    def spectrum(self, lam: Array, rate_hz: float) -> Array:
        return self.sampled(rate_hz).spectrum(lam, rate_hz)


def ladder(low_hz: float, high_hz: float, a_decade: float, corner_hz: float) -> tuple[Relaxation, ...]:
    """Return relaxations of equal power, whose sum is 1/f noise from `low_hz` to `high_hz`.

    `a_decade`: number of relaxations per decade.

    `corner_hz`: frequency at which the 1/f noise has the same density as the white noise.
    """
    count = round(math.log10(high_hz / low_hz) * a_decade) + 1
    # At frequency 0, a relaxation with the corner c gets the density level / c. The density of the sum of all
    # relaxations at a frequency f is then about level · a_decade / ln 10 · π / (2 f). At f = corner_hz this
    # shall be 1, the density of the white noise. `level` follows from this.
    level = corner_hz * math.log(10) / (a_decade * math.pi / 2)
    return tuple(
        Relaxation(corner, level / corner) for corner in np.geomspace(low_hz, high_hz, count).tolist()
    )


class Arfima(NamedTuple):
    """ARFIMA(p, d, q) with p and q of 0 or 1, and steps of variance `step`."""

    d: float
    step: float
    ar: float = 0.0
    ma: float = 0.0

    def draw(self, n: int, rate_hz: float, rng: np.random.Generator) -> Array:
        # number of samples after which the pole has forgotten its initial state
        before = 0 if self.ar == self.ma == 0 else 2_000
        x = fractional_noise(self.d, n + before + 1, rng)
        return math.sqrt(self.step) * np.asarray(lfilter([1.0, self.ma], [1.0, -self.ar], x))[-n:]

    def spectrum(self, lam: Array, rate_hz: float) -> Array:
        z = np.exp(-1j * lam)
        short = np.abs((1 + self.ma * z) / (1 - self.ar * z)) ** 2
        return np.asarray(self.step * short * (2 * np.sin(lam / 2)) ** (-2 * self.d))


class Fractional(NamedTuple):
    """The project's own state D^α x = f x + ω, with f in s^-α. `step`: variance of a step ω.

    `window`: number of past samples on which the state depends, or 0 for all past samples. f may be above 0
    only if the window is limited.
    """

    alpha: float
    f: float
    step: float
    window: int = 0

    def g(self, rate_hz: float) -> float:
        """Return g = h^α f, where h is the sampling period.

        The state x stays bounded only if g is at least -2^α, and at most 0 (with a limited `window`: at most
        the sum of `_weights()`). At slow sample rates, f may lead beyond these limits. So g is kept between
        half of the lower limit and half of the upper one.
        """
        g = float(rate_hz**-self.alpha) * self.f
        most = float(self._weights().sum()) / 2 if self.window else 0.0
        return min(max(g, -float(2.0**self.alpha) / 2), most)

    def _weights(self) -> Array:
        """Return the weights of the samples on which the state depends, the newest one first."""
        return fractional_difference(-self.alpha, self.window + 1)

    def _series(self, rate_hz: float, length: int) -> Array:
        """Return the coefficients of the filter that turns x into ω."""
        series = fractional_difference(-self.alpha, length)
        if self.window:
            series[self.window + 1 :] = 0
        series[1] -= self.g(rate_hz)
        return series

    def draw(self, n: int, rate_hz: float, rng: np.random.Generator) -> Array:
        if self.f == 0:
            # Each sample depends on the n + 1 latest steps. Earlier ones would add little but an offset.
            response = fractional_difference(self.alpha, n + 1)
        else:
            length = min(LONGEST_MEMORY, 1 << (max(n, 1 << 16) - 1).bit_length())
            response = inverse_series(self._series(rate_hz, length))
        return math.sqrt(self.step) * convolved(rng.standard_normal(n + len(response) - 1), response, n)

    def spectrum(self, lam: Array, rate_hz: float) -> Array:
        if self.window:
            series = self._series(rate_hz, self.window + 1)
            return np.asarray(self.step / np.abs(freqz(series, worN=lam)[1]) ** 2)
        z = np.exp(-1j * lam)
        return np.asarray(self.step / np.abs((1 - z) ** self.alpha - self.g(rate_hz) * z) ** 2)


class Flicker(NamedTuple):
    """1/f noise, exactly of order 1/2. At `corner_hz`, it has the density of the gallery's white noise."""

    corner_hz: float

    def _sampled(self, rate_hz: float) -> Fractional:
        return Fractional(0.5, 0.0, 2 * math.pi * self.corner_hz / rate_hz)

    def draw(self, n: int, rate_hz: float, rng: np.random.Generator) -> Array:
        return self._sampled(rate_hz).draw(n, rate_hz, rng)

    def spectrum(self, lam: Array, rate_hz: float) -> Array:
        return self._sampled(rate_hz).spectrum(lam, rate_hz)


class Walk(NamedTuple):
    """A random walk. At `corner_hz`, it has the density of the gallery's white noise."""

    corner_hz: float

    def draw(self, n: int, rate_hz: float, rng: np.random.Generator) -> Array:
        return np.cumsum(2 * math.pi * self.corner_hz / rate_hz * rng.standard_normal(n))

    def spectrum(self, lam: Array, rate_hz: float) -> Array:
        return np.asarray((2 * math.pi * self.corner_hz / rate_hz / (2 * np.sin(lam / 2))) ** 2)


class Resonance(NamedTuple):
    """A resonance: a pair of complex poles. `share`: its frequency divided by the sample rate.

    `q`: ratio of the centre frequency to the width at half the power. `peak`: approximate density at the
    peak.
    """

    share: float
    q: float
    peak: float

    @property
    def _coefficients(self) -> tuple[list[float], list[float]]:
        at = 2 * math.pi * self.share
        pole = cmath.exp(complex(-at / (2 * self.q), at))
        a = [1.0, -2 * pole.real, abs(pole) ** 2]
        z = cmath.exp(-1j * at)
        return [math.sqrt(self.peak) * abs(a[0] + z * (a[1] + z * a[2]))], a

    def draw(self, n: int, rate_hz: float, rng: np.random.Generator) -> Array:
        before = min(int(40 * self.q / self.share / (2 * math.pi)), 1 << 20)
        return np.asarray(lfilter(*self._coefficients, rng.standard_normal(n + before)))[before:]

    def spectrum(self, lam: Array, rate_hz: float) -> Array:
        return np.asarray(np.abs(freqz(*self._coefficients, worN=lam)[1]) ** 2)


class Notched(NamedTuple):
    """White noise that has passed a notch filter. `share`: frequency of the notch divided by the sample rate.

    `q`: ratio of the centre frequency to the width.
    """

    share: float
    q: float

    def draw(self, n: int, rate_hz: float, rng: np.random.Generator) -> Array:
        before = int(40 * self.q / self.share)
        return np.asarray(lfilter(*iirnotch(2 * self.share, self.q), rng.standard_normal(n + before)))[
            before:
        ]

    def spectrum(self, lam: Array, rate_hz: float) -> Array:
        return np.asarray(np.abs(freqz(*iirnotch(2 * self.share, self.q), worN=lam)[1]) ** 2)


class Differenced(NamedTuple):
    """The differences between neighbouring samples of white noise of variance `power`."""

    power: float

    def draw(self, n: int, rate_hz: float, rng: np.random.Generator) -> Array:
        return math.sqrt(self.power) * np.diff(rng.standard_normal(n + 1))

    def spectrum(self, lam: Array, rate_hz: float) -> Array:
        return np.asarray(self.power * 4 * np.sin(lam / 2) ** 2)
