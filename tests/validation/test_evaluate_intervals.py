"""Tests how the evaluation counts intervals that contain the true value, over many simulated series. Also
tests its reference method, the fit by the exact likelihood, on short series.
"""

import numpy as np
import pytest
from fltea.noise import spectra
from fltea.noise.parts import spectrum

from tools.validation.evaluate import fits
from tools.validation.evaluate.cases import Case, H
from tools.validation.evaluate.composites import (
    COMPOSITES,
    RATE_HZ,
    count_claims,
    count_composite,
    mixture,
    truth_of,
)
from tools.validation.evaluate.coverage import POINTS, Point, count_coverage
from tools.validation.evaluate.fits import QUANTITIES
from tools.validation.evaluate.referee import judge, rms, share


def test_points() -> None:
    """Intervals are counted on eight stationary noises, with and without white noise."""
    assert len(set(POINTS)) == 8
    assert all(spectra.stationary(one.alpha, H**one.alpha * one.f) for one in POINTS)
    assert [one.name for one in POINTS if one.white == 0] == ["α = 0.4, f = -1, R = 0"]
    assert POINTS[3].name == "α = 0.5, f = -2, s2/R = 1"


@pytest.mark.parametrize(("point", "least"), [(POINTS[1], 52), (POINTS[2], 48), (POINTS[3], 52)])
def test_intervals_hold_the_truth(point: Point, least: int) -> None:
    """Of 60 intervals, 57 are expected to contain the true value. The probability that 51 or fewer do is 1 %.

    For a noise without white noise, some 92 % of the intervals contain the true value.
    """
    found = count_coverage(point, 3_000, 60, 1)
    assert [row["quantity"] for row in found] == list(QUANTITIES)
    assert min(row["held"] for row in found) >= least, found


@pytest.mark.parametrize("name", list(COMPOSITES))
def test_the_truth_has_the_spectrum_that_is_drawn(name: str) -> None:
    lam = np.geomspace(1e-3, 3, 40)
    expected = np.sum([part.spectrum(lam, RATE_HZ) for part in COMPOSITES[name]], axis=0)
    np.testing.assert_allclose(spectrum(truth_of(COMPOSITES[name]), lam, H), expected, rtol=1e-6)


def test_intervals_of_two_relaxations_hold_the_truth() -> None:
    """Of 20 intervals, 19 are expected to contain the true value. The probability that 15 or fewer do is 0.3
    %.
    """
    rows = count_composite("two relaxations", 20)
    assert [row["quantity"].split(" of ")[0] for row in rows] == ["sigma", "tau_s", "sigma", "tau_s", "R"]
    assert rows[0]["same"] >= 16
    assert min(row["held"] - row["same"] for row in rows) >= -4


def test_mixtures_are_not_called_fractional() -> None:
    (row,) = count_claims(3_000, 30)
    assert sum(row["verdicts"].values()) == 30
    assert row["verdicts"].get("fractional", 0) <= 1
    rng = np.random.default_rng(1)
    assert len({len(mixture(rng)) for _ in range(50)}) > 2


@pytest.mark.slow
def test_three_answers_to_the_same_series() -> None:
    """Each series is fitted by the exact likelihood, by Whittle's likelihood of the whole record, and live.

    The errors are similar, since Whittle's likelihood is right for noise whose samples depend only weakly on
    each other.
    """
    case = Case(0.8, -10.0, 30.0)
    (found,) = judge(case, 4, 600)
    assert (found["noise"], found["samples"]) == (case.name, 600)
    assert 3 <= found["series"] <= 4
    for fit in ("exact", "whole", "live"):
        assert found[f"{fit}_rmse"] == pytest.approx(found["exact_rmse"], abs=0.15)
        assert 0.5 <= found[f"{fit}_coverage"] <= 1


@pytest.mark.slow
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
