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
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple, Self

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
        """Return the coordinates of the native fits.

        Raises:
            ValueError: an order that is not stationary.
        """
        return COORDINATES[type(self)].eta(self, h)

    @classmethod
    def of_eta(cls, eta: Sequence[float], h: float) -> Self:
        """Return the part that has these coordinates."""
        return cls(*COORDINATES[cls].fields(eta, h))


class White(Part, frozen=True, tag="white"):
    """White noise of variance R: the angle walks at random, by N = √(R h) a root second."""

    R: float


class Relaxation(Part, frozen=True, tag="relaxation"):
    """A Gauss–Markov process of standard deviation σ, which forgets itself within the correlation time τ."""

    sigma: float
    tau_s: float


class Alternating(Part, frozen=True, tag="alternating"):
    """The same of which every second sample has its sign changed: AR(1) of a negative coefficient."""

    sigma: float
    tau_s: float


class Walk(Part, frozen=True, tag="walk"):
    """A random walk of the rate: K² h is the variance of a step."""

    K: float


class Order(Part, frozen=True, tag="order"):
    """The state of a fractional order, D^α x = f x + ω, of `fltea.noise.simulation`: f in s^-α, var ω = Q."""

    alpha: float
    f: float
    Q: float


class Arfima(Part, frozen=True, tag="arfima"):
    """An order without f: ARFIMA(1, d, 0) with innovations of variance s2."""

    d: float
    phi: float
    s2: float


class Resonance(Part, frozen=True, tag="resonance"):
    """A pair of poles: height of its spectrum at its frequency, and the width there at half that height."""

    height: float
    frequency_hz: float
    width_hz: float


class Quantisation(Part, frozen=True, tag="quantisation"):
    """Differences of an angle that is rounded: white noise of deviation Q of the angle."""

    Q: float


class Rise(Part, frozen=True, tag="rise"):
    """Power that rises with |1 - e^{-iλ}|^2δ, to `power` at half the sample rate."""

    power: float
    delta: float


class Floor(Part, frozen=True, tag="floor"):
    """White noise of variance R that no filter has changed, as that of rounding."""

    R: float


class LowPass(Part, frozen=True, tag="low-pass"):
    """A filter 1 / (1 + (ω/ω_c)^2n), then sampled; the corner may be above half the sample rate."""

    corner_hz: float
    poles: float


class HighPass(Part, frozen=True, tag="high-pass"):
    """A filter 1 / (1 + (s_c/s)^2n), s = 2 sin(ω h/2), which lets nothing slow pass, as AC coupling does.

    With one pole it is what is left of samples less their fading average. The corner is at most at a tenth of
    the sample rate: one above is a rise.
    """

    corner_hz: float
    poles: float


class Sharpening(Part, frozen=True, tag="sharpening"):
    """The filter -s, 1 + 2 s, -s, which sharpens, or smooths where s < 0."""

    s: float


class Notch(Part, frozen=True, tag="notch"):
    """A filter that stops one frequency: of this width at half its power."""

    frequency_hz: float
    width_hz: float


class Mean(Part, frozen=True, tag="mean"):
    """The mean of so many samples."""

    samples: int

    @property
    def code(self) -> int:
        """The number of the part in the native module."""
        return MEAN_FROM + self.samples


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
    | HighPass
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
    HighPass,
)
"""The parts by their numbers in the native module."""
FREE = (1, 2, 1, 3, 3, 1, 2, 2, 1, 2, 0, 2, 1, 3, 2)
"""The number of coordinates of each."""
FILTERS = (LowPass, HighPass, Sharpening, Notch, Mean)
SIGNED = ("f", "s", "d")
"""Parameters that may be below 0."""


class Coordinates(NamedTuple):
    """How the fields of a part and its coordinates in the native fits follow from each other; h in s."""

    eta: Callable[[Any, float], list[float]]
    fields: Callable[[Sequence[float], float], tuple[float, ...]]


def _eta_of_order(part: Order, h: float) -> list[float]:
    g = g_of(part.alpha, part.f, h)
    if not stationary(part.alpha, g):
        raise ValueError(f"α = {part.alpha:g}, f = {part.f:g} is not stationary at h = {h:g} s")
    share = -g / 2**part.alpha
    logit = math.log(share / (1 - share)) if share > 0 else -LOGIT_END
    return [part.alpha, max(logit, -LOGIT_END), _log(step_variance(part.alpha, part.Q, h))]


def _order_of_eta(eta: Sequence[float], h: float) -> tuple[float, ...]:
    alpha, s2 = eta[0], math.exp(eta[2])
    return alpha, f_of(alpha, g_of_eta(eta), h), noise_variance(alpha, s2, h)


