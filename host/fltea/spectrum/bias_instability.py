"""Bias instability B.

The command, the Python interface, the live fit and the fit on clusters all call this module for B.

B is the amplitude of 1/f noise, whose Allan deviation is flat at 0.664 B. First, white noise, 1/f noise and a
random walk are fitted to the spectrum. If these three terms describe the spectrum about as well as the model
that was chosen for the noise, B comes from this fit. If the fit does not need the 1/f noise, B is not known.
The lowest point of the Allan deviation does not show B then: there is such a point without any 1/f noise,
too, where the falling curve of white noise meets the rising curve of a random walk. If the three terms do not
describe the spectrum, B is read from the curve as data sheets do: the height of a flat stretch, or of the
lowest point, divided by 0.664.
"""

import math

from msgspec.structs import replace

from fltea.noise.parts import SLOW, White, free_of, kind_of
from fltea.spectrum.allan_coefficients import Coefficient, not_known
from fltea.spectrum.candidate_models import CandidateModels, FittedModel
from fltea.spectrum.evidence import APART
from fltea.spectrum.flicker import Flicker, flicker
from fltea.spectrum.intervals import CRITICAL

SLOW_KINDS = (White, *SLOW)
"""Kinds of parts of a noise model that have power at the low frequencies to which the three terms (white
noise, 1/f noise, a random walk) are fitted.
"""


def bias_instability(
    of_curve: Coefficient, f: CandidateModels, stands: FittedModel, unit: str
) -> Coefficient:
    """Return B in `unit`.

    `of_curve`: B that was read from the curve of the Allan deviation alone. `f`: the candidate models.
    `stands`: the model on which the verdict is based.
    """
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
    """Return whether the fit needs the 1/f noise.

    If the fit also needs a random walk, the apparent 1/f noise may be a relaxation. So in this case the 1/f
    noise has to raise 2 log L by more than BIC's price for a parameter.
    """
    return fit.gain > (math.log(fit.ordinates) if fit.gain_of_walk > CRITICAL else CRITICAL)


def _describes(fit: Flicker, stands: FittedModel) -> bool:
    """Return whether white noise, 1/f noise and a random walk describe the noise as well as `stands` does.

    That is so if their BIC is lower than that of the model `stands`, or about the same.
    """
    needed = 1 + (fit.gain > CRITICAL) + (fit.gain_of_walk > CRITICAL)
    others = sum(free_of(code) for code in stands.codes if kind_of(code) in SLOW_KINDS)
    return fit.behind < APART + math.log(fit.ordinates) * (others - needed)
