"""Odds that a noise has an order: a Bayes factor of the two best models, as it was calibrated (pure).

BIC's difference is about -2 log of the Bayes factor of two models (Schwarz, *Ann. Stat.* 6, 1978), but only
about: the search has chosen both models, and sums of relaxations have priors of their own. So the odds are a
logistic regression on how far the best model with an order is ahead of the best without one and of the
richest without one. It is fitted to noises drawn at random, of which one half has an order and the other is
made of relaxations (tools/validation/odds/populations.py, host/docs/evaluation/odds.md).
"""

import math

from fltea.records.odds import MOST
from fltea.spectrum.candidate_models import CandidateModels
from fltea.spectrum.order_odds_constants import COEFFICIENTS, ORDINATES

FARTHEST = 40.0
"""Differences in 2 log L beyond are as good as this."""


def order_odds(lead: float, lead_over_rich: float, ordinates: float) -> float:
    """Return the odds of an order over none, from 1 / MOST to MOST.

    lead: of the best model with an order over the best without one, after BIC's price. lead_over_rich: of its
    2 log L over that of the richest without one. ordinates: that both are fitted to.
    """
    lowest, highest = ORDINATES
    decades = math.log10(min(max(ordinates, lowest), highest) / lowest)
    figures = (1.0, *(min(max(one, -FARTHEST), FARTHEST) / FARTHEST for one in (lead, lead_over_rich)))
    log_odds = sum(
        (at_lowest + a_decade * decades) * figure
        for (at_lowest, a_decade), figure in zip(COEFFICIENTS, figures, strict=True)
    )
    return min(max(math.exp(log_odds), 1 / MOST), MOST)


def odds_of(f: CandidateModels) -> float | None:
    """Return the odds of an order by the models of a spectrum; None: none that was fitted has one."""
    if f.ordered is None:
        return None
    return order_odds(f.lead, f.lead_over_rich, f.ordinates)
