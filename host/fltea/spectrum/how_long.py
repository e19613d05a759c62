"""How much longer to record until an order is known well enough, or known to be there (pure)."""

import math

import msgspec
import numpy as np

from fltea.noise.distributions import NORMAL_95
from fltea.spectrum.frontier import Frontier, Sentence
from fltea.spectrum.intervals import order_deviation
from fltea.spectrum.order_odds import order_odds
from fltea.spectrum.periodogram import Binned, expected_bins

TELLS = 20.0
"""Odds from which on, either way, a record tells whether there is an order."""
LONGEST = 64
"""Records up to so many times as long as the present one are thought of: what is slower is not known."""


class TimesToTell(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How long a record has to be so that the odds of an order are TELLS, one way or the other."""

    if_order_s: float | None
    """If the best model with an order is right; null: longer than LONGEST times the record."""
    if_none_s: float | None
    """If the best one without an order is right; null as above."""

    @property
    def longest_s(self) -> float | None:
        """The longer of both; None if neither is known."""
        return max((one for one in (self.if_order_s, self.if_none_s) if one is not None), default=None)


def seconds_more(
    f: Frontier, sentence: Sentence, target: float, longest_s: float | None = None
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


def times_to_tell(f: Frontier, duration_s: float) -> TimesToTell | None:
    """Return the length of a record that tells whether there is an order; f: of a record of duration_s.

    Longer records are thought of, each twice as long as the one before, of which the spectrum is exactly that
    of a model; they are searched as a record is. Waves that are too slow for the present record are as that
    model has them. None if no model has an order.
    """
    if f.ordered is None:
        return None
    return TimesToTell(
        _seconds(f, f.ordered, duration_s, has_order=True), _seconds(f, f.plain, duration_s, has_order=False)
    )


def _seconds(f: Frontier, true: Sentence, duration_s: float, *, has_order: bool) -> float | None:
    """Return the length of a record at which the odds are TELLS for what is true."""
    needed, sign = math.log(TELLS), 1 if has_order else -1
    before = sign * math.log(order_odds(f.lead, f.lead_over_rich, f.ordinates))
    length = 1
    while length < LONGEST:
        now = sign * math.log(_expected_odds(f, true, 2 * length))
        if now >= needed:
            share = (needed - before) / (now - before) if before < needed else 0.0
            return duration_s * length * 2**share
        before, length = now, 2 * length
    return None


def _expected_odds(f: Frontier, true: Sentence, length: int) -> float:
    """Return the odds of an order by a record so many times as long, if `true` is its spectrum.

    Each parameter gains 1 in 2 log L by chance (Wilks, *Ann. Math. Stat.* 9, 1938).
    """
    samples = f.samples * length
    lam, counts = expected_bins(samples)
    seen = lam >= f.data.lam[0] / length
    lam, counts = lam[seen], counts[seen] * f.ordinates * length / counts[seen].sum()
    power = true.spectrum(lam, f.h)[np.newaxis]
    longer = Frontier(Binned(lam, counts, power), f.h, samples)
    if longer.ordered is None:
        return order_odds(-math.inf, -math.inf, longer.ordinates)
    chance = longer.ordered.parameters - longer.plain.parameters
    more = longer.ordered.parameters - longer.rich.parameters
    return order_odds(longer.lead + chance, longer.lead_over_rich + more, longer.ordinates)