def _arfima_of_eta(eta: Sequence[float], h: float) -> tuple[float, ...]:
    phi = math.exp(-math.exp(eta[1]))
    return eta[0], phi, math.exp(eta[2]) * (1 - phi) ** 2


def _logit_of_poles(poles: float) -> float:
    share = min(max((poles - 1) / (MOST_POLES - 1), 1e-7), 1 - 1e-7)
    return math.log(share / (1 - share))


def _poles_of_logit(logit: float) -> float:
    return 1 + (MOST_POLES - 1) / (1 + math.exp(-logit))


def _high_pass_of_eta(eta: Sequence[float], h: float) -> tuple[float, ...]:
    sine = min(math.exp(eta[0] / 2) / 2, 1.0)
    return math.asin(sine) / (math.pi * h), _poles_of_logit(eta[1])


def _hz(log_lam: float, h: float) -> float:
    return math.exp(log_lam) / (2 * math.pi * h)


def _log(value: float) -> float:
    return math.log(max(value, SMALLEST))


_LEVEL = Coordinates(lambda p, h: [_log(p.R)], lambda eta, h: (math.exp(eta[0]),))
_DECAYING = Coordinates(
    lambda p, h: [_log(p.sigma**2), _log(h / p.tau_s)],
    lambda eta, h: (math.exp(eta[0] / 2), h * math.exp(-eta[1])),
)
COORDINATES: dict[type[Part], Coordinates] = {
    White: _LEVEL,
    Floor: _LEVEL,
    Relaxation: _DECAYING,
    Alternating: _DECAYING,
    Walk: Coordinates(lambda p, h: [_log(p.K**2 * h)], lambda eta, h: (math.sqrt(math.exp(eta[0]) / h),)),
    Order: Coordinates(_eta_of_order, _order_of_eta),  # α, logit(-g / 2^α), log s2
    # d, log -log φ, and log of the level s2 / (1 - φ)²
    Arfima: Coordinates(
        lambda p, h: [p.d, math.log(-math.log(max(p.phi, 1e-6))), _log(p.s2) - 2 * math.log1p(-p.phi)],
        _arfima_of_eta,
    ),
    # logarithms of height, of λ, and of half the width over the frequency
    Resonance: Coordinates(
        lambda p, h: [
            _log(p.height),
            _log(2 * math.pi * p.frequency_hz * h),
            _log(p.width_hz / 2 / p.frequency_hz),
        ],
        lambda eta, h: (math.exp(eta[0]), _hz(eta[1], h), 2 * _hz(eta[1], h) * math.exp(eta[2])),
    ),
    Quantisation: Coordinates(
        lambda p, h: [_log((p.Q / h) ** 2)], lambda eta, h: (h * math.exp(eta[0] / 2),)
    ),
    Rise: Coordinates(lambda p, h: [_log(p.power), p.delta], lambda eta, h: (math.exp(eta[0]), eta[1])),
    # log λ² of the corner, logit of the poles
    LowPass: Coordinates(
        lambda p, h: [2 * _log(2 * math.pi * p.corner_hz * h), _logit_of_poles(p.poles)],
        lambda eta, h: (_hz(eta[0] / 2, h), _poles_of_logit(eta[1])),
    ),
    # log |1 - e^{-iλ}|² at the corner, logit of the poles
    HighPass: Coordinates(
        lambda p, h: [
            2 * _log(2 * math.sin(min(math.pi * p.corner_hz * h, math.pi / 2))),
            _logit_of_poles(p.poles),
        ],
        _high_pass_of_eta,
    ),
    Sharpening: Coordinates(lambda p, h: [p.s], lambda eta, h: (eta[0],)),
    # logarithms of λ and of the width over the frequency
    Notch: Coordinates(
        lambda p, h: [_log(2 * math.pi * p.frequency_hz * h), _log(p.width_hz / p.frequency_hz)],
        lambda eta, h: (_hz(eta[0], h), _hz(eta[0], h) * math.exp(eta[1])),
    ),
    Mean: Coordinates(lambda p, h: [], lambda eta, h: ()),
}


def kind_of(code: int) -> type[Part]:
    """Return the kind of a part."""
    return Mean if code >= MEAN_FROM else CODES[code]


def free_of(code: int) -> int:
    """Return the number of coordinates of a part."""
    return 0 if code >= MEAN_FROM else FREE[code]


def g_of_eta(eta: Sequence[float]) -> float:
    """Return g of the coordinates of an order."""
    return -(2 ** eta[0]) / (1 + math.exp(-eta[1]))


def high_pass_of(parts: Iterable[Part]) -> HighPass | None:
    """Return the high-pass among parts, if there is one."""
    return next((part for part in parts if isinstance(part, HighPass)), None)


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
