"""How much longer a sensor has to be observed until its order is known well enough.

The time until it is clear whether there is an order at all is not forecast. Of 79 such forecasts, which used
the expected odds of longer records of the fitted models, 44 were right within a factor of two
(host/docs/evaluation/odds.md).
"""

from fltea.records.plus_minus import NORMAL_95
from fltea.spectrum.candidate_models import CandidateModels, FittedModel
from fltea.spectrum.intervals import order_deviation


def seconds_more(
    f: CandidateModels, model: FittedModel, target: float, longest_s: float | None = None
) -> float | None:
    """Return how many more seconds of samples bring the 95 % interval of α to ± `target`.

    The noise is assumed to stay as it is. `model`: a model of `f` with an order. `longest_s`: length [s] of
    the fit's memory, if old samples fade; None: no sample fades. The result is 0 if the interval is narrow
    enough now, and None if it never will be or the time cannot be known.
    """
    deviation = order_deviation(f, model)
    if deviation is None:
        return None
    have = 2 * f.ordinates * f.h
    needed = have * (NORMAL_95 * deviation / target) ** 2
    if longest_s is not None and needed > max(longest_s, have):
        return None
    return max(needed - have, 0.0)
