"""How much longer: against the bound, and against intervals of longer records."""

import math
from copy import copy

import numpy as np
import pytest
from fltea.identification.sums import examined
from fltea.spectrum.frontier import Frontier, Sentence
from fltea.spectrum.how_long import TELLS, seconds_more, times_to_tell
from fltea.spectrum.intervals import order_deviation, order_fit
from fltea.spectrum.order_odds import MOST, odds_of
from fltea.spectrum.periodogram import binned, periodogram
from identify_support import H, long_recursion, white

from tools.validation.evaluate.cramer_rao import bound
from tools.validation.gallery.parts import Fractional, Part, Relaxation, White
from tools.validation.odds.populations import drawn

ALPHA, G, R = 0.8, -0.025, 1 / 3


def series(n: int, seed: int) -> Frontier:
    y = long_recursion(ALPHA, G, n, seed) + math.sqrt(R) * white(n, 1, seed + 50)[0]
    return Frontier(binned(periodogram(y, H)), H, n)


def best(f: Frontier) -> Sentence:
    assert f.order is not None
    return f.order


def test_the_deviation_is_the_bound() -> None:
    n = 60_000
    found = order_deviation(f := series(n, 1), best(f))
    assert found == pytest.approx(bound(ALPHA, G, 1.0, R, n, H).alpha, rel=0.1)


def test_it_is_kept() -> None:
    """After so much longer the interval of the profile is about as narrow as was asked."""
    f = series(4000, 2)
    seconds = seconds_more(f, best(f), 0.05)
    assert seconds > 0
    longer = series(4000 + round(seconds / H), 3)
    alpha = order_fit(longer, best(longer)).alpha
    assert (alpha.high - alpha.low) / 2 == pytest.approx(0.05, rel=0.3)


def test_reached_and_never() -> None:
    f = series(60_000, 4)
    assert seconds_more(f, best(f), 0.2) == 0
    assert seconds_more(f, best(f), 0.001, longest_s=1200.0) is None
    assert seconds_more(f, f.white, 0.05) is None


@pytest.mark.parametrize("has_order", [True, False])
def test_a_record_of_the_forecast_length_tells(has_order: bool) -> None:
    """An order and two relaxations that look like it for 200 s; told by four in five of records that long."""
    parts: tuple[Part, ...] = (White(), Fractional(0.6, -0.5, 0.3))
    if not has_order:
        parts = (White(), Relaxation(0.3, 30.0), Relaxation(6.0, 2.0))
    e = examined(drawn(parts, 20_000, np.random.default_rng(8)), H).evidence
    times = times_to_tell(e.frontier, e.duration_s)
    assert times is not None
    seconds = times.if_order_s if has_order else times.if_none_s
    assert seconds is not None
    assert 200 < seconds < 8_000
    told = []
    for seed in range(5):
        later = examined(drawn(parts, round(2 * seconds / H), np.random.default_rng(seed)), H).evidence
        odds = odds_of(later.frontier) or 1 / MOST
        told.append((odds if has_order else 1 / odds) >= TELLS)
    assert sum(told) >= 4


def test_times_are_in_proportion_to_the_record() -> None:
    f = series(20_000, 5)
    times = times_to_tell(f, 200.0)
    assert times is not None
    twice = times_to_tell(f, 400.0)
    assert twice is not None
    assert (twice.if_order_s, twice.if_none_s) == tuple(
        None if one is None else pytest.approx(2 * one) for one in (times.if_order_s, times.if_none_s)
    )
    known = [one for one in (times.if_order_s, times.if_none_s) if one is not None]
    assert times.longest_s == max(known, default=None)


def test_without_an_order_there_is_nothing_to_tell() -> None:
    f = copy(series(4000, 2))
    f.ordered = None
    assert times_to_tell(f, 40.0) is None
    assert odds_of(f) is None
