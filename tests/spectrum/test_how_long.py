"""Tests the prediction how much longer one has to record until an interval is as narrow as wanted. The
predicted time is compared with the theoretical bound and with intervals of longer records.
"""

import math

import pytest
from fltea.spectrum.candidate_models import CandidateModels, FittedModel
from fltea.spectrum.how_long import seconds_more
from fltea.spectrum.information import order_deviation
from fltea.spectrum.order_fit import order_fit
from fltea.spectrum.periodogram import binned, periodogram

from tests.rig.identify_support import H, long_recursion, white
from tools.validation.evaluate.cramer_rao import bound

ALPHA, G, R = 0.8, -0.025, 1 / 3


def series(n: int, seed: int) -> CandidateModels:
    y = long_recursion(ALPHA, G, n, seed) + math.sqrt(R) * white(n, 1, seed + 50)[0]
    return CandidateModels(binned(periodogram(y, H)), H, n)


def best(f: CandidateModels) -> FittedModel:
    assert f.order is not None
    return f.order


def test_the_deviation_is_the_bound() -> None:
    n = 60_000
    found = order_deviation(f := series(n, 1), best(f))
    assert found == pytest.approx(bound(ALPHA, G, 1.0, R, n, H).alpha, rel=0.1)


def test_it_is_kept() -> None:
    """After the predicted recording time, the interval is about as narrow as wanted."""
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
