"""Tests the odds that a noise has a fractional order.

They stay between 1 / MOST and MOST. They are right for noises that were not used for calibration, too.
"""

import math

import fltea
import pytest
from fltea.records.odds import MOST
from fltea.records.odds import odds as said
from fltea.spectrum.order_odds import FARTHEST, order_odds
from fltea.spectrum.order_odds_constants import ORDINATES
from fltea.spectrum.wording import either
from hypothesis import given
from hypothesis import strategies as st

from tools.validation.odds.counts import count
from tools.validation.odds.run import operating, reliability

LEADS = st.floats(-1e3, 1e3) | st.just(-math.inf)
COUNTS = st.floats(64, 1e9)


@given(LEADS, LEADS, COUNTS, st.floats(0, 100))
def test_who_is_farther_ahead_has_better_odds(
    lead: float, over_rich: float, ordinates: float, more: float
) -> None:
    found = order_odds(lead, over_rich, ordinates)
    assert 1 / MOST <= found <= MOST
    assert order_odds(lead + more, over_rich, ordinates) >= found * (1 - 1e-12)
    assert order_odds(lead, over_rich + more, ordinates) >= found * (1 - 1e-12)


def test_beyond_what_was_calibrated_nothing_changes() -> None:
    low, high = ORDINATES
    assert order_odds(5.0, 1.0, low / 9) == order_odds(5.0, 1.0, low)
    assert order_odds(5.0, 1.0, high * 9) == order_odds(5.0, 1.0, high)
    assert order_odds(-1e9, -1e9, 1e4) == order_odds(-FARTHEST, -FARTHEST, 1e4)


def test_more_data_make_odds_that_tell() -> None:
    """A longer record gives odds that are farther from 1. If a record is three times as long, it has three
    times as many ordinates (powers at single frequencies). The better model's lead in 2 log L is then three
    times as large.
    """
    for sign in (-1, 1):
        near, far = (order_odds(sign * lead, 0.0, 1_500 * lead) ** sign for lead in (10.0, 30.0))
        assert far > near > 1


@pytest.mark.parametrize(
    ("odds", "words"),
    [(1.0, "1.0 : 1"), (2.44, "2.4 : 1"), (8.6, "9 : 1"), (MOST, "more than 50 : 1"), (0.25, "1 : 4")],
)
def test_odds_in_words(odds: float, words: str) -> None:
    assert said(odds) == words


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (None, "This record cannot separate an order from a sum"),
        (9.9, "This record cannot separate an order from a sum"),
        (10.1, "Most likely an order; a sum is possible, too"),
        (0.05, "Most likely a sum; an order is possible, too"),
    ],
)
def test_what_is_most_likely_is_said_first(value: float | None, words: str) -> None:
    assert either("an order", "a sum", value) == words


def test_the_odds_are_one_figure() -> None:
    found = fltea.simulate(20_000, rate_hz=100, alpha=0.6, f=-0.5, Q=10.0, R=0.01, unit="deg/s", seed=2)
    axis = found.identify()
    assert axis.odds is not None
    assert axis.odds == axis.details.verdict.odds
    assert said(max(axis.odds, 1 / axis.odds)) in axis.text


@pytest.mark.long
def test_odds_come_true() -> None:
    """The odds are right within three standard errors on 200 noises that were not used for calibration.

    Half of these noises have a fractional order.
    """
    names = {"order": 100, "random sum": 50, "regular sum": 25, "sum and rise": 25}
    rows = [row for name, series in names.items() for row in count(name, 20_000, 0, series, 7)]
    found = reliability(rows)
    assert sum(count for count, *_ in found) > 190
    assert len(found) >= 4
    for _, expected, seen, error in found:
        assert abs(seen - expected) < 3 * error + 0.02
    assert [seen for *_, seen, _ in found] == pytest.approx(sorted(seen for *_, seen, _ in found), abs=0.25)
    false, true = operating(rows, "random sum")
    assert max(t for f, t in zip(false, true, strict=True) if f <= 0.1) > 0.3
    assert not [row for row in rows if row["kind"] == "fractional" and row["population"] != "order"]
