"""Describe the filters of a sensor, through which its noise passes before it is recorded.

They are parts of a noise (`fltea.noise.parts`), and have their fields and free parameters as other parts do.
"""

import math
from collections.abc import Sequence
from typing import ClassVar, Self

import numpy as np

from fltea import _native
from fltea.noise import free_parameters as free
from fltea.noise import pole_sets
from fltea.noise.part import OwnAnswer, Part, Symbol, in_hz
from fltea.records.arrays import Complex

MEAN_FROM = _native.MEAN_FROM
"""The code number of a `Mean` is MEAN_FROM plus the number of averaged samples."""
ONE_POLE = 1.5
"""A filter's number of poles need not be whole. Below this number, its description says "one pole"."""
WHOSE_FILTER = (
    "It is the sensor's own, or of the program that wrote the file (a flight controller, a logger): compare "
    "with their settings."
)
"""What to do about a filter in the recorded noise."""
OF_POLES = {"corner_hz": Symbol("corner", "Hz"), "poles": Symbol("poles", "")}
"""How tables show the parameters of a low-pass or a high-pass."""


class LowPass(Part, frozen=True, tag="low-pass"):
    """A low-pass before sampling, with power response 1 / (1 + (ω/ω_c)^2n) and n poles.

    The corner frequency may be above half the sample rate.
    """

    symbols: ClassVar[dict[str, Symbol]] = OF_POLES

    corner_hz: float
    poles: float

    def eta(self, h: float) -> list[float]:
        # The free parameters are log λ², where λ is the corner frequency in rad per sample, and the logit of
        # (poles - 1) / (MOST_POLES - 1).
        return [2 * free.log_lam(self.corner_hz, h), free.logit_of_poles(self.poles)]

    @classmethod
    def of_eta(cls, eta: Sequence[float], h: float) -> Self:
        return cls(free.hz(eta[0] / 2, h), free.poles_of_logit(eta[1]))

    def words(self, rate_hz: float) -> str:
        where = f"at {in_hz(self.corner_hz)}"
        if self.corner_hz >= rate_hz / 2:
            where = f"near or beyond {in_hz(rate_hz / 2)}, half the sample rate"
        return f"a low-pass with its corner {where} ({_steepness(self.poles)})"

    def filter_poles(self, h: float) -> tuple[list[complex], int]:
        return pole_sets.of_low_pass(2 * math.pi * self.corner_hz * h, self.poles)


class HighPass(Part, frozen=True, tag="high-pass"):
    """A high-pass, which blocks slow signals as AC coupling does.

    Its power response is 1 / (1 + (s_c/s)^2n), where s = 2 sin(ω h/2), s_c is s at the corner frequency and n
    is the number of poles. With one pole, the filter subtracts an exponentially weighted average from the
    samples. The corner frequency is at most a tenth of the sample rate. A high-pass with a higher corner
    frequency is described by the part `Rise`, noise whose power rises with frequency.
    """

    symbols: ClassVar[dict[str, Symbol]] = OF_POLES

    corner_hz: float
    poles: float

    def eta(self, h: float) -> list[float]:
        # The free parameters are log |1 - e^{-iλ}|², where λ is the corner frequency in rad per sample, and
        # the logit of (poles - 1) / (MOST_POLES - 1).
        size = 2 * math.sin(min(math.pi * self.corner_hz * h, math.pi / 2))
        return [2 * free.log(size), free.logit_of_poles(self.poles)]

    @classmethod
    def of_eta(cls, eta: Sequence[float], h: float) -> Self:
        sine = min(math.exp(eta[0] / 2) / 2, 1.0)
        return cls(math.asin(sine) / (math.pi * h), free.poles_of_logit(eta[1]))

    def words(self, rate_hz: float) -> str:
        return f"a high-pass with its corner at {in_hz(self.corner_hz)} ({_steepness(self.poles)})"

    def filter_poles(self, h: float) -> tuple[list[complex], int]:
        return [z for z in self.all_poles(h).tolist() if z.imag > -1e-12], 0

    def all_poles(self, h: float) -> Complex:
        """Return all poles of the filter, also the lower ones of complex pairs."""
        return pole_sets.of_high_pass(2 * math.pi * self.corner_hz * h, self.poles)


class Sharpening(Part, frozen=True, tag="sharpening"):
    """The filter with taps -s, 1 + 2 s, -s. It sharpens for s > 0, and smooths for s < 0."""

    symbols: ClassVar[dict[str, Symbol]] = {"s": Symbol("s", "")}

    s: float

    def eta(self, h: float) -> list[float]:
        return [self.s]

    @classmethod
    def of_eta(cls, eta: Sequence[float], h: float) -> Self:
        return cls(eta[0])

    def words(self, rate_hz: float) -> str:
        return f"a short filter that {'sharpens' if self.s > 0 else 'smooths'}"

    def filter_poles(self, h: float) -> tuple[list[complex], int]:
        return [], 3


class Notch(Part, frozen=True, tag="notch"):
    """A filter that stops one frequency. `width_hz` is its width where half the power passes."""

    answer: ClassVar[OwnAnswer | None] = OwnAnswer("notch", WHOSE_FILTER)
    symbols: ClassVar[dict[str, Symbol]] = {
        "frequency_hz": Symbol("frequency", "Hz"),
        "width_hz": Symbol("width", "Hz"),
    }

    frequency_hz: float
    width_hz: float

    def eta(self, h: float) -> list[float]:
        # The free parameters are the logarithms of the frequency λ and of the ratio of the width to the
        # frequency.
        return [free.log_lam(self.frequency_hz, h), free.log(self.width_hz / self.frequency_hz)]

    @classmethod
    def of_eta(cls, eta: Sequence[float], h: float) -> Self:
        return cls(free.hz(eta[0], h), free.hz(eta[0], h) * math.exp(eta[1]))

    def words(self, rate_hz: float) -> str:
        return f"a notch at {in_hz(self.frequency_hz)}"

    def filter_poles(self, h: float) -> tuple[list[complex], int]:
        # The poles follow from those of an analog notch by the bilinear transform.
        centre = math.tan(math.pi * self.frequency_hz * h)
        s = np.roots([1.0, centre * self.width_hz / self.frequency_hz, centre**2])
        return [z for z in ((1 + s) / (1 - s)).tolist() if complex(z).imag > -1e-12], 0


class Mean(Part, frozen=True, tag="mean"):
    """A filter whose output is the mean of the last `samples` samples."""

    symbols: ClassVar[dict[str, Symbol]] = {"samples": Symbol("samples", "")}

    samples: int

    @property
    def code(self) -> int:
        """The code number of the part in the native module."""
        return MEAN_FROM + self.samples

    def eta(self, h: float) -> list[float]:
        return []

    def words(self, rate_hz: float) -> str:
        return f"the mean of {self.samples} samples"

    def filter_poles(self, h: float) -> tuple[list[complex], int]:
        return [], self.samples


def _steepness(poles: float) -> str:
    return "one pole" if poles < ONE_POLE else "steep" if poles > 8 else f"about {poles:.0f} poles"
