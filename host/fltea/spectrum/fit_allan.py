"""The Allan deviation of an axis as the record `fit` has it: of its samples, and of the fitted sentence."""

from collections.abc import Sequence

from fltea.noise.allan_deviation import model_adev
from fltea.records.arrays import Array
from fltea.records.fit import FitAllan
from fltea.spectrum.allan_curve import live_allan
from fltea.spectrum.frontier import Sentence


def fit_allan(
    sums: tuple[Sequence[float] | Array, ...],
    samples: float,
    h: float,
    unit: str,
    noise: Sentence,
    N: float | None,
) -> FitAllan | None:
    """Return both curves, or None while there are too few samples or the axis is constant.

    sums: averaging times in samples, Allan variances, terms, as of `live_allan`; of so many samples, with a
    sampling period of h s. noise: what the axis is made of. N: of that, since the curve is bent by all
    else there is.
    """
    factors, avar, terms = sums
    try:
        curve = live_allan(factors, avar, terms, samples, h, unit)
    except ValueError:
        return None
    return FitAllan(
        curve.tau_s.tolist(),
        curve.adev.tolist(),
        curve.low.tolist(),
        curve.high.tolist(),
        model_adev(lambda lam: noise.spectrum(lam, h), curve.factors).tolist(),
        N,
        curve.B.value,
        curve.K.value,
    )
