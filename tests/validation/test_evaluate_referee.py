"""The referee on few and short series."""

import msgspec
import numpy as np
import pytest

from tools.validation.evaluate import fits
from tools.validation.evaluate.cases import Case
from tools.validation.evaluate.referee import Referee, judge, rms, share


def test_three_answers_to_the_same_series() -> None:
    """Weakly dependent, where Whittle is right: the three errors are alike."""
    case = Case(0.8, -10.0, 30.0)
    found = msgspec.convert(judge(case, 4, 600)[0]["found"], Referee)
    assert (found.case, found.samples) == (case, 600)
    assert 3 <= found.series <= 4
    for other in (found.whole_rmse, found.live_rmse):
        assert other == pytest.approx(found.exact_rmse, abs=0.15)
    for coverage in (found.exact_coverage, found.whole_coverage, found.live_coverage):
        assert 0.5 <= coverage <= 1


def test_only_series_that_both_fits_call_coloured_are_compared(monkeypatch: pytest.MonkeyPatch) -> None:
    whole, live = fits.whole_reading, fits.live_readings
    first, all_of_them = np.array([True, False]), np.array([True, True])
    monkeypatch.setattr(fits, "whole_reading", lambda *given: whole(*given)._replace(rejected=first))
    monkeypatch.setattr(
        fits, "live_readings", lambda *given: [one._replace(rejected=all_of_them) for one in live(*given)]
    )
    assert judge(Case(0.8, -10.0, 30.0), 2, 300)[0]["found"]["series"] == 1


def test_of_nothing_there_is_no_error() -> None:
    assert rms(np.empty(0)) is None
    assert share(np.empty(0, dtype=bool)) is None
    assert rms(np.array([3.0, -4.0, 0.0, 0.0])) == 2.5
    assert share(np.array([True, False])) == 0.5
