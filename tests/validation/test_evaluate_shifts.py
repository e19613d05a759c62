"""Noises that change while they are measured, as the daemon's own fit sees them: few seeds."""

import numpy as np
import pytest

from tools.validation.evaluate.cases import POWER
from tools.validation.evaluate.shifts import (
    BEFORE,
    KNOCK_SAMPLES,
    SHIFTS,
    Shift,
    samples,
    score_shift,
)
from tools.validation.runner import Row

SEEDS = 6


@pytest.fixture(scope="module")
def found() -> dict[tuple[str, bool], Row]:
    """By the name of the shift, and whether the fit forgets."""
    rows = [row for shift in SHIFTS for row in score_shift(shift, SEEDS)]
    return {(row["change"], row["memory_s"] is not None): row for row in rows}


@pytest.mark.slow
@pytest.mark.parametrize("shift", SHIFTS, ids=lambda shift: shift.name)
def test_three_time_constants_later_the_truth_is_back(
    shift: Shift, found: dict[tuple[str, bool], Row]
) -> None:
    """At least 5 of 6 intervals of 95 %: fewer have a chance of 3 %."""
    score = found[shift.name, True]
    assert score["series"] == SEEDS
    assert score["holds"] >= SEEDS - 1
    assert score["median_error"] < 0.03
    assert "not stationary" not in score["verdicts"]


@pytest.mark.slow
@pytest.mark.parametrize("shift", SHIFTS, ids=lambda shift: shift.name)
def test_without_forgetting_the_verdict_says_it(shift: Shift, found: dict[tuple[str, bool], Row]) -> None:
    """What is no change of the noise does not spoil the fit."""
    score = found[shift.name, False]
    assert score["verdicts"].get("not stationary", 0) == (0 if shift.stationary else SEEDS)
    if shift.stationary:
        assert score["median_error"] < 0.03
        assert score["holds"] >= SEEDS - 2


def test_a_knock_is_left_out_and_counted(found: dict[tuple[str, bool], Row]) -> None:
    for forgets in (False, True):
        assert found["knocked", forgets]["left_out"] == {"knocked": SEEDS}
        assert found["none", forgets]["left_out"] == {}
        assert found["temperature drifts", forgets]["left_out"] == {}


def test_the_samples_change_as_they_are_said_to() -> None:
    def of(name: str) -> np.ndarray:
        return samples(next(one for one in SHIFTS if one.name == name), 4)

    still = of("none")
    assert still.var(axis=0).mean() == pytest.approx(POWER, rel=0.2)
    doubled = of("power doubled")
    np.testing.assert_array_equal(doubled[:BEFORE], still[:BEFORE])
    np.testing.assert_allclose(doubled[BEFORE:], np.sqrt(2) * still[BEFORE:])
    knock = of("knocked") - still
    assert np.flatnonzero(knock[:, 0])[[0, -1]].tolist() == [BEFORE, BEFORE + KNOCK_SAMPLES - 1]
    drift = (of("temperature drifts") - still)[:, 0]
    assert drift[0] == 0
    assert (np.diff(drift) > 0).all()
    assert drift[-1] > 15 * np.sqrt(POWER)
