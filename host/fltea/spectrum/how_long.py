"""Forecast how much longer a sensor has to be observed until the order of its noise is known well enough.

The time until it is clear whether there is an order at all is not forecast. Such forecasts were tried: they
used the odds that longer records of the fitted models would give on average. Only 44 of 79 forecasts were
right within a factor of two (host/docs/evaluation/odds.md).
"""

from fltea.records.plus_minus import NORMAL_95
from fltea.spectrum.candidate_models import CandidateModels, FittedModel
from fltea.spectrum.information import order_deviation


def seconds_more(
    f: CandidateModels, model: FittedModel, target: float, longest_s: float | None = None
) -> float | None:
    """Return after how many more seconds of samples the 95 % interval of α is ± `target`.

    The noise is assumed to stay as it is. `f`: the candidate models. `model`: one of them, which has an
    order. `longest_s`: length [s] of the fit's memory if old samples fade; None if no sample fades. The
    result is 0 if the interval is already narrow enough. It is None if the interval will never be narrow
    enough, or if the time cannot be predicted.
    """
    deviation = order_deviation(f, model)
    if deviation is None:
        return None
    have = 2 * f.ordinates * f.h
    needed = have * (NORMAL_95 * deviation / target) ** 2
    if longest_s is not None and needed > max(longest_s, have):
        return None
    return max(needed - have, 0.0)
