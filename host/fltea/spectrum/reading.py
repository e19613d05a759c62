"""Find the parts of a model without an order that describe the noise itself.

A model is fitted to a spectrum as closely as possible. So one of its parts may only imitate something other
than the noise: the skirt of a spectral peak that was left out, or the difference between the true filter and
the fitted filter. Such parts are left out. The remaining parts are reported: relaxations, drift, a filter, a
resonance, or a density that rises with the frequency.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from fltea.noise.filters import HighPass, LowPass, Mean, Notch, Sharpening
from fltea.noise.parts import CODES, Part, Relaxation, Resonance, Walk, free_of, part_of
from fltea.noise.parts import SLOW as SLOW_PARTS
from fltea.spectrum.candidate_models import CandidateModels, FittedModel
from fltea.spectrum.high_pass import HighPassed, high_passed
from fltea.spectrum.spectral_lines import Peak

SLOW = 3.0
"""A relaxation counts as drift if its corner frequency is below this multiple of the lowest fitted
frequency.
"""
LARGE_SHARE = 0.05
"""If a peak has more than this proportion of all power, a part of the model may only imitate the peak's
skirts.
"""
LINE_LEAKS, RESONANCE_LEAKS = 2.0, 6.0
"""The power of a peak at the frequency f is expected between f / k and k f, which includes its leakage and
skirts. The factor k is LINE_LEAKS for a spectral line, and RESONANCE_LEAKS for a resonance.
"""
NO_WHITE = 0.03
"""White noise counts as absent if its density is less than this proportion of the whole noise's density at
half the sample rate.
"""
LEAST_CORNER = 10.0
"""Without white noise, the fastest relaxation of a model may stand for a low-pass filter. It counts as one if
its corner frequency is more than this many times the lowest fitted frequency.
"""
NEAR_THE_FILTER = 0.1
"""A fitted low-pass filter differs a little from the true one, and a relaxation may only make up for the
difference. This is possible for a corner frequency of the relaxation that is at least this many times the
corner frequency of the filter.
"""
AS_FILTERS_DIFFER = 1.6
"""The density in the pass band of a low-pass counts as flat if it falls by less than this factor, from the
lowest fitted frequency to a fifth of the filter's corner frequency. Then a relaxation near the corner
frequency is taken for the difference between the fitted filter and the true one.
"""
RIPPLES = 0.4
"""A resonance at this many times the corner frequency of the fitted low-pass, or higher, only describes the
shape of this filter. It is not reported.
"""
STANDS_OUT, ASIDE = 1.2, 3.0
"""A resonance counts only if the density at its frequency is more than STANDS_OUT times the densities at two
other frequencies: ASIDE times its frequency, and its frequency divided by ASIDE.
"""
SMOOTHS = -0.15
"""The filter `Sharpening` weights three samples by -s, 1 + 2 s and -s. If s is below this value, it counts as
a low-pass.
"""
RISES, HIGHEST = 1.05, 0.85
"""The highest frequencies are those above HIGHEST times half the sample rate. The density counts as rising
with the frequency if its mean there is more than RISES times the density at the lowest fitted frequency.
"""

SLOW_SAYS = frozenset(kind.row().says for kind in SLOW_PARTS)
"""Names of the questions whether there is slow noise, such as a random walk (see `Reading.says`)."""
OF_MODEL = frozenset({"nothing", "relaxations", "resonance", "notch", "high-pass"})
"""Names of the questions that no single part of a model can answer. Each other question is answered with yes
if the model has a part that says so. What a part says is in its row of `kTable`
(host/native/whittle_parts.hpp).
"""


class Reading(NamedTuple):
    """What a model says about the noise in addition to white noise."""

    says: frozenset[str]
    """Names of the questions about the noise to which the answer is yes (`spectrum.answers`). The names are
    those of the enum `Says` in host/native/whittle_parts.hpp. The table there gives for each part of a model
    the question to which it says yes. Relaxations differ in two cases. One that is too slow to be
    distinguished from a random walk says "drift", and one that is a filter says "colour".
    """
    relaxations: tuple[Relaxation, ...]
    """The relaxations whose corner frequency is in the fitted band, the slowest first."""
    low_pass: LowPass | None
    """The low-pass through which the whole noise has passed."""
    resonance: Resonance | None
    notch: Notch | None
    rises: bool
    """Whether the density is highest at the highest frequencies."""
    high_pass: HighPassed | None = None
    """The high-pass filter that removed all slow noise, and the parts of the noise that remain; None without
    such a filter.
    """


def corner_hz(part: Relaxation) -> float:
    """Return the frequency [Hz] at which a relaxation has half of its low-frequency density."""
    return 1 / (2 * math.pi * part.tau_s)


def read(f: CandidateModels, from_hz: float, peaks: Sequence[Peak] = (), apart: float = math.inf) -> Reading:
    """Return what the best model without an order says about the noise.

    Parts of the model that only imitate `peaks` are left out. `from_hz`: lowest fitted frequency [Hz].
    `apart`: a slow relaxation is reported only if 2 log L (twice the log likelihood) is higher by more than
    this than with a random walk. A high-pass is reported only if BIC is lower by more than this than with
    white noise alone.
    """
    model, h = f.plain, f.h
    parts = [p for p in model.parts(h) if not (_is_skirt(p, peaks) or _is_left_out(p, f))]
    behind = high_passed(f, model, parts, from_hz) if -f.bic(model) > apart else None
    if behind is not None:
        parts = list(behind.parts)
        model = model.without(HighPass)
    first, last = _ends(f, model, from_hz)
    relaxations = sorted((p for p in parts if isinstance(p, Relaxation)), key=corner_hz)
    low_pass = _filter(parts, h)
    if low_pass is None and relaxations:
        fastest = relaxations[-1]
        rest = last - _highest(fastest, h)
        if rest < NO_WHITE * last and corner_hz(fastest) > LEAST_CORNER * from_hz:
            low_pass = LowPass(corner_hz(fastest), 1.0)
            relaxations = relaxations[:-1]
    if low_pass is not None and _flat(model, low_pass, h, from_hz):
        near = NEAR_THE_FILTER * low_pass.corner_hz
        relaxations = [part for part in relaxations if corner_hz(part) < near]
    rises = last > RISES * first
    if rises:
        # Keep only relaxations that make up more than half of the density at the lowest frequency. The others
        # may only imitate the rise of the density towards high frequencies.
        relaxations = [p for p in relaxations if _lowest(p, h) > first / 2 and p.tau_s > h]
    inside = [
        part
        for part in relaxations
        if corner_hz(part) > SLOW * from_hz
        or (corner_hz(part) > from_hz and _behind_with_walk(f, part) > apart)
    ]
    notch = next((p for p in parts if isinstance(p, Notch)), None) if low_pass is None else None
    says = {part.row().says for part in parts} - OF_MODEL | {
        *(["relaxations"] if inside else []),
        *(["drift"] if len(inside) < len(relaxations) else []),
        *(["colour"] if low_pass is not None else []),
        *(["notch"] if notch is not None else []),
        *(["high-pass"] if behind is not None else []),
    }
    resonances = _resonances(parts, bool(says), model, low_pass, h)
    if not says and not resonances:
        inside = [part for part in parts if isinstance(part, Relaxation)]
        says |= {"relaxations"} if inside else set()
    return Reading(
        says=frozenset(says | {"resonance"} if resonances else says),
        relaxations=tuple(inside),
        low_pass=low_pass,
        resonance=resonances[0] if resonances else None,
        notch=notch,
        rises=rises,
        high_pass=behind,
    )


def _resonances(
    parts: Sequence[Part], beside: bool, model: FittedModel, low_pass: LowPass | None, h: float
) -> list[Resonance]:
    """Return the resonances that are part of the noise.

    Other resonances of the model only correct the shape of its other parts. `beside`: whether there are such
    other parts, besides white noise. If not, all resonances are part of the noise.
    """
    found = [part for part in parts if isinstance(part, Resonance)]
    if not beside:
        return found
    ripples = math.inf if low_pass is None else RIPPLES * low_pass.corner_hz
    return [part for part in found if part.frequency_hz < ripples and _stands_out(model, part, h)]


def _filter(parts: Sequence[Part], h: float) -> LowPass | None:
    for part in parts:
        if isinstance(part, LowPass):
            return part
        if isinstance(part, Mean):
            return LowPass(1 / (part.samples * h), 1.0)
        if isinstance(part, Sharpening) and part.s < SMOOTHS:
            return LowPass(1 / (2 * math.pi * h), 1.0)
    return None


def _flat(model: FittedModel, low_pass: LowPass, h: float, from_hz: float) -> bool:
    """Return whether the density in the filter's pass band is flat.

    Towards low frequencies it may rise by up to the factor AS_FILTERS_DIFFER. A rise of that size may come
    from the difference between the fitted and the true filter.
    """
    inside = max(from_hz, 1e-3 * low_pass.corner_hz)
    hz = np.array([inside, max(0.2 * low_pass.corner_hz, inside)])
    low, high = model.spectrum(np.minimum(2 * np.pi * hz * h, np.pi), h).tolist()
    return bool(low < AS_FILTERS_DIFFER * high)


def _behind_with_walk(f: CandidateModels, part: Relaxation) -> float:
    """Return the loss of 2 log L (twice the log likelihood) if a random walk replaces the relaxation."""
    codes: list[int] = []
    eta: list[float] = []
    for code, at in f.plain.terms():
        own = f.plain.eta[at : at + free_of(code)]
        if part_of(code, own, f.h) != part:
            codes.append(code)
            eta += own
    if CODES.index(Walk) not in codes:
        codes.append(CODES.index(Walk))
        eta += [math.log(part.sigma**2 * 2 * f.h / part.tau_s)]
    return 2 * (f.native.fit(codes, eta)[1] - f.plain.nll)


def _stands_out(model: FittedModel, part: Resonance, h: float) -> bool:
    """Return whether the sum of all parts has a maximum at the resonance, in spite of the other parts."""
    hz = part.frequency_hz * np.array([1.0, 1 / ASIDE, ASIDE])
    top, *sides = model.spectrum(np.minimum(2 * np.pi * hz * h, np.pi), h).tolist()
    return bool(top > STANDS_OUT * max(sides))


def _ends(f: CandidateModels, model: FittedModel, from_hz: float) -> tuple[float, float]:
    """Return the model's density at the lowest fitted frequency, and the mean density at the highest ones.

    The mean is taken over the fitted frequencies only. At other frequencies, the model of a filter may be
    zero, although the data have power there that leaks from neighbouring frequencies.
    """
    low = np.array([min(max(2 * np.pi * from_hz * f.h, 1e-3), np.pi)])
    high = f.data.lam >= min(HIGHEST * np.pi, f.data.lam[-1])
    density, counts = model.spectrum(f.data.lam, f.h)[high], f.data.counts[high]
    return float(model.spectrum(low, f.h)[0]), float((density * counts).sum() / counts.sum())


def _lowest(part: Relaxation, h: float) -> float:
    phi = math.exp(-h / part.tau_s)
    return part.sigma**2 * (1 + phi) / (1 - phi)


def _highest(part: Relaxation, h: float) -> float:
    phi = math.exp(-h / part.tau_s)
    return part.sigma**2 * (1 - phi) / (1 + phi)


def _is_left_out(part: Part, f: CandidateModels) -> bool:
    """Return whether the part is a resonance in a band whose data are left out, such as that of a peak."""
    if not isinstance(part, Resonance):
        return False
    hz = f.data.lam / (2 * math.pi * f.h)
    return not bool((np.abs(hz - part.frequency_hz) < part.width_hz).any())


def _is_skirt(part: Part, peaks: Sequence[Peak]) -> bool:
    """Return whether a part only describes the skirts of a resonance, or the leakage of a spectral line."""
    strong = [peak for peak in peaks if peak.power_share > LARGE_SHARE]
    match part:
        case Relaxation():
            hz = corner_hz(part)
        case Resonance():
            hz = part.frequency_hz
        case HighPass():
            hz = part.corner_hz
        case _:
            # Only a filter with free parameters can adapt to the skirts of a resonance.
            shaped = part.row().says == "colour" and part.row().free_parameters
            return bool(shaped) and any(peak.kind == "resonance" for peak in strong)
    return any(
        1 / reach < hz / peak.frequency_hz < reach
        for peak in strong
        for reach in [RESONANCE_LEAKS if peak.kind == "resonance" else LINE_LEAKS]
    )
