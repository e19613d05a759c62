"""Describe a noise as a sum of parts, such as white noise, a relaxation and a random walk.

    S(λ) = L(λ) (sum of the parts' spectra) + floor, λ in rad per sample

S is the spectrum of the samples, normalised so that white noise of variance R has S = R. L is the power
response of the sensor's filters, through which all parts but the floor pass. The fields of a part are its
parameters in physical units. `eta` converts them to the transformed free parameters of the native fits
(host/native/whittle_parts.hpp), where variances and rates are logarithms. The fields of a part have the order
of its free parameters, and each field is a monotonic function of the free parameter with the same index. The
words for a part and its poles are defined here, too. The filters are defined in `fltea.noise.filters`.

Variances are in the square of the unit of the samples, which is deg/s for a gyroscope. h is the sampling
period in s.
"""

import math
from collections.abc import Iterable, Sequence
from typing import ClassVar, Self, get_args

import numpy as np

from fltea import _native
from fltea.noise import free_parameters as free
from fltea.noise import pole_sets
from fltea.noise.filters import MEAN_FROM as MEAN_FROM
from fltea.noise.filters import HighPass as HighPass
from fltea.noise.filters import LowPass as LowPass
from fltea.noise.filters import Mean as Mean
from fltea.noise.filters import Notch as Notch
from fltea.noise.filters import Sharpening as Sharpening
from fltea.noise.free_parameters import g_of_eta
from fltea.noise.part import BY_NAME, ROWS, VARIANCE, Symbol, in_hz
from fltea.noise.part import Part as Part
from fltea.noise.spectra import f_of, g_of, noise_variance, stationary, step_variance
from fltea.records.arrays import Array, Complex


class _Level(Part, frozen=True):
    """White noise of variance R."""

    symbols: ClassVar[dict[str, Symbol]] = {"R": Symbol("R", VARIANCE)}

    R: float

    def eta(self, h: float) -> list[float]:
        return [free.log(self.R)]

    @classmethod
    def of_eta(cls, eta: Sequence[float], h: float) -> Self:
        return cls(math.exp(eta[0]))

    def words(self, rate_hz: float) -> str:
        return ""

    def own_poles(self, lam: Array, h: float, room: int) -> list[complex]:
        return []


class White(_Level, frozen=True, tag="white"):
    """White noise of variance R. The integrated angle is a random walk with coefficient N = √(R h)."""


class _Decaying(Part, frozen=True):
    """An AR(1) process with standard deviation σ and correlation time τ."""

    symbols: ClassVar[dict[str, Symbol]] = {"sigma": Symbol("σ", "{unit}"), "tau_s": Symbol("τ", "s")}

    sigma: float
    tau_s: float

    def eta(self, h: float) -> list[float]:
        return [free.log(self.sigma**2), free.log(h / self.tau_s)]

    @classmethod
    def of_eta(cls, eta: Sequence[float], h: float) -> Self:
        return cls(math.exp(eta[0] / 2), h * math.exp(-eta[1]))


class Relaxation(_Decaying, frozen=True, tag="relaxation"):
    """A first-order Gauss–Markov process with standard deviation σ and correlation time τ."""

    def words(self, rate_hz: float) -> str:
        return ""

    def response(self, lam: Array, h: float) -> Complex:
        a = math.exp(-h / self.tau_s)
        return np.asarray(self.sigma * math.sqrt(1 - a * a) / (1 - a * np.exp(-1j * lam)))

    def own_poles(self, lam: Array, h: float, room: int) -> list[complex]:
        return [math.exp(-h / self.tau_s)]


class Alternating(_Decaying, frozen=True, tag="alternating"):
    """A relaxation with the sign of every second sample changed: AR(1) with a negative coefficient."""

    def words(self, rate_hz: float) -> str:
        return "noise that alternates in sign"

    def own_poles(self, lam: Array, h: float, room: int) -> list[complex]:
        return [-math.exp(-h / self.tau_s)]


class Walk(Part, frozen=True, tag="walk"):
    """A random walk of the rate. Each step has the variance K² h."""

    symbols: ClassVar[dict[str, Symbol]] = {"K": Symbol("K", "{unit}/√s")}

    K: float

    def eta(self, h: float) -> list[float]:
        return [free.log(self.K**2 * h)]

    @classmethod
    def of_eta(cls, eta: Sequence[float], h: float) -> Self:
        return cls(math.sqrt(math.exp(eta[0]) / h))

    def words(self, rate_hz: float) -> str:
        return "a random walk"

    def response(self, lam: Array, h: float) -> Complex:
        return np.asarray(self.K * math.sqrt(h) / (1 - np.exp(-1j * lam)))

    def own_poles(self, lam: Array, h: float, room: int) -> list[complex]:
        return []


