"""The grammar of noise: a noise is made of parts (pure).

    S(λ) = L(λ) (sum of the parts' spectra) + floor,    λ in rad a sample, of which white noise of variance R
    has R

L is a chain of filters that the sensor has behind its noise. A part has its parameters in physical units
here, and in the coordinates of the native fits (host/native/sentence_kernel.hpp), where powers and rates are
logarithms, as `eta`. The fields of a part are in the order of its coordinates, and each goes up or down with
the one coordinate of its place.

Variances are in the square of the unit of y, deg/s for a gyroscope; h is the sampling period in s.
"""

import math
from collections.abc import Iterable, Sequence
from typing import Self

import msgspec
import numpy as np

from fltea import _native
from fltea.noise.spectra import f_of, g_of, noise_variance, stationary, step_variance
from fltea.records.arrays import Array

SMALLEST = 1e-300
"""Stands for a variance of 0, which has no logarithm."""
MOST_POLES = 24.0
LOGIT_END = 16.0
MEAN_FROM = 100
"""Code of the mean of so many samples, less their number."""


class Part(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="part"):
    """The base of all parts."""

    def __post_init__(self) -> None:
        for name in self.__struct_fields__:
            value = getattr(self, name)
            if not math.isfinite(value):
                raise ValueError(f"{name} must be a finite number, got {value}")
            if value < 0 and name not in SIGNED:
                raise ValueError(f"{name} must be 0 or more, got {value}")

    @property
    def code(self) -> int:
        """The number of the part in the native module."""
        return CODES.index(type(self))

    def eta(self, h: float) -> list[float]:
        """Return the coordinates of the native fits."""
        raise NotImplementedError

    @classmethod
    def of_eta(cls, eta: Sequence[float], h: float) -> "Part":
        """Return the part that has these coordinates."""
        raise NotImplementedError


class _Level(Part, frozen=True):
    """Noise of variance R."""

    R: float

    def eta(self, h: float) -> list[float]:
        """Return log R."""
        return [_log(self.R)]

    @classmethod
    def of_eta(cls, eta: Sequence[float], h: float) -> Self:
        """Return the inverse."""
        return cls(math.exp(eta[0]))


class White(_Level, frozen=True, tag="white"):
    """White noise of variance R: the angle walks at random, by N = √(R h) a root second."""


class _Decaying(Part, frozen=True):
    """A process of standard deviation σ that forgets itself within τ."""

    sigma: float
    tau_s: float

    def eta(self, h: float) -> list[float]:
        """Return log σ² and log h/τ."""
        return [_log(self.sigma**2), _log(h / self.tau_s)]

    @classmethod
    def of_eta(cls, eta: Sequence[float], h: float) -> Self:
        """Return the inverse."""
        return cls(math.exp(eta[0] / 2), h * math.exp(-eta[1]))


class Relaxation(_Decaying, frozen=True, tag="relaxation"):
    """A Gauss–Markov process of standard deviation σ and correlation time τ."""


class Alternating(_Decaying, frozen=True, tag="alternating"):
    """The same of which every second sample has its sign changed: AR(1) of a negative coefficient."""


class Walk(Part, frozen=True, tag="walk"):
    """A random walk of the rate: K² h is the variance of a step."""

    K: float

    def eta(self, h: float) -> list[float]:
        """Return log K² h."""
        return [_log(self.K**2 * h)]

    @classmethod
    def of_eta(cls, eta: Sequence[float], h: float) -> "Walk":
        """Return the inverse."""
        return cls(math.sqrt(math.exp(eta[0]) / h))


