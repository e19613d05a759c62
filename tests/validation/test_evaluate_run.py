"""Plans, their order, and what is made of the result."""

from typing import Any

import msgspec
import numpy as np
import pytest
from validation_support import STRONG

from tools.validation.evaluate import alarms, figures, fit_summaries, fits, run, summaries
from tools.validation.evaluate.cases import POWER, samples
from tools.validation.evaluate.online import Reading
from tools.validation.evaluate.run import LIVE, WHITTLE, Result, changed_case, full_plan, quick_plan
from tools.validation.evaluate.score import Score, score
from tools.validation.evaluate.settings import CHANGES, MAIN, TUNED


def test_rows(tiny: Result) -> None:
    """Every estimator on every noise after every length: filters for α and f, fits for all they have."""
    filters = [one.name for one in MAIN] + list(TUNED)
    keys = {(r.case, r.samples, r.estimator, r.quantity) for r in tiny.rows}
    assert len(keys) == len(tiny.rows) == 2 * 2 * (2 * len(filters) + 2 * len(fits.QUANTITIES))
    assert len(tiny.changes) == 2 * 1 * len(CHANGES) * 2
    assert {r.score.seeds for r in tiny.rows + tiny.changes if r.estimator not in (LIVE, WHITTLE)} == {3}
    assert {r.score.seeds for r in tiny.rows if r.estimator in (LIVE, WHITTLE)} == {4}
    for row in tiny.rows:
        of_an_order = row.case.alpha is not None
        assert (row.score.cramer_rao_sd is not None) == of_an_order
        assert (row.score.bias is not None) == (of_an_order and row.score.without < 3)
        if of_an_order and row.score.mean is not None:
            truth = fits.truths(row.case)[row.quantity]
            assert row.score.mean - row.score.bias == pytest.approx(truth, abs=1e-4)
            if row.estimator in (LIVE, WHITTLE):
                assert row.score.mean < 0 if row.quantity == "f" else 0 < row.score.mean < 1.5
    strong = [
        r.score for r in tiny.rows if r.case == STRONG and (r.estimator, r.quantity) == ("joint", "alpha")
    ]
    assert all(abs(one.bias) < 0.35 for one in strong)


def test_where_Q_and_R_come_from(monkeypatch: pytest.MonkeyPatch) -> None:
    """The fitted ones are of another record than the one that is estimated."""
    given: list[tuple[Any, Any]] = []

    def read(y: Any, h: float, config: Any, lengths: Any, Q: Any, R: Any) -> list[Reading]:
        np.testing.assert_array_equal(y, samples(STRONG, 2, 1_000))
        given.append((Q, R))
        return [Reading(*np.ones((4, 2)), np.ones(2, dtype=bool))]  # type: ignore[call-arg]

    def fitted_variances(y: Any, h: float, Q: float, power: float) -> tuple[Any, Any]:
        np.testing.assert_array_equal(y, samples(STRONG, 2, 1_500, record=1))
        assert (Q, power) == (0.15, POWER)
        return np.array([3.0, 4.0]), np.array([5.0, 6.0])

    monkeypatch.setattr(run, "read", read)
    monkeypatch.setattr(fits, "fitted_variances", fitted_variances)
    changed_case(STRONG, 2, (1_000,), CHANGES, 1_500)
    s2, R = STRONG.noise.s2, STRONG.noise.R
    expected = {
        "joint, as it is": (None, None),
        "joint, R known": (None, [R, R]),
        "joint, Q known": ([s2, s2], None),
        "triple, Q and R known": ([s2, s2], [R, R]),
        "triple, Q and R fitted": ([3, 4], [5, 6]),
    }
    for setting, found in zip(CHANGES, given, strict=True):
        if setting.name in expected:
            assert tuple(None if v is None else v.tolist() for v in found) == expected[setting.name]


def test_plans() -> None:
    full, quick = full_plan(7), quick_plan(5)
    assert (len(full.grid), full.seeds, full.lengths) == (53, 7, (3_000, 20_000, 60_000))
    assert (len(quick.grid), quick.seeds) == (5, 5)
    for plan in (full, quick):
        assert all(case.noise.R > 0 for case in plan.grid + plan.changed_on)