class Order(Part, frozen=True, tag="order"):
    """The fractional state D^α x = f x + ω of `fltea.noise.simulation`, with f in s^-α and Q = var ω."""

    symbols: ClassVar[dict[str, Symbol]] = {
        "alpha": Symbol("α", ""),
        "f": Symbol("f", "s^-α"),
        "Q": Symbol("Q", f"{VARIANCE}·s^-2α"),
    }

    alpha: float
    f: float
    Q: float

    def eta(self, h: float) -> list[float]:
        g = g_of(self.alpha, self.f, h)
        if not stationary(self.alpha, g):
            raise ValueError(f"α = {self.alpha:g}, f = {self.f:g} is not stationary at h = {h:g} s")
        return [self.alpha, free.logit(-g / 2**self.alpha), free.log(step_variance(self.alpha, self.Q, h))]

    @classmethod
    def of_eta(cls, eta: Sequence[float], h: float) -> Self:
        alpha, s2 = eta[0], math.exp(eta[2])
        return cls(alpha, f_of(alpha, g_of_eta(eta), h), noise_variance(alpha, s2, h))

    def words(self, rate_hz: float) -> str:
        return ""  # another sentence of the verdict states the order, with its interval

    def response(self, lam: Array, h: float) -> Complex:
        turn = np.exp(-1j * lam)
        s = math.sqrt(step_variance(self.alpha, self.Q, h))
        return np.asarray(s / ((1 - turn) ** self.alpha - g_of(self.alpha, self.f, h) * turn))

    def own_poles(self, lam: Array, h: float, room: int) -> list[complex]:
        slowest = float(lam[0]) / 2
        found = [*pole_sets.of_order(self.alpha, g_of(self.alpha, self.f, h), slowest), 0.0]
        return [*found, *pole_sets.spread(slowest, room - pole_sets.size(found))]


class Arfima(Part, frozen=True, tag="arfima"):
    """A fractional order without the parameter f: ARFIMA(1, d, 0) with innovations of variance s2."""

    symbols: ClassVar[dict[str, Symbol]] = {
        "d": Symbol("d", ""),
        "phi": Symbol("phi", ""),
        "s2": Symbol("s2", VARIANCE),
    }

    d: float
    phi: float
    s2: float

    def eta(self, h: float) -> list[float]:
        # The free parameters are d, log(-log φ) for the AR coefficient φ, and log(s2 / (1 - φ)²).
        rate = math.log(-math.log(max(self.phi, 1e-6)))
        return [self.d, rate, free.log(self.s2) - 2 * math.log1p(-self.phi)]

    @classmethod
    def of_eta(cls, eta: Sequence[float], h: float) -> Self:
        phi = math.exp(-math.exp(eta[1]))
        return cls(eta[0], phi, math.exp(eta[2]) * (1 - phi) ** 2)

    def words(self, rate_hz: float) -> str:
        return ""  # another sentence of the verdict states the order, with its interval

    def response(self, lam: Array, h: float) -> Complex:
        turn = np.exp(-1j * lam)
        return np.asarray(math.sqrt(self.s2) * (1 - turn) ** -self.d / (1 - self.phi * turn))

    def own_poles(self, lam: Array, h: float, room: int) -> list[complex]:
        return [self.phi, 0.0, *pole_sets.spread(float(lam[0]) / 2, room - 2)]


class Resonance(Part, frozen=True, tag="resonance"):
    """A resonance of one pair of poles.

    Its parameters include the height of the spectrum at its frequency, and the width at half this height.
    """

    symbols: ClassVar[dict[str, Symbol]] = {
        "height": Symbol("height", VARIANCE),
        "frequency_hz": Symbol("frequency", "Hz"),
        "width_hz": Symbol("width", "Hz"),
    }

    height: float
    frequency_hz: float
    width_hz: float

    def eta(self, h: float) -> list[float]:
        half = free.log(self.width_hz / 2 / self.frequency_hz)
        return [free.log(self.height), free.log_lam(self.frequency_hz, h), half]

    @classmethod
    def of_eta(cls, eta: Sequence[float], h: float) -> Self:
        return cls(math.exp(eta[0]), free.hz(eta[1], h), 2 * free.hz(eta[1], h) * math.exp(eta[2]))

    def words(self, rate_hz: float) -> str:
        return f"a resonance at {in_hz(self.frequency_hz)}"

    def own_poles(self, lam: Array, h: float, room: int) -> list[complex]:
        return [self.pole(h)]

    def pole(self, h: float) -> complex:
        """Return the upper one of the pair of poles."""
        return complex(np.exp(complex(-self.width_hz, 2 * self.frequency_hz) * math.pi * h))


