"""Model the noise of one axis, and draw Gaussian noise with the spectrum of the model."""

import math
from collections.abc import Iterator
from typing import cast

import msgspec
import numpy as np

from fltea.noise.parts import FILTERS, AnyPart, Floor, Part, Relaxation, Walk, White, high_pass_of, spectrum
from fltea.records.arrays import Array
from fltea.spectrum.candidate_models import FittedModel
from fltea.spectrum.spectral_lines import Peak

AROUND = 4
"""The period of the drawn noise is at least this many times the length of the record.

The noise is drawn periodic, and one record is cut out of a period.
"""
SHORTEST_CIRCLE = 1 << 16


class Lorentzian(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A spectral line or resonance that a noise model has in addition to its parts.

    It has a variance and a width at half height.
    """

    frequency_hz: float
    width_hz: float
    variance: float

    def __post_init__(self) -> None:
        if not (self.frequency_hz > 0 and self.width_hz > 0):
            raise ValueError("frequency_hz and width_hz must be > 0")
        if not self.variance >= 0:
            raise ValueError(f"variance must be 0 or more, got {self.variance}")


class AxisModel(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The noise model of one axis, without the constant offset."""

    parts: tuple[AnyPart, ...]
    resonances: tuple[Lorentzian, ...] = ()
    """Spectral lines and resonances that were left out of the fit of `parts`. The model does not contain
    combs, which are the spectral lines of events at equal intervals.
    """
    offset_walk: float = 0.0
    """K of the offset's random walk per √s, which the forecast has in addition to the parts.

    K is 0 if one of the parts is a random walk.
    """
    offset_relaxation: Relaxation | None = None
    """A random walk of the offset that is bounded, modelled as a relaxation (first-order Gauss-Markov
    process). The forecast has it in addition to the parts. None if there is no such walk.
    """

    def __post_init__(self) -> None:
        if not 0 <= self.offset_walk < math.inf:
            raise ValueError(f"offset_walk must be 0 or more, got {self.offset_walk}")

    @property
    def white(self) -> float:
        """Variance of the white noise that is added after all filters."""
        filtered = any(isinstance(part, FILTERS) for part in self.parts)
        kinds = Floor if filtered else White | Floor
        return sum(part.R for part in self.parts if isinstance(part, kinds))

    @property
    def walk(self) -> float:
        """Sum of K² of the offset's random walk and of the unbounded random walks in `parts`.

        Behind a high-pass, the walks in `parts` are bounded, so they do not count.
        """
        endless = 0.0 if high_pass_of(self.parts) else sum(p.K**2 for p in self.parts if isinstance(p, Walk))
        return self.offset_walk**2 + endless


def modelled(model: FittedModel, peaks: tuple[Peak, ...], std: float, h: float) -> AxisModel:
    """Return the noise model of an axis: the parts of a fitted model, and peaks left out of the fit.

    `std`: standard deviation of all samples. The variance of a peak is its share of power times std². `h`:
    sampling period [s].
    """
    return AxisModel(
        cast(tuple[AnyPart, ...], model.parts(h)),
        tuple(
            Lorentzian(peak.frequency_hz, peak.width_hz, float(max(peak.power_share, 0.0) * std**2))
            for peak in peaks
            if peak.repeats is None
        ),
    )


def model_spectrum(model: AxisModel, lam: Array, h: float) -> Array:
    """Return the spectrum of the model at λ > 0, normalised like `periodogram`."""
    offset: list[Part] = [Walk(model.offset_walk)]
    if model.offset_relaxation is not None:
        offset.append(model.offset_relaxation)
    total = spectrum(model.parts, lam, h) + spectrum(offset, lam, h)
    frequency_hz = lam / (2 * np.pi * h)
    for r in model.resonances:
        half = r.width_hz / 2
        shape = 1 / (1 + ((frequency_hz - r.frequency_hz) / half) ** 2)
        low, high = np.arctan(np.array([-r.frequency_hz, 0.5 / h - r.frequency_hz]) / half)
        # scaled so that the resonance's mean spectrum from 0 to the Nyquist frequency is its variance
        total = total + r.variance * shape * (0.5 / h) / (half * (high - low))
    return total


def check_possible(model: AxisModel, h: float) -> None:
    """Raise ValueError if the model has no spectrum or no finite variance. `h`: sampling period [s]."""
    for part in model.parts:
        kind = str(part.__struct_config__.tag)
        try:
            found = spectrum((part,), np.geomspace(1e-3, np.pi, 20), h)
        except ZeroDivisionError:
            found = np.array([np.nan])
        if not np.isfinite(found).all():
            raise ValueError(f"a {kind} cannot have {', '.join(_told(part))}")
    for resonance in model.resonances:
        if resonance.frequency_hz >= 0.5 / h:
            raise ValueError(f"a resonance at {resonance.frequency_hz:g} Hz is above half the sample rate")


def _told(part: AnyPart) -> Iterator[str]:
    for name in part.__struct_fields__:
        yield f"{name} = {getattr(part, name):g}"


def draw(model: AxisModel, h: float, n: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Draw n samples of Gaussian noise with the model's spectrum.

    Returns the samples y (n,), and x (n,), the same noise without its white part.

    Oscillations with a period of more than AROUND records are mostly left out, since within one record they
    are like an offset. Of a random walk's slow oscillations, the slope within the record is added.
    """
    return next(draws(model, h, n, rng))


def draws(model: AxisModel, h: float, n: int, rng: np.random.Generator) -> Iterator[tuple[Array, Array]]:
    """Yield pairs as `draw` returns them, without end."""
    circle = 1 << (max(AROUND * n, SHORTEST_CIRCLE) - 1).bit_length()
    lam = 2 * np.pi * np.arange(1, circle // 2 + 1) / circle
    R = model.white
    size = np.sqrt(np.maximum(model_spectrum(model, lam, h) - R, 0.0) * (circle / 2))
    # The noise is drawn with a period of `circle` samples, so the steps of a random walk add up to 0 over a
    # period. The steps of a real walk add up to a random sum. It is added as a slope.
    tilt = math.sqrt(model.walk * h / circle)
    while True:
        waves = np.zeros(circle // 2 + 1, dtype=np.complex128)
        waves[1:] = rng.standard_normal(circle // 2) + 1j * rng.standard_normal(circle // 2)
        waves[-1] = math.sqrt(2) * waves[-1].real
        waves[1:] *= size
        x = np.fft.irfft(waves, circle)[:n]
        if tilt:
            x += tilt * rng.standard_normal() * np.arange(n)
        yield x + math.sqrt(R) * rng.standard_normal(n), x