class Order(Part, frozen=True, tag="order"):
    """The state of a fractional order, D^α x = f x + ω, of `fltea.noise.simulation`: f in s^-α, var ω = Q."""

    alpha: float
    f: float
    Q: float

    def eta(self, h: float) -> list[float]:
        """Return α, logit(-g / 2^α), log s2.

        Raises:
            ValueError: the noise is not stationary.
        """
        g = g_of(self.alpha, self.f, h)
        if not stationary(self.alpha, g):
            raise ValueError(f"α = {self.alpha:g}, f = {self.f:g} is not stationary at h = {h:g} s")
        share = -g / 2**self.alpha
        logit = math.log(share / (1 - share)) if share > 0 else -LOGIT_END
        return [self.alpha, max(logit, -LOGIT_END), _log(step_variance(self.alpha, self.Q, h))]

    @classmethod
    def of_eta(cls, eta: Sequence[float], h: float) -> "Order":
        """Return the inverse."""
        alpha, s2 = eta[0], math.exp(eta[2])
        return cls(alpha, f_of(alpha, g_of_eta(eta), h), noise_variance(alpha, s2, h))


class Arfima(Part, frozen=True, tag="arfima"):
    """An order without f: ARFIMA(1, d, 0) with innovations of variance s2."""

    d: float
    phi: float
    s2: float

    def eta(self, h: float) -> list[float]:
        """Return d, log -log φ and log of the level s2 / (1 - φ)²."""
        return [self.d, math.log(-math.log(max(self.phi, 1e-6))), _log(self.s2) - 2 * math.log1p(-self.phi)]

    @classmethod
    def of_eta(cls, eta: Sequence[float], h: float) -> "Arfima":
        """Return the inverse."""
        phi = math.exp(-math.exp(eta[1]))
        return cls(eta[0], phi, math.exp(eta[2]) * (1 - phi) ** 2)


class Resonance(Part, frozen=True, tag="resonance"):
    """A pair of poles: height of its spectrum at its frequency, and the width there at half that height."""

    height: float
    frequency_hz: float
    width_hz: float

    def eta(self, h: float) -> list[float]:
        """Return the logarithms of height, λ and half the width over the frequency."""
        return [
            _log(self.height),
            _log(2 * math.pi * self.frequency_hz * h),
            _log(self.width_hz / 2 / self.frequency_hz),
        ]

    @classmethod
    def of_eta(cls, eta: Sequence[float], h: float) -> "Resonance":
        """Return the inverse."""
        hz = math.exp(eta[1]) / (2 * math.pi * h)
        return cls(math.exp(eta[0]), hz, 2 * hz * math.exp(eta[2]))


class Quantisation(Part, frozen=True, tag="quantisation"):
    """Differences of an angle that is rounded: white noise of deviation Q of the angle."""

    Q: float

    def eta(self, h: float) -> list[float]:
        """Return log (Q/h)²."""
        return [_log((self.Q / h) ** 2)]

    @classmethod
    def of_eta(cls, eta: Sequence[float], h: float) -> "Quantisation":
        """Return the inverse."""
        return cls(h * math.exp(eta[0] / 2))


class Rise(Part, frozen=True, tag="rise"):
    """Power that rises with |1 - e^{-iλ}|^2δ, to `power` at half the sample rate."""

    power: float
    delta: float

    def eta(self, h: float) -> list[float]:
        """Return log power and δ."""
        return [_log(self.power), self.delta]

    @classmethod
    def of_eta(cls, eta: Sequence[float], h: float) -> "Rise":
        """Return the inverse."""
        return cls(math.exp(eta[0]), eta[1])


class Floor(_Level, frozen=True, tag="floor"):
    """White noise that no filter has changed, as that of rounding."""


class LowPass(Part, frozen=True, tag="low-pass"):
    """A filter 1 / (1 + (ω/ω_c)^2n), then sampled; the corner may be above half the sample rate."""

    corner_hz: float
    poles: float

    def eta(self, h: float) -> list[float]:
        """Return the logarithm of the corner's λ² and the logit of the poles."""
        share = min(max((self.poles - 1) / (MOST_POLES - 1), 1e-7), 1 - 1e-7)
        return [2 * _log(2 * math.pi * self.corner_hz * h), math.log(share / (1 - share))]

    @classmethod
    def of_eta(cls, eta: Sequence[float], h: float) -> "LowPass":
        """Return the inverse."""
        poles = 1 + (MOST_POLES - 1) / (1 + math.exp(-eta[1]))
        return cls(math.exp(eta[0] / 2) / (2 * math.pi * h), poles)


