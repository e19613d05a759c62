"""Whether what is left is but the trace of what was found: of a filter, or of a peak (pure)."""

import math

from fltea.spectrum.evidence import Evidence
from fltea.spectrum.lines import Peak
from fltea.spectrum.low_pass import LowPass

LEAKS, AS_SKIRTS = 2.0, 6.0
"""Ratios of frequencies over which a line leaks, and over which a resonance's skirts reach."""
NEAR_THE_END = 0.9
"""The share of half the sample rate above which what leaks from a line rises."""
LARGE_SHARE = 0.05
"""The share of the power in a peak that leaves a trace to be seen."""
NEAR_THE_FILTER = 0.1
AS_FILTERS_DIFFER = 0.6
"""The difference of two filters over the density in the pass band."""


def is_of_filter(e: Evidence, low_pass: LowPass) -> tuple[str, bool, str]:
    """Return whether the true filter's difference from the fitted one explains colour, with the figure."""
    best = e.contest.models[e.contest.best]
    falls = "bend_hz" in best.parameters or "bend_1_hz" in best.parameters
    if not falls or best.parameters.get("rise", 0.0) > 1:
        question = "Does what is left rise, by no more than filters differ by?"
        return question, best.span - 1 < AS_FILTERS_DIFFER, f"by a factor of {best.span:.3g}"
    name = e.contest.best_sum
    p = e.contest.models[name].parameters
    bends = [value for key, value in p.items() if key.startswith("bend")]
    fall = _density(p, e.from_hz / e.rate_hz) / max(_density(p, e.to_hz / e.rate_hz), 1e-300) - 1
    near = bool(bends) and min(bends) > NEAR_THE_FILTER * low_pass.corner_hz
    return (
        "Is the colour that is left near the corner, and no more than filters differ by?",
        near and fall < AS_FILTERS_DIFFER,
        f"{name}, {fall:.2g} of the density at its upper end",
    )


def is_skirt(peak: Peak, parameters: dict[str, float], rising: bool, rate_hz: float) -> bool:
    """Return whether a model describes what is left of a strong resonance, or what leaks from a line."""
    if peak.power_share < LARGE_SHARE:
        return False
    if peak.kind == "line":
        at = parameters.get("resonance_hz", 0.0)
        at_the_end = rising and peak.frequency_hz > NEAR_THE_END * rate_hz / 2
        return at_the_end or 1 / LEAKS < at / peak.frequency_hz < LEAKS
    corners = [value for name, value in parameters.items() if name.endswith("_hz")]
    return rising or any(1 / AS_SKIRTS < corner / peak.frequency_hz < AS_SKIRTS for corner in corners)


def _density(parameters: dict[str, float], share: float) -> float:
    """Return the density of a sum of AR(1) in white noise, at a share of the rate."""
    poles = [value for key, value in parameters.items() if key.startswith("phi")]
    s2 = [value for key, value in parameters.items() if key.startswith("s2")]
    half = 4 * math.sin(math.pi * share) ** 2
    parts = (one / ((1 - pole) ** 2 + pole * half) for one, pole in zip(s2, poles, strict=True))
    return sum(parts) + parameters["R"]
