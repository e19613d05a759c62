"""Bias instability B, for the command, Python, the live fit and clusters alike (pure).

B is the amplitude of 1/f noise, whose Allan deviation is flat at 0.664 B. Where white noise, 1/f noise and a
random walk describe the spectrum about as well as the model that stands for the noise, B is that of this fit
if the 1/f noise is needed for it, and not known if it is not: where white noise meets a random walk, the
lowest point of the Allan deviation is no flat stretch. Elsewhere B is read from the curve: a flat stretch, or
its lowest point, over 0.664, as data sheets have it.
"""

import math

from msgspec.structs import replace

from fltea.noise.parts import SLOW, White, free_of, kind_of
from fltea.spectrum.allan_coefficients import Coefficient, not_known
from fltea.spectrum.candidate_models import CandidateModels, Sentence
from fltea.spectrum.evidence import APART
from fltea.spectrum.flicker import Flicker, flicker
from fltea.spectrum.intervals import CRITICAL

SLOW_KINDS = (White, *SLOW)
"""Parts that describe the frequencies to which the three terms are fitted."""


def bias_instability(of_curve: Coefficient, f: CandidateModels, stands: Sentence, unit: str) -> Coefficient:
    """Return B in `unit`; of_curve: as the Allan deviation alone has it; stands: the model of the noise."""
    fit = flicker(f, stands)
    if fit is None or not _describes(fit, stands):
        return of_curve
    if fit.B.value is not None and _needed(fit):
        return Coefficient(fit.B.value, fit.B.low, fit.B.high, of="spectrum")
    if of_curve.value is None or of_curve.at_most is None:
        return of_curve
    why = "the curve has no flat stretch: at its lowest, white noise meets a random walk"
    if fit.gain_of_walk < CRITICAL:
        why = "this record cannot tell 1/f noise from a random walk"
    return replace(not_known(why, of_curve.at_most, unit), of="spectrum")


def _needed(fit: Flicker) -> bool:
    """Whether the 1/f noise is needed; beside a walk it pays BIC's price, for that may be a relaxation."""
    return fit.gain > (math.log(fit.ordinates) if fit.gain_of_walk > CRITICAL else CRITICAL)


def _describes(fit: Flicker, stands: Sentence) -> bool:
    """Whether the three terms are as good as the model, by BIC and but for what counts as no difference."""
    needed = 1 + (fit.gain > CRITICAL) + (fit.gain_of_walk > CRITICAL)
    others = sum(free_of(code) for code in stands.codes if kind_of(code) in SLOW_KINDS)
    return fit.behind < APART + math.log(fit.ordinates) * (others - needed)
