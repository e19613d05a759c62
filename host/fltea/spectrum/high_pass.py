"""Find which parts of a model with a high-pass are noise, and which only describe the filter's shape.

A real filter may subtract a running mean, the mean of each block, or an offset estimated at rest. Its
response is not exactly that of the fitted high-pass. So the model may describe the difference by further
parts, which are no noise. For example, the density of white noise after such a filter may oscillate above
the corner frequency. After a running mean, its highest value is 1.48 times the value far above the corner.

In addition, a record begins and ends abruptly, so power leaks into the low frequencies that the filter stops.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from fltea.noise.filters import HighPass
from fltea.noise.parts import Floor, Part, Relaxation, Resonance, White, high_pass_of
from fltea.spectrum.candidate_models import CandidateModels, FittedModel
from fltea.spectrum.octaves import WHOLE

SWINGS, RINGS = 2.0, 4.0
"""Near the filter's corner frequency, the density may have a maximum that is the filter's own shape, and no
noise. It counts as such if it is lower than SWINGS times the density of the white noise, where the model
describes it by a relaxation. Where the model describes it by a resonance, the limit is RINGS times that
density.
"""
NEAR = 10.0
"""The shape of the filter is examined up to this multiple of its corner frequency."""
POINTS = 64
LEAKS_AT_MOST = 15.0
"""The power that leaks from the ends of a record is about the square of one normal random number. With a
probability of 99.99 % it is below this multiple of its mean.
"""


class HighPassed(NamedTuple):
    """The high-pass of a model, and which of the model's other parts are real noise."""

    high_pass: HighPass
    parts: tuple[Part, ...]
    """The parts of the model that are real noise. The filter is not among them, and no part that only
    describes the filter's shape or the power that leaks from the record's ends.
    """

    @property
    def is_all(self) -> bool:
        """Whether white noise is the only part that is real noise."""
        return all(isinstance(part, White | Floor) for part in self.parts)

    @property
    def told(self) -> tuple[Part, ...]:
        """The parts to report: the parts that are real noise, and the filter."""
        return *self.parts, self.high_pass


def high_passed(
    f: CandidateModels, model: FittedModel, parts: Sequence[Part], from_hz: float
) -> HighPassed | None:
    """Return which of `parts`, the parts of `model`, are real noise."""
    high_pass = high_pass_of(parts)
    if high_pass is None:
        return None
    crest = _crest(f, model, high_pass, from_hz)
    leak = LEAKS_AT_MOST * end_leak(f, model)
    return HighPassed(high_pass, tuple(one for one in parts if _is_left(one, high_pass, crest, leak)))


def stands_for_shape(f: CandidateModels, model: FittedModel, from_hz: float) -> bool:
    """Return whether all parts other than the high-pass may only describe the shape of this filter."""
    high_pass = high_pass_of(model.parts(f.h))
    return high_pass is not None and _crest(f, model, high_pass, from_hz) < SWINGS


def end_leak(f: CandidateModels, model: FittedModel) -> float:
    """Return the mean density that leaks from the ends of the record into the lowest frequencies.

    The result is 0 if the model has no high-pass: at these frequencies, other noise is then far stronger. The
    higher frequencies come from octaves with windows, into which nothing leaks.
    """
    parts = model.parts(f.h)
    if high_pass_of(parts) is None or not f.samples:
        return 0.0
    lam = np.geomspace(math.pi / f.samples, min(math.pi, math.pi * WHOLE / f.samples), POINTS)
    floor = sum(part.R for part in parts if isinstance(part, Floor))
    density = np.maximum(model.spectrum(lam, f.h) - floor, 0.0)
    # A record begins and ends abruptly, so the power of a wave of the frequency λ leaks into other
    # frequencies. In a record of n samples, a wave of variance 1 adds about 1 / (2 sin²(λ/2)) / n to the
    # density near 0.
    return float(np.trapezoid(density / np.sin(lam / 2) ** 2, lam)) / (2 * math.pi * f.samples)


def _crest(f: CandidateModels, model: FittedModel, high_pass: HighPass, from_hz: float) -> float:
    """Return the ratio of the largest density around the filter's corner frequency to that of white noise."""
    far = min(NEAR * high_pass.corner_hz, 0.5 / f.h)
    hz = np.geomspace(min(from_hz, far / 2), far, POINTS)
    density = model.spectrum(2 * np.pi * hz * f.h, f.h)
    white = sum(part.R for part in model.parts(f.h) if isinstance(part, White | Floor))
    return float(density.max()) / white


def _is_left(part: Part, high_pass: HighPass, crest: float, leak: float) -> bool:
    most = RINGS if isinstance(part, Resonance) else SWINGS
    near = NEAR * high_pass.corner_hz if crest < most else 0.0
    if part.has("no high-pass"):
        return False
    match part:
        case HighPass():
            return False
        case Floor():
            return leak < part.R
        case Relaxation():
            return 1 / (2 * math.pi * part.tau_s) > near
        case Resonance():
            return part.frequency_hz > near
        case _:
            return True
