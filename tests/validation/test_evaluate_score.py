"""Scores of a few estimates, by hand."""

import math

import numpy as np
import pytest

from tools.validation.evaluate.score import score


def test_by_hand() -> None:
    estimate = np.array([1.0, 2.0, 3.0, 6.0])
    found = score(
        estimate, np.ones(4, dtype=bool), truth=2.0, reported=np.array([0.4, 0.1, 2.0, 2.0]), bound=0.5
    )
    assert (found["seeds"], found["without"], found["mean"], found["bias"]) == (4, 0, 3.0, 1.0)
    assert (found["q05"], found["q95"]) == (1.15, 5.55)
    assert found["sd"] == pytest.approx(math.sqrt(14 / 3), rel=1e-5)
    assert found["rmse"] == pytest.approx(math.sqrt(18 / 4), rel=1e-5)
    assert found["median_error"] == 1.0
    assert found["reported_sd"] == 1.2
    assert found["coverage"] == 0.5  # 2 and 3
    assert found["beyond_zero"] == 0.75  # all but 3, which is 1.5 σ off
    assert found["cramer_rao_sd"] == 0.5
    assert found["sd_over_bound"] == pytest.approx(2 * math.sqrt(14 / 3), rel=1e-5)


def test_what_has_no_value_is_counted_and_left_out() -> None:
    estimate = np.array([0.5, 0.7, 99.0, np.nan])
    valid = np.array([True, True, False, True])
    found = score(estimate, valid, truth=0.6, reported=np.array([1.0, 1.0, 50.0, 1.0]))
    assert (found["seeds"], found["without"], found["mean"], found["coverage"]) == (4, 2, 0.6, 1.0)
    nothing = score(estimate, np.zeros(4, dtype=bool), truth=0.6, reported=np.ones(4), bound=0.1)
    assert (nothing["without"], nothing["mean"], nothing["sd"], nothing["rmse"], nothing["coverage"]) == (
        4,
        *[None] * 4,
    )


def test_given_intervals_win_and_without_a_truth_there_is_no_error() -> None:
    inside = np.array([True, False, False, False])
    found = score(np.zeros(4), np.ones(4, dtype=bool), truth=0.0, reported=np.ones(4), covered=inside)
    assert found["coverage"] == 0.25
    white = score(np.arange(4.0), np.ones(4, dtype=bool), reported=np.ones(4))
    assert (white["bias"], white["rmse"], white["median_error"], white["coverage"]) == (None,) * 4
    assert (white["mean"], white["beyond_zero"]) == (1.5, 0.5)
