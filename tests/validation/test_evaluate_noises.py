"""Tests the simulated noises of `make validate ARGS=evaluate`. Most of them are stationary, with the stated
power and proportions of their components. The others change in the middle of a run.
"""

import numpy as np
import pytest
from fltea.noise import spectra as spectrum
from fltea.spectrum.periodogram import periodogram

from tools.validation.evaluate import cases, shifts
from tools.validation.evaluate.cases import POWER, Case, H, grid, samples
from tools.validation.evaluate.shifts import BEFORE, KNOCK_SAMPLES, SHIFTS, Shift, score_shift
from tools.validation.runner import Row

GRID = grid(cases.ORDERS, cases.PARAMETERS, cases.STEP_RATIOS)


def test_the_grid() -> None:
    """The grid of noises has white noise once, and each combination of α and f that is stationary. f = -3 at
    α = 0.2 is not.
    """
    assert GRID[0] == Case()
    assert len(GRID) == len(set(GRID)) == 53
    for case in GRID[1:]:
        assert spectrum.stationary(case.alpha, spectrum.g_of(case.alpha, case.f, H))
    assert not [case for case in GRID if (case.alpha, case.f) == (0.2, -3.0)]


@pytest.mark.parametrize("case", GRID[1:], ids=lambda case: case.name)
def test_power_and_ratio(case: Case) -> None:
    noise = case.noise
    assert noise.s2 / noise.R == pytest.approx(case.step_ratio)
    lam = np.pi * (np.arange(200_000) + 0.5) / 200_000
    x = noise.s2 * spectrum.fractional(lam, case.alpha, spectrum.g_of(case.alpha, case.f, H)).mean()
    assert x + noise.R == pytest.approx(POWER, rel=0.02)
    assert noise.x_share == pytest.approx(x / POWER, rel=0.02)


def test_white_noise_and_what_is_not_stationary() -> None:
    assert (Case().noise.R, Case().noise.x_share) == (POWER, 0.0)
    with pytest.raises(ValueError, match="not stationary"):
        _ = Case(0.2, -3.0, 1.0).noise


@pytest.mark.parametrize("case", [Case(), Case(0.6, -3.0, 3.0), Case(0.8, -1.0, 30.0)])
def test_samples_have_the_spectrum_from_the_first_on(case: Case) -> None:
    y = samples(case, 60, 1000)
    assert y.shape == (1000, 60)
    power = periodogram(y.T, H)
    if case.alpha is not None:
        noise = case.noise
        expected = noise.s2 * spectrum.fractional(power.lam, case.alpha, noise.g) + noise.R
    else:
        expected = np.full(len(power.lam), POWER)
    # Each mean is over 4,800 ratios of a power to the expected power: 80 frequencies of 60 series. The ratios
    # are exponentially distributed.
    for low in range(0, 480, 80):
        assert (power.power / expected)[:, low : low + 80].mean() == pytest.approx(1, abs=0.08)
    first, last = (y[part].var() for part in (slice(0, 300), slice(-300, None)))
    assert first == pytest.approx(last, rel=0.25)


def test_seeds_records_and_noises_are_independent_and_keep_their_samples() -> None:
    case, other = Case(0.6, -3.0, 3.0), Case(0.6, -1.0, 3.0)
    three, five = samples(case, 3, 500), samples(case, 5, 500)
    np.testing.assert_array_equal(three, five[:, :3])
    for different in (five[:, 1], samples(other, 1, 500)[:, 0], samples(case, 1, 500, record=1)[:, 0]):
        assert abs(np.corrcoef(three[:, 0], different)[0, 1]) < 0.4
    assert len({cases._key(case) for case in GRID}) == len(GRID)


SEEDS = 6


@pytest.fixture(scope="module")
def found() -> dict[tuple[str, bool], Row]:
    """Return the results by two keys: the name of the shift (a change of the noise), and whether the fit
    forgets old samples.
    """
    rows = [row for shift in SHIFTS for row in score_shift(shift, SEEDS)]
    return {(row["change"], row["memory_s"] is not None): row for row in rows}


@pytest.mark.slow
@pytest.mark.parametrize("shift", SHIFTS, ids=lambda shift: shift.name)
def test_three_time_constants_later_the_truth_is_back(
    shift: Shift, found: dict[tuple[str, bool], Row]
) -> None:
    """With a memory that forgets, the fit follows a shift of the noise. At least 5 of 6 intervals contain the
    true value. If each contains it with 95 %, the probability of fewer than 5 is 3 %.
    """
    score = found[shift.name, True]
    assert score["series"] == SEEDS
    assert score["holds"] >= SEEDS - 1
    assert score["median_error"] < 0.03
    assert "not stationary" not in score["verdicts"]


@pytest.mark.slow
@pytest.mark.parametrize("shift", SHIFTS, ids=lambda shift: shift.name)
def test_without_forgetting_the_verdict_says_it(shift: Shift, found: dict[tuple[str, bool], Row]) -> None:
    """The fit does not forget old samples here. If the noise has changed, the verdict is "not stationary". If
    the noise is as before and only a disturbance was added, the fit stays right.
    """
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
        return shifts.samples(next(one for one in SHIFTS if one.name == name), 4)

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
