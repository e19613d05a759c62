"""Noises of a sensor at rest at 100 Hz, made with numpy and scipy alone.

They share no code with fltea's filters. Fractional noise and 1/f noise are convolutions with their full
impulse responses, not sums of relaxations (first-order Gauss-Markov processes). A noise can be continued from
its present state as often as needed: the past stays the same, and each continuation is drawn anew.
"""

import copy
import math
import zlib
from collections.abc import Sequence
from functools import cache
from typing import Any, NamedTuple, Protocol

import numpy as np
from fltea.records.arrays import Array
from scipy import signal

from tools.validation.recursions import (
    convolved,
    fractional_difference,
    fractional_gaussian_noise,
    state_response,
)

H = 0.01
"""Sampling period [s]."""
SIGMA = 0.1
"""Standard deviation of the white noise in one sample [deg/s]."""
OFFSETS = 0.5
"""Offsets are drawn uniformly between plus and minus this value [deg/s]; the filters do not know them."""
PAST = 1 << 17
"""Length of the impulse response of fractional and 1/f noise [samples], which is 22 minutes."""
FINE = 8
"""Number of steps of the filters inside a sensor in one sampling period, since these filters act before the
sensor samples.
"""


class Component(Protocol):
    """One component of a noise. `state`: internal state after the last sample.

    The state is None before the first sample.
    """

    def draw(self, rng: np.random.Generator, n: int, state: Any) -> tuple[Array, Any]:
        """Return the next n samples, and the state after them."""


class White(NamedTuple):
    """White noise."""

    sigma: float = SIGMA

    def draw(self, rng: np.random.Generator, n: int, state: Any) -> tuple[Array, Any]:
        return rng.normal(0, self.sigma, n), None


class Filtered(NamedTuple):
    """White noise that has passed the filter with the transfer function b(z) / a(z).

    The filter is computed at `fine` times the sampling rate.
    """

    b: tuple[float, ...]
    a: tuple[float, ...]
    sigma: float = 1.0
    before: int = 0
    """Number of samples after which the noise is stationary."""
    fine: int = 1

    def draw(self, rng: np.random.Generator, n: int, state: Any) -> tuple[Array, Any]:
        before = self.before if state is None else 0
        zi = np.zeros(max(len(self.a), len(self.b)) - 1) if state is None else state
        white = rng.normal(0, self.sigma * math.sqrt(self.fine), (n + before) * self.fine)
        found, zi = signal.lfilter(self.b, self.a, white, zi=zi)
        return found[self.fine - 1 :: self.fine][before:], zi


class Convolved(NamedTuple):
    """White noise convolved with an impulse response.

    The impulse response is that of fractional noise of order α with the parameter f or, if α is 0, that of
    1/f noise of order d.
    """

    sigma: float
    alpha: float = 0.0
    f: float = 0.0
    d: float = 0.0

    def draw(self, rng: np.random.Generator, n: int, state: Any) -> tuple[Array, Any]:
        past = rng.normal(0, self.sigma, PAST - 1) if state is None else state
        white = np.concatenate([past, rng.normal(0, self.sigma, n)])
        return convolved(white, _response(self.alpha, self.f, self.d), n), white[1 - PAST :]


@cache
def _response(alpha: float, f: float, d: float) -> Array:
    return state_response(alpha, H**alpha * f, PAST) if alpha else fractional_difference(d, PAST)


class Telegraph(NamedTuple):
    """Popcorn noise: it jumps between plus and minus `size` and stays for `dwell_s` on average."""

    size: float
    dwell_s: float

    def draw(self, rng: np.random.Generator, n: int, state: Any) -> tuple[Array, Any]:
        level = rng.choice([-1.0, 1.0]) if state is None else state
        turns = np.where(rng.random(n) < H / self.dwell_s, -1.0, 1.0)
        levels = level * np.cumprod(turns)
        return self.size * levels, levels[-1]


class Ramp(NamedTuple):
    """A linear drift [deg/s per second]."""

    rate: float

    def draw(self, rng: np.random.Generator, n: int, state: Any) -> tuple[Array, Any]:
        begin = state or 0
        return self.rate * H * np.arange(begin, begin + n), begin + n


class FractionalGaussian(NamedTuple):
    """Fractional Gaussian noise.

    Unlike the other components, it is drawn in one piece: no more samples can be drawn later.
    """

    sigma: float
    hurst: float

    def draw(self, rng: np.random.Generator, n: int, state: Any) -> tuple[Array, Any]:
        if state is not None:
            raise ValueError("fractional Gaussian noise is drawn in one piece: no more samples can follow")
        return self.sigma * fractional_gaussian_noise(self.hurst, n, rng), True


def walk(step: float) -> Filtered:
    """Return a random walk. `step`: standard deviation of one step."""
    return Filtered((1.0,), (1.0, -1.0), step)