class Quantisation(Part, frozen=True, tag="quantisation"):
    """Quantisation noise of a rate that is the difference of rounded angles.

    The rounding errors of the angle are white noise with standard deviation Q.
    """

    symbols: ClassVar[dict[str, Symbol]] = {"Q": Symbol("Q", "{unit}·s")}

    Q: float

    def eta(self, h: float) -> list[float]:
        return [free.log((self.Q / h) ** 2)]

    @classmethod
    def of_eta(cls, eta: Sequence[float], h: float) -> Self:
        return cls(h * math.exp(eta[0] / 2))

    def words(self, rate_hz: float) -> str:
        return "quantisation noise of an angle"

    def own_poles(self, lam: Array, h: float, room: int) -> list[complex]:
        return pole_sets.short(2)


class Rise(Part, frozen=True, tag="rise"):
    """Noise whose power rises with frequency as |1 - e^{-iλ}|^2δ, up to `power` at half the sample rate."""

    symbols: ClassVar[dict[str, Symbol]] = {"power": Symbol("power", VARIANCE), "delta": Symbol("delta", "")}

    power: float
    delta: float

    def eta(self, h: float) -> list[float]:
        return [free.log(self.power), self.delta]

    @classmethod
    def of_eta(cls, eta: Sequence[float], h: float) -> Self:
        return cls(math.exp(eta[0]), eta[1])

    def words(self, rate_hz: float) -> str:
        return f"noise whose power rises as frequency^{2 * self.delta:.2g}"

    def own_poles(self, lam: Array, h: float, room: int) -> list[complex]:
        return [-0.4, -0.8, *pole_sets.spread(1e-2, room - 2)]


class Floor(_Level, frozen=True, tag="floor"):
    """White noise of variance R that is added after all filters, such as rounding noise."""


AnyPart = (
    White
    | Relaxation
    | Walk
    | Order
    | Resonance
    | Quantisation
    | Rise
    | LowPass
    | HighPass
    | Sharpening
    | Notch
    | Mean
    | Alternating
    | Floor
    | Arfima
)


def _by_number() -> tuple[type[Part], ...]:
    """Return the kinds of parts, in the order of their numbers in the native table.

    Raises:
        LookupError: a part is missing in the native table or in this module.
    """
    here: dict[str, type[Part]] = {kind.tag(): kind for kind in get_args(AnyPart)}
    native = [row.name for row in ROWS if "other" not in row.traits]
    if apart := here.keys() ^ set(native):
        raise LookupError(
            f"{', '.join(sorted(apart))}: a part has a row in kTable of host/native/whittle_parts.hpp, and "
            "a class in AnyPart of host/fltea/noise/parts.py with the row's name for its tag"
        )
    return tuple(here[name] for name in native)


CODES = _by_number()
"""The kinds of parts, indexed by their code numbers in the native module."""
FILTERS = tuple(kind for kind in CODES if kind.has("filter"))
SLOW = tuple(kind for kind in CODES if kind.has("slow"))
"""Kinds of parts that are slow, such as walks and relaxations. A tracker has states for these parts."""


def kind_of(code: int) -> type[Part]:
    """Return the kind of part that this code number stands for."""
    return Mean if code >= MEAN_FROM else CODES[code]


def kind_named(tag: str) -> type[Part]:
    """Return the kind of part with the tag `tag`."""
    return CODES[BY_NAME[tag].code]


def free_of(code: int) -> int:
    """Return the number of free parameters of the kind of part that this code number stands for."""
    return 0 if code >= MEAN_FROM else len(ROWS[code].free_parameters)


def high_pass_of(parts: Iterable[Part]) -> HighPass | None:
    """Return the high-pass among the parts; None if there is none."""
    return next((part for part in parts if isinstance(part, HighPass)), None)


def part_of(code: int, eta: Sequence[float], h: float) -> Part:
    """Return the part with this code number and the free parameters `eta`."""
    return Mean(code - MEAN_FROM) if code >= MEAN_FROM else CODES[code].of_eta(eta, h)


def spectrum(parts: Iterable[Part], lam: Array, h: float) -> Array:
    """Return the spectrum of a noise made of `parts` at frequencies λ > 0, (len(lam),).

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
    """Return the spectrum at λ of parts given by code numbers and free parameters.

    The first part has to be white noise.
    """
    found = np.empty(len(lam))
    _native.model_spectrum(list(codes), list(eta), np.ascontiguousarray(lam, dtype=np.float64), h, found)
    return found
