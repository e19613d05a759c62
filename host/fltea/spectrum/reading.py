"""What a model without an order says about the noise: relaxations, drift, a filter, a resonance, a rise.

A model describes a spectrum as well as it can. So one of its parts may be only the trace of something else:
the skirt of a peak that was found, or the difference between the true filter and the fitted one. Such traces
are removed, and the remaining parts are reported.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from fltea.noise.parts import (
    CODES,
    HighPass,
    LowPass,
    Mean,
    Notch,
    Part,
    Relaxation,
    Resonance,
    Sharpening,
    Walk,
    free_of,
    part_of,
)
from fltea.spectrum.candidate_models import CandidateModels, FittedModel
from fltea.spectrum.high_pass import HighPassed, high_passed
from fltea.spectrum.spectral_lines import Peak

SLOW = 3.0
"""A relaxation counts as drift if its corner frequency is below this multiple of the lowest fitted
frequency.
"""
LARGE_SHARE = 0.05
"""A peak with at least this share of the power leaves a visible trace in the model."""
LINE_LEAKS, RESONANCE_LEAKS = 2.0, 6.0
"""LINE_LEAKS: a spectral line leaks into frequencies up to this factor away. RESONANCE_LEAKS: the skirts of a
resonance reach up to this factor away.
"""
NO_WHITE = 0.03
"""White noise counts as absent if it has less than this share of the density at half the sample rate."""
LEAST_CORNER = 10.0
"""If there is no white noise, a relaxation whose corner frequency is above this multiple of the lowest
frequency counts as a filter.
"""
NEAR_THE_FILTER = 0.1
"""A relaxation may be only an error of the fitted filter if its corner frequency is above this share of the
filter's.
"""
AS_FILTERS_DIFFER = 1.6
"""If the densities in the pass band differ by at most this ratio, a relaxation counts as an error of the
fitted filter.
"""
RIPPLES = 0.4
"""A hump belongs to the filter if its frequency is above this share of the filter's corner frequency."""
STANDS_OUT, ASIDE = 1.2, 3.0
"""A resonance has to be STANDS_OUT times as high as the density at ASIDE times its frequency and at 1/ASIDE
of it."""
SMOOTHS = -0.15
"""A short filter whose parameter s is below this value is a low-pass."""
RISES, HIGHEST = 1.05, 0.85
"""The density counts as rising if its mean above the share HIGHEST of half the sample rate is at least RISES
times the density at the lowest frequency.
"""


class Reading(NamedTuple):
    """What a model says in addition to white noise."""

    relaxations: tuple[Relaxation, ...]
    """The relaxations whose corner frequency is in the fitted band, the slowest first."""
    drifts: bool
    """Whether there is a random walk, or a relaxation too slow to be distinguished from one."""
    low_pass: LowPass | None
    """The low-pass through which the whole noise has passed."""
    resonance: Resonance | None
    notch: Notch | None
    rises: bool
    """Whether the density is highest at the highest frequencies."""
    coloured: bool
    """Whether there is a filter or a rise of any kind."""
    high_pass: HighPassed | None = None
    """The high-pass filter that removed all slow noise, and the parts that remain."""


def corner_hz(part: Relaxation) -> float:
    """Return the frequency [Hz] at which a relaxation has half of its low-frequency density."""
    return 1 / (2 * math.pi * part.tau_s)


def read(f: CandidateModels, from_hz: float, peaks: Sequence[Peak] = (), apart: float = math.inf) -> Reading:
    """Return what the best model without an order says, after the traces of `peaks` are removed from it.

    `from_hz`: lowest fitted frequency. `apart`: difference in 2 log L by which a slow relaxation has to beat
    a random walk, and a model with a high-pass has to beat white noise.
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
        # Relaxations that raise the density at low frequencies are kept, since they are no trace of the
        # rise at high frequencies.
        relaxations = [p for p in relaxations if _lowest(p, h) > first / 2 and p.tau_s > h]
    inside = [
        part
        for part in relaxations
        if corner_hz(part) > SLOW * from_hz
        or (corner_hz(part) > from_hz and _behind_with_walk(f, part) > apart)
    ]
    drifts = len(inside) < len(relaxations) or any(part.row().says == "drift" for part in parts)
    notch = next((p for p in parts if isinstance(p, Notch)), None) if low_pass is None else None
    coloured = low_pass is not None or any(part.row().says == "colour" for part in parts)
    resonances = [part for part in parts if isinstance(part, Resonance)]
    if inside or drifts or coloured or notch is not None or behind is not None:
        # Beside other parts, a resonance may only correct their shape. A resonance without other parts is
        # real.
        ripples = math.inf if low_pass is None else RIPPLES * low_pass.corner_hz
        resonances = [p for p in resonances if p.frequency_hz < ripples and _stands_out(model, p, h)]
    elif not resonances:
        inside = [part for part in parts if isinstance(part, Relaxation)]
    return Reading(
        relaxations=tuple(inside),
        drifts=drifts,
        low_pass=low_pass,
        resonance=resonances[0] if resonances else None,
        notch=notch,
        rises=rises,
        coloured=coloured,
        high_pass=behind,
    )


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
    """Return whether the pass band is flat.

    Deviations that an error of the fitted filter can cause do not count.
    """
    inside = max(from_hz, 1e-3 * low_pass.corner_hz)
    hz = np.array([inside, max(0.2 * low_pass.corner_hz, inside)])
    low, high = model.spectrum(np.minimum(2 * np.pi * hz * h, np.pi), h).tolist()
    return bool(low < AS_FILTERS_DIFFER * high)


def _behind_with_walk(f: CandidateModels, part: Relaxation) -> float:
    """Return the loss of 2 log L when a random walk replaces the relaxation."""
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
    """Return whether the resonance is a maximum of the whole spectrum, not only of its own part."""
    hz = part.frequency_hz * np.array([1.0, 1 / ASIDE, ASIDE])
    top, *sides = model.spectrum(np.minimum(2 * np.pi * hz * h, np.pi), h).tolist()
    return bool(top > STANDS_OUT * max(sides))


def _ends(f: CandidateModels, model: FittedModel, from_hz: float) -> tuple[float, float]:
    """Return the model's density at the lowest fitted frequency, and the mean density at the highest ones.

    Only fitted frequencies count, since power between neighbouring frequencies fills the zeros of a filter.
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
    """Return whether a resonance lies in a band whose data are left out, such as that of a peak."""
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
            # A part without free parameters cannot adapt to the skirts of a peak.
            shaped = part.row().says == "colour" and part.row().coordinates
            return bool(shaped) and any(peak.kind == "resonance" for peak in strong)
    return any(
        1 / reach < hz / peak.frequency_hz < reach
        for peak in strong
        for reach in [RESONANCE_LEAKS if peak.kind == "resonance" else LINE_LEAKS]
    )
