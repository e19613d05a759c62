"""How much longer a sensor has to be looked at until its order is known well enough (pure).

How long it takes to tell whether there is an order at all is not forecast: of 79 such forecasts, by the odds
that longer records of the fitted models should have, 44 were right within a factor of two
(host/docs/evaluation/odds.md).
"""

from fltea.records.plus_minus import NORMAL_95
from fltea.spectrum.candidate_models import CandidateModels, Sentence
from fltea.spectrum.intervals import order_deviation


def seconds_more(
    f: CandidateModels, sentence: Sentence, target: float, longest_s: float | None = None
) -> float | None:
    """Return seconds of samples until the 95 % interval of α is ± target, if the noise stays as it is.

    sentence: of `f`, with an order. longest_s: of samples that are not forgotten; None: none are. 0 if it is
    as narrow; None if that will never be, or cannot be known.
    """
    deviation = order_deviation(f, sentence)
    if deviation is None:
        return None
    have = 2 * f.ordinates * f.h
    needed = have * (NORMAL_95 * deviation / target) ** 2
    if longest_s is not None and needed > max(longest_s, have):
        return None
    return max(needed - have, 0.0)
