"""Noises that earlier rules took for something else; each is drawn by the gallery."""

import numpy as np
import pytest
from fltea.identification.sums import examined, limited
from fltea.spectrum.evidence import Evidence
from fltea.spectrum.verdict import decide
from identify_support import white

from tools.validation.gallery.records import draw


def evidence(name: str, rate_hz: float, seconds: float, series: int = 0) -> Evidence:
    return examined(draw(name, rate_hz, seconds, series), 1 / rate_hz).evidence


@pytest.mark.slow
def test_an_order_that_is_arfima() -> None:
    """It has the lowest BIC by far, and no sum comes near."""
    e = evidence("ARFIMA(1, .4, 1)", 100.0, 10_800.0)
    assert e.low_pass is None
    assert e.contest.best == "arfima"
    assert e.contest.order == pytest.approx(0.4, abs=0.02)
    assert decide(e).kind == "fractional"


@pytest.mark.parametrize(
    ("name", "rate_hz", "seconds", "series", "kinds"),
    [
        # A moving average whose corner is below the lowest frequency: the best d is at the end of its range.
        *(("mean of 4, ramp", 5.0, 30.0, i, {"low-pass", "drift"}) for i in range(6)),
        # f = -1 at 5 Hz: the spectrum falls, and rises a little at its end; no sum of relaxations does.
        *(("state 0.4, -1, 3", 5.0, 600.0, i, {"fractional"}) for i in range(3)),
        *(("bursts", 100.0, 600.0, i, {"white", "undecided"}) for i in range(3)),
    ],
)
def test_verdicts(name: str, rate_hz: float, seconds: float, series: int, kinds: set[str]) -> None:
    e = evidence(name, rate_hz, seconds, series)
    assert decide(e).kind in kinds
    assert not e.peaks


def test_an_order_at_its_limit_is_not_the_one_that_is_told() -> None:
    """ARFIMA is a little better at d = 0.15, which stands for less."""
    e = evidence("state 0.4, -1, 3", 5.0, 600.0)
    assert e.contest.order_of == "fractional"
    assert 0.2 < e.contest.order < 0.7


def test_the_ends_of_a_short_record_do_not_leak() -> None:
    """3,000 samples with a ramp of thirty deviations are white but for it."""
    y = white(3000, 1, 3)[0] + np.linspace(0, 30, 3000)
    e = examined(y, 0.01).evidence
    assert e.p_clean > 0.01
    assert decide(e).kind == "drift"


def test_outliers_are_limited() -> None:
    y = np.cumsum(white(1000, 1, 1)[0])
    np.testing.assert_array_equal(limited(y), y)
    y[300] += 1000
    found = limited(y)
    assert abs(found[300] - y[299]) < 200
    np.testing.assert_array_equal(np.delete(found, 300)[:256], np.delete(y, 300)[:256])
    np.testing.assert_array_equal(limited(y[:100]), y[:100])
