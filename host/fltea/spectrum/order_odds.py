"""Odds that a noise has an order, computed from how well models with and without an order fit.

The difference of two models' BIC is about -2 times the logarithm of their Bayes factor (Schwarz, *Ann. Stat.*
6, 1978). Here this is only approximate: each model is the best of many that a search tried, and BIC does not
know how probable a sum of relaxations is. So the odds come from a logistic regression with two inputs. Each
input compares the best model with an order with a model without one. The first input is the difference in BIC
to the best model without an order. The second is the difference in 2 log L to a model without an order that
may have more parts. The regression was fitted to noises that were drawn at random. Half of them have an
order, and the other half consist of relaxations (tools/validation/odds/populations.py,
host/docs/evaluation/odds.md).
"""

import math

from fltea.records.odds import MOST
from fltea.spectrum.candidate_models import CandidateModels
from fltea.spectrum.order_odds_constants import COEFFICIENTS, ORDINATES

FARTHEST = 40.0
"""A lead in 2 log L that exceeds this value is replaced by this value."""


def order_odds(lead: float, lead_over_rich: float, ordinates: float) -> float:
    """Return the odds that there is an order. The odds are at least 1 / MOST and at most MOST.

    `lead`: by how much the best model with an order exceeds the best model without one in 2 log L, after
    BIC's price for further parameters is subtracted. `lead_over_rich`: by how much the best model with an
    order exceeds a model without one in 2 log L, which may have more parts. `ordinates`: number of ordinates
    to which the models are fitted.
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
    """Return the odds of an order, computed from the candidate models.

    Return None if no model with an order was fitted.
    """
    if f.ordered is None:
        return None
    return order_odds(f.lead, f.lead_over_rich, f.ordinates)