def scored(error: float, coverage: float, without: int = 0) -> Score:
    """Twenty estimates at ± the error, of which so many are lost."""
    estimate = np.tile([0.5 - error, 0.5 + error], 10)
    covered = np.arange(20) < round(20 * coverage)
    return score(estimate, np.arange(20) >= without, truth=0.5, covered=covered)


def test_what_is_right() -> None:
    assert summaries.right(scored(0.09, 0.9))
    assert not summaries.right(scored(0.11, 1.0))
    assert not summaries.right(scored(0.09, 0.85))
    assert summaries.right(scored(0.05, 1.0, without=2))
    assert not summaries.right(scored(0.05, 1.0, without=3))
    assert not summaries.right(scored(0.05, 1.0, without=20))


def test_tables_and_conclusion(tiny: Result) -> None:
    summary, white, changes = summaries.summary(tiny), summaries.white(tiny), summaries.changes(tiny)
    assert len(summary) == len(white) == (len(MAIN) + len(TUNED) + 2) * 2
    assert len(changes) == len(CHANGES)
    for headings, rows in (
        (summaries.SUMMARY_HEADINGS, summary),
        (summaries.WHITE_HEADINGS, white),
        (summaries.CHANGE_HEADINGS, changes),
    ):
        assert {len(row) for row in rows} == {len(headings)}
        assert all(cell for row in rows for cell in row)
    joint = next(r.score for r in tiny.changes if r.case == STRONG and r.estimator == "joint, as it is")
    assert changes[0][1:3] == (f"{int(summaries.right(joint))} of 1", f"{joint.rmse:.2f}")
    claims = {(name, n): claim for name, n, _, _, claim, _ in white}
    alpha = next(r.score for r in tiny.rows if r.case.alpha is None and r.estimator == "triple")
    assert claims["triple", "1,000"] == f"{alpha.beyond_zero:.0%}"
    words = summaries.conclusion(tiny)
    assert words.startswith("After 1,500 samples")
    assert "Where x has at least 90% of the power joint is right in" in words
    assert "less than" not in words  # there is no such noise in the plan


def test_tables_of_the_fits(tiny: Result) -> None:
    headings, errors = fit_summaries.errors(tiny)
    tables = {
        fit_summaries.RATIO_HEADINGS: fit_summaries.ratios(tiny),
        fit_summaries.COVERAGE_HEADINGS: fit_summaries.coverages(tiny),
        fit_summaries.ALARM_HEADINGS: fit_summaries.alarms(tiny),
        headings: errors,
    }
    for names, rows in tables.items():
        assert rows
        assert {len(row) for row in rows} == {len(names)}
        assert all(cell for row in rows for cell in row)
    assert [row[0] for row in errors[::2]] == [one.name for one in MAIN] + [*TUNED, LIVE, WHITTLE, "bound"]
    assert fit_summaries.ratios(tiny)[0][2] == "0 of 1"  # four series are too few for a ratio
    assert [(one.noise, one.series) for one in tiny.alarms[::4]] == [(name, 100) for name in alarms.MAKERS]


@pytest.mark.slow
def test_figures(drawn: dict[str, bytes]) -> None:
    assert set(drawn) == {"error", "coverage", "settings", "live"}
    assert all(data.startswith(b"\x89PNG") for data in drawn.values())
    assert len(set(drawn.values())) == len(drawn)


def test_a_cell_is_empty_where_half_have_no_value(tiny: Result) -> None:
    row = next(r for r in tiny.rows if r.case == STRONG and r.quantity == "alpha")
    error = figures.MAPS["error"]
    s = row.score
    shown = {name: figures._shown(row, one) for name, one in figures.MAPS.items()}
    assert shown == {
        "error": s.rmse,
        "bias": s.bias,
        "coverage": s.coverage,
        "spread": s.sd_over_bound,
        "f": s.median_error / abs(STRONG.f),
    }
    half = msgspec.structs.replace(row, score=scored(0.1, 1.0, without=10))
    assert np.isnan(figures._shown(half, error))