def relaxation(sigma: float, tau_s: float) -> Filtered:
    """Return a first-order Gauss-Markov process with the standard deviation `sigma`."""
    a = math.exp(-H / tau_s)
    return Filtered((1.0,), (1.0, -a), sigma * math.sqrt(1 - a * a), round(20 * tau_s / H))


class Noise(NamedTuple):
    """The components of a simulated noise. The bias should follow `signal`, but not the fast noise `rest`."""

    signal: tuple[Component, ...]
    rest: tuple[Component, ...] = (White(),)
    known: tuple[float, tuple[tuple[float, float], ...]] | None = None
    """For the plain Kalman filter that is optimal for this noise: the standard deviation of a step of the
    random walk, and (σ, τ) of each relaxation. The filter also needs the variance of the white noise,
    which is not in here. None if no plain Kalman filter is optimal.
    """


def _plain(step: float, *relaxations: tuple[float, float]) -> Noise:
    walks = (walk(step),) if step else ()
    return Noise((*walks, *(relaxation(*one) for one in relaxations)), known=(step, relaxations))


_B, _A = signal.butter(2, 20.0, fs=FINE / H)
LOW_PASS = Filtered(tuple(_B), tuple(_A), SIGMA, before=100, fine=FINE)
CIC = Filtered(tuple(np.convolve(np.ones(FINE), np.ones(FINE)) / FINE**2), (1.0,), SIGMA, 10, FINE)

TEN: dict[str, Noise] = {
    "white": _plain(0.0),
    "walk, 0.002 a sample": _plain(0.002),
    "walk, 0.0002 a sample": _plain(0.0002),
    "relaxation of 2 s": _plain(0.0, (0.05, 2.0)),
    "relaxations of 0.2 and 10 s": _plain(0.0, (0.05, 0.2), (0.05, 10.0)),
    "order .7": Noise((Convolved(SIGMA * math.sqrt(0.3), alpha=0.7, f=-2.0),)),
    "1/f": Noise((Convolved(SIGMA * math.sqrt(0.2), d=0.45),)),
    "popcorn": Noise((Telegraph(0.05, 20.0),)),
    "ramp": Noise((Ramp(0.05 / 600),)),
    "DLPF": Noise((relaxation(0.05, 20.0),), (LOW_PASS,)),
}
FILTERED: dict[str, Noise] = {
    "EMA (.2)": Noise((), (Filtered((0.2,), (1.0, -0.8), SIGMA, 200),)),
    "CIC": Noise((), (CIC,)),
    "fGn .7": Noise((FractionalGaussian(SIGMA, 0.7),), ()),
}
"""Filtered noises. For filtered white noise (EMA, CIC), the true bias is the offset alone. For fractional
Gaussian noise (fGn), the true bias is the mean of offset plus noise over a second.
"""
NOISES = TEN | FILTERED
MODELLED = tuple(name for name in TEN if name not in ("popcorn", "ramp", "DLPF"))
"""Names of the noises that a verdict can name and a filter can model."""


class Lane:
    """A simulated axis of a sensor at rest that can be continued without end."""

    def __init__(self, name: str, rng: np.random.Generator) -> None:
        self.noise, self._rng = NOISES[name], rng
        self.offset = float(rng.uniform(-OFFSETS, OFFSETS))
        self._states: list[Any] = [None] * (len(self.noise.signal) + len(self.noise.rest))

    def take(self, n: int) -> tuple[Array, Array]:
        """Return the next n samples, and their signal including the offset."""
        found = []
        for place, part in enumerate((*self.noise.signal, *self.noise.rest)):
            samples, self._states[place] = part.draw(self._rng, n, self._states[place])
            found.append(samples)
        signals = len(self.noise.signal)
        x = sum(found[:signals], np.full(n, self.offset))
        return sum(found[signals:], x), x

    def fork(self, rng: np.random.Generator) -> "Lane":
        """Return an axis with the same past whose later samples are drawn independently, from `rng`."""
        other = copy.copy(self)
        other._rng, other._states = rng, list(self._states)
        return other


def generator(section: str, name: str, number: int = 0) -> np.random.Generator:
    """Return the generator of random numbers for one record of a section (a part of the measurement)."""
    return np.random.default_rng((20261126, zlib.crc32(f"{section}: {name}".encode()), number))


def lanes(section: str, name: str, numbers: Sequence[int]) -> list[Lane]:
    """Return one simulated axis for each of `numbers`, which decide the random numbers of the axes."""
    return [Lane(name, generator(section, name, number)) for number in numbers]


def drawn(axes: Sequence[Lane], n: int) -> tuple[Array, Array]:
    """Return the next n samples of some axes, and their signals including the offsets, each (n, axes)."""
    y, x = zip(*(axis.take(n) for axis in axes), strict=True)
    return np.stack(y, axis=1), np.stack(x, axis=1)


def mean_ahead(x: Array, n: int) -> Array:
    """Return, for each sample, the mean of the n samples after it.

    The result has the shape (len(x) - n, ...).
    """
    sums = np.cumsum(x, axis=0)
    return np.asarray((sums[n:] - sums[:-n]) / n)