class Sharpening(Part, frozen=True, tag="sharpening"):
    """The filter -s, 1 + 2 s, -s, which sharpens, or smooths where s < 0."""

    s: float

    def eta(self, h: float) -> list[float]:
        """Return s."""
        return [self.s]

    @classmethod
    def of_eta(cls, eta: Sequence[float], h: float) -> "Sharpening":
        """Return the inverse."""
        return cls(eta[0])


class Notch(Part, frozen=True, tag="notch"):
    """A filter that stops one frequency: of this width at half its power."""

    frequency_hz: float
    width_hz: float

    def eta(self, h: float) -> list[float]:
        """Return the logarithms of λ and of the width over the frequency."""
        return [_log(2 * math.pi * self.frequency_hz * h), _log(self.width_hz / self.frequency_hz)]

    @classmethod
    def of_eta(cls, eta: Sequence[float], h: float) -> "Notch":
        """Return the inverse."""
        hz = math.exp(eta[0]) / (2 * math.pi * h)
        return cls(hz, hz * math.exp(eta[1]))


class Mean(Part, frozen=True, tag="mean"):
    """The mean of so many samples."""

    samples: int

    @property
    def code(self) -> int:
        """The number of the part in the native module."""
        return MEAN_FROM + self.samples

    def eta(self, h: float) -> list[float]:
        """Return nothing: it has no coordinates."""
        return []


AnyPart = (
    White
    | Relaxation
    | Alternating
    | Walk
    | Order
    | Arfima
    | Resonance
    | Quantisation
    | Rise
    | Floor
    | LowPass
    | Sharpening
    | Notch
    | Mean
)
CODES: tuple[type[Part], ...] = (
    White,
    Relaxation,
    Walk,
    Order,
    Resonance,
    Quantisation,
    Rise,
    LowPass,
    Sharpening,
    Notch,
    Mean,
    Alternating,
    Floor,
    Arfima,
)
"""The parts by their numbers in the native module."""
FREE = (1, 2, 1, 3, 3, 1, 2, 2, 1, 2, 0, 2, 1, 3)
"""The number of coordinates of each."""
FILTERS = (LowPass, Sharpening, Notch, Mean)
SIGNED = ("f", "s", "d")
"""Parameters that may be below 0."""


def kind_of(code: int) -> type[Part]:
    """Return the kind of a part."""
    return Mean if code >= MEAN_FROM else CODES[code]


def free_of(code: int) -> int:
    """Return the number of coordinates of a part."""
    return 0 if code >= MEAN_FROM else FREE[code]


def g_of_eta(eta: Sequence[float]) -> float:
    """Return g of the coordinates of an order."""
    return -(2 ** eta[0]) / (1 + math.exp(-eta[1]))


def part_of(code: int, eta: Sequence[float], h: float) -> Part:
    """Return a part of its number and coordinates."""
    return Mean(code - MEAN_FROM) if code >= MEAN_FROM else CODES[code].of_eta(eta, h)


def spectrum(parts: Iterable[Part], lam: Array, h: float) -> Array:
    """Return the spectrum at λ > 0, (len(lam),).

    Raises:
        ValueError: a part is not stationary.
    """
    first = White(0.0)
    rest: list[Part] = []
    for part in parts:
        if isinstance(part, White):
            first = White(first.R + part.R)
        else:
            rest.append(part)
    codes, eta = [first.code], first.eta(h)
    for part in rest:
        codes.append(part.code)
        eta += part.eta(h)
    return spectrum_of(codes, eta, lam, h)


def spectrum_of(codes: Sequence[int], eta: Sequence[float], lam: Array, h: float) -> Array:
    """Return the spectrum of parts by their numbers and coordinates, white noise first."""
    found = np.empty(len(lam))
    _native.sentence_spectrum(list(codes), list(eta), np.ascontiguousarray(lam, dtype=np.float64), h, found)
    return found


def _log(value: float) -> float:
    return math.log(max(value, SMALLEST))
