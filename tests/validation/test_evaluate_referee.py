"""The referee on few and short series."""

import numpy as np
import pytest

from tools.validation.evaluate import fits
from tools.validation.evaluate.cases import Case
from tools.validation.evaluate.referee import judge, rms, share


def test_three_answers_to_the_same_series() -> None:
    """Weakly dependent, where Whittle is right: the three errors are alike."""
    case = Case(0.8, -10.0, 30.0)
    (found,) = judge(case, 4, 600)
    assert (found["noise"], found["samples"]) == (case.name, 600)
    assert 3 <= found["series"] <= 4
    for fit in ("exact", "whole", "live"):
        assert found[f"{fit}_rmse"] == pytest.approx(found["exact_rmse"], abs=0.15)
        assert 0.5 <= found[f"{fit}_coverage"] <= 1


def test_only_series_of_which_both_publish_an_order_are_compared(monkeypatch: pytest.MonkeyPatch) -> None:
    whole, live = fits.whole_reading, fits.live_readings
    first, all_of_them = np.array([True, False]), np.array([True, True])
    monkeypatch.setattr(fits, "whole_reading", lambda *given: whole(*given)._replace(published=first))
    monkeypatch.setattr(
        fits, "live_readings", lambda *given: [one._replace(published=all_of_them) for one in live(*given)]
    )
    assert judge(Case(0.8, -10.0, 30.0), 2, 300)[0]["series"] == 1


def test_of_nothing_there_is_no_error() -> None:
    assert rms(np.empty(0)) is None
    assert share(np.empty(0, dtype=bool)) is None
    assert rms(np.array([3.0, -4.0, 0.0, 0.0])) == 2.5
    assert share(np.array([True, False])) == 0.5
