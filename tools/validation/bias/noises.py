"""The noises of a sensor at rest, 100 samples a second, made with numpy and scipy alone.

Nothing is shared with the filter: orders and 1/f are convolutions of their whole responses, not sums of
relaxations. Every noise can go on from where it is, as often as wanted: the past stays, the future is drawn.
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
"""s from sample to sample"""
SIGMA = 0.1
"""deg/s of the white noise of a sample"""
OFFSETS = 0.5
"""Offsets are drawn from ± so many deg/s: nobody knows them before."""
PAST = 1 << 17
"""Samples that orders and 1/f noise remember: 22 minutes."""
FINE = 8
"""Oversampling in front of filters that a sensor has before it samples."""


class Component(Protocol):
    """A part of a noise. state: where it stopped; None before its first sample."""

    def draw(self, rng: np.random.Generator, n: int, state: Any) -> tuple[Array, Any]:
        """Return its next n samples, and where it stopped."""


class White(NamedTuple):
    """White noise."""

    sigma: float = SIGMA

    def draw(self, rng: np.random.Generator, n: int, state: Any) -> tuple[Array, Any]:
        return rng.normal(0, self.sigma, n), None


class Filtered(NamedTuple):
    """White noise through the filter b(z) / a(z), `fine` times as fast as the samples."""

    b: tuple[float, ...]
    a: tuple[float, ...]
    sigma: float = 1.0
    before: int = 0
    """samples after which it is stationary"""
    fine: int = 1

    def draw(self, rng: np.random.Generator, n: int, state: Any) -> tuple[Array, Any]:
        before = self.before if state is None else 0
        zi = np.zeros(max(len(self.a), len(self.b)) - 1) if state is None else state
        white = rng.normal(0, self.sigma * math.sqrt(self.fine), (n + before) * self.fine)
        found, zi = signal.lfilter(self.b, self.a, white, zi=zi)
        return found[self.fine - 1 :: self.fine][before:], zi


class Convolved(NamedTuple):
    """White noise through the response of an order α and f, or of 1/f noise of order d (α = 0)."""

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
    """Popcorn noise: ± size, for `dwell_s` in the mean."""

    size: float
    dwell_s: float

    def draw(self, rng: np.random.Generator, n: int, state: Any) -> tuple[Array, Any]:
        level = rng.choice([-1.0, 1.0]) if state is None else state
        turns = np.where(rng.random(n) < H / self.dwell_s, -1.0, 1.0)
        levels = level * np.cumprod(turns)
        return self.size * levels, levels[-1]


class Ramp(NamedTuple):
    """A straight line of so many deg/s a second."""

    rate: float

    def draw(self, rng: np.random.Generator, n: int, state: Any) -> tuple[Array, Any]:
        begin = state or 0
        return self.rate * H * np.arange(begin, begin + n), begin + n


class FractionalGaussian(NamedTuple):
    """Fractional Gaussian noise; it cannot go on."""

    sigma: float
    hurst: float

    def draw(self, rng: np.random.Generator, n: int, state: Any) -> tuple[Array, Any]:
        if state is not None:
            raise ValueError("fractional Gaussian noise is drawn as a whole: it does not go on")
        return self.sigma * fractional_gaussian_noise(self.hurst, n, rng), True


def walk(step: float) -> Filtered:
    """Return a random walk; step: its deviation a sample."""
    return Filtered((1.0,), (1.0, -1.0), step)


def relaxation(sigma: float, tau_s: float) -> Filtered:
    """Return a Gauss-Markov process of deviation sigma."""
    a = math.exp(-H / tau_s)
    return Filtered((1.0,), (1.0, -a), sigma * math.sqrt(1 - a * a), round(20 * tau_s / H))


class Noise(NamedTuple):
    """What is in a sample: a signal, which is the bias with the offset, and what no bias follows."""

    signal: tuple[Component, ...]
    rest: tuple[Component, ...] = (White(),)
    known: tuple[float, tuple[tuple[float, float], ...]] | None = None
    """Where a plain Kalman filter is the best possible: the step of its walk a sample, (σ, τ) of its
    relaxations, beside white noise of SIGMA."""


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
"""White noise through a filter, whose bias is its offset alone, and noise whose mean over a second is one."""
NOISES = TEN | FILTERED
MODELLED = tuple(name for name in TEN if name not in ("popcorn", "ramp", "DLPF"))
"""What a verdict has words for, and a filter states."""


class Lane:
    """One axis at rest, which goes on for as long as it is asked."""

    def __init__(self, name: str, rng: np.random.Generator) -> None:
        self.noise, self._rng = NOISES[name], rng
        self.offset = float(rng.uniform(-OFFSETS, OFFSETS))
        self._states: list[Any] = [None] * (len(self.noise.signal) + len(self.noise.rest))

    def take(self, n: int) -> tuple[Array, Array]:
        """Return the next n samples, and what of them is signal and offset."""
        found = []
        for place, part in enumerate((*self.noise.signal, *self.noise.rest)):
            samples, self._states[place] = part.draw(self._rng, n, self._states[place])
            found.append(samples)
        signals = len(self.noise.signal)
        x = sum(found[:signals], np.full(n, self.offset))
        return sum(found[signals:], x), x

    def fork(self, rng: np.random.Generator) -> "Lane":
        """Return another future of the same past."""
        other = copy.copy(self)
        other._rng, other._states = rng, list(self._states)
        return other


def generator(section: str, name: str, number: int = 0) -> np.random.Generator:
    """Return the numbers of one record of a section."""
    return np.random.default_rng((20261126, zlib.crc32(f"{section}: {name}".encode()), number))


def lanes(section: str, name: str, numbers: Sequence[int]) -> list[Lane]:
    """Return one axis for each number."""
    return [Lane(name, generator(section, name, number)) for number in numbers]


def drawn(axes: Sequence[Lane], n: int) -> tuple[Array, Array]:
    """Return the next n samples of some axes, and what of them is signal and offset, (n, axes)."""
    y, x = zip(*(axis.take(n) for axis in axes), strict=True)
    return np.stack(y, axis=1), np.stack(x, axis=1)


def mean_ahead(x: Array, n: int) -> Array:
    """Return the mean of the n samples behind each, (len(x) - n, ...)."""
    sums = np.cumsum(x, axis=0)
    return np.asarray((sums[n:] - sums[:-n]) / n)
