"""Tests the plan of the evaluation (what is evaluated), the order of its tasks, and its tables."""

from typing import Any

import numpy as np
import pytest
from fltea.identification.workers import Here

from tools.validation.evaluate import figures, fits, run, summaries
from tools.validation.evaluate.cases import POWER, Case, samples
from tools.validation.evaluate.online import Reading
from tools.validation.evaluate.run import Plan, changed_case, plan_of, plan_tasks
from tools.validation.evaluate.score import score
from tools.validation.evaluate.settings import CHANGES, LIVE, MAIN, TUNED, WHITTLE
from tools.validation.evaluate.summaries import frame
from tools.validation.runner import Row
from tools.validation.runner import run as run_tasks
from tools.validation.tables import Table

STRONG = Case(0.8, -1.0, 30.0)
TINY = Plan(
    seeds=3,
    fit_seeds=4,
    coverage_series=100,
    grid=(Case(), STRONG),
    lengths=(1_000, 1_500),
    changed_on=(Case(), STRONG),
    changed_lengths=(2_100,),
    fitted_samples=1_000,
    refereed=(),
    shifts=(),
    coverage=(),
    mixed=("relaxation",),
    claimed=(1_000,),
)
FILTERS = [*(one.name for one in MAIN), *TUNED]


@pytest.fixture(scope="module")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> list[Row]:
    """Return the rows of a tiny evaluation, with one made-up row for each part that the tiny evaluation
    leaves out.
    """
    rows = run_tasks(plan_tasks(TINY), Here(), tmp_path_factory.mktemp("tiny") / "evaluate.ndjson")
    of_others: dict[str, Row] = {
        "coverage": {"samples": 3_000, "series": 600, "held": 560, "undefined": 30},
        "referee": {
            f"{fit}_{what}": 0.5 for fit in ("exact", "whole", "live") for what in ("rmse", "coverage")
        },
        "shifts": {"change": "none", "memory_s": None, "holds": 5, "median_error": 0.01},
    }
    both = {"series": 6, "noise": "any", "verdicts": {"white": 4, "drift": 2}, "left_out": {}}
    others = [both | {"kind": kind} | row for kind, row in of_others.items() if kind != "coverage"]
    one = {"kind": "coverage", "noise": "any"} | of_others["coverage"]
    parts = (one, one | {"series": 400, "held": 390, "undefined": 10})
    return rows + others + [part | {"quantity": name} for part in parts for name in fits.QUANTITIES]


def cell(tables: dict[str, Table], title: str, *names: str) -> list[str]:
    """Return the cells of the row whose first cells are `names`, without these first cells."""
    (found,) = (row for row in tables[title].rows if tuple(row[: len(names)]) == names)
    return list(found[len(names) :])


def test_rows(tiny: list[Row]) -> None:
    """There is a row for every estimator, noise and length of the record.

    The rows of filters are about α and f, those of fits about all their parameters.
    """
    scores = [row for row in tiny if row["kind"] == "rows"]
    keys = {tuple(row[name] for name in ("noise", "samples", "estimator", "quantity")) for row in scores}
    assert len(keys) == len(scores) == 2 * 2 * (2 * len(FILTERS) + 2 * len(fits.QUANTITIES))
    changed = [row for row in tiny if row["kind"] == "changes"]
    assert len(changed) == 2 * 1 * len(CHANGES) * 2
    for row in scores + changed:
        of_a_fit = row["estimator"] in (LIVE, WHITTLE)
        assert row["seeds"] == (4 if of_a_fit else 3)
        of_an_order = row["alpha"] is not None
        assert (row["cramer_rao_sd"] is not None) == of_an_order
        assert (row["bias"] is not None) == (of_an_order and row["without"] < row["seeds"])
        if of_an_order and row["mean"] is not None:
            truth = fits.truths(STRONG)[row["quantity"]]
            assert row["mean"] - row["bias"] == pytest.approx(truth, abs=1e-4)
            if of_a_fit:
                assert row["mean"] < 0 if row["quantity"] == "f" else 0 < row["mean"] < 1.5
            elif (row["estimator"], row["quantity"]) == ("joint", "alpha"):
                assert abs(row["bias"]) < 0.35


@pytest.mark.slow
def test_where_Q_and_R_come_from(monkeypatch: pytest.MonkeyPatch) -> None:
    """Filters may get fitted values of Q and R. These come from another record than the one on which the
    filter is run.
    """
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
    full, quick = plan_of(7), plan_of(5, quick=True)
    assert (len(full.grid), full.seeds, full.lengths) == (53, 7, (3_000, 20_000, 60_000))
    assert (len(quick.grid), quick.seeds) == (5, 5)
    for plan in (full, quick):
        assert all(case.noise.R > 0 for case in plan.grid + plan.changed_on)


def scored(error: float, coverage: float, without: int = 0) -> Row:
    """Return a result row for twenty estimates of 0.5 that are wrong by ± `error`. `without`: number of
    estimates without a value. `coverage`: proportion of the intervals that contain the true value.
    """
    estimate = np.tile([0.5 - error, 0.5 + error], 10)
    covered = np.arange(20) < round(20 * coverage)
    found = score(estimate, np.arange(20) >= without, truth=0.5, covered=covered)
    return {"kind": "rows", **Case(0.5, -1.0, 1.0).columns, "quantity": "alpha", **found}


def test_what_is_right() -> None:
    given = [
        *(scored(0.09, 0.9), scored(0.11, 1.0), scored(0.09, 0.85)),
        *(scored(0.05, 1.0, without=lost) for lost in (2, 3, 20)),
    ]
    assert frame(given, "rows").right.tolist() == [True, False, False, True, False, False]


def test_tables_and_conclusion(tiny: list[Row]) -> None:
    *found, words = summaries.tables(tiny)
    tables = {one.title: one for one in found if isinstance(one, Table)}
    assert len(tables) == len(found) == 11
    for one in tables.values():
        assert one.rows
        assert {len(row) for row in one.rows} == {len(one.headings)}
        assert all(text for row in one.rows for text in row)
    estimators = [*FILTERS, LIVE, WHITTLE]
    assert [row[0] for row in tables["Error of α"].rows[::2]] == [*estimators, "bound"]
    for title in ("Right figures", "White noise"):
        assert [row[0] for row in tables[title].rows[::2]] == estimators
    assert [row[0] for row in tables["Changed settings"].rows] == [one.name for one in CHANGES]
    (joint,) = (
        row
        for row in tiny
        if row["kind"] == "changes"
        and (row["noise"], row["estimator"], row["quantity"]) == (STRONG.name, "joint, as it is", "alpha")
    )
    is_right = int(joint["rmse"] <= 0.1 and joint["coverage"] >= 0.9 and not joint["without"])
    assert cell(tables, "Changed settings", "joint, as it is")[:2] == [
        f"{is_right} of 1",
        f"{joint['rmse']:.2f}",
    ]
    triple = next(row for row in tiny if row["alpha"] is None and row["estimator"] == "triple")
    assert cell(tables, "White noise", "triple", "1,000")[2] == f"{triple['beyond_zero']:.0%}"
    # The ratio of the live fit's error to that of the whole record's fit is left out ("–"): four series are
    # too few for it.
    assert cell(tables, "Live over the whole record", "30", "1,000")[:2] == ["0 of 1", "–"]
    # The table adds the counts of two made-up results, of 600 and of 400 intervals. Of the 1,000 intervals,
    # 40 are undefined, and 95 % contain the true value.
    (held,) = tables["Intervals, noise by noise"].rows
    assert held[:3] == ("any", "3,000", "1,000")
    assert held[3] == f"95.0% (93…96), 4% undefined, else {910 / 960:.1%}"
    assert tables["Noises that change"].rows == [("none", "all", "5 of 6", "0.010", "4 white, 2 drift", "–")]
    assert tables["The exact likelihood"].rows[0][2:5] == ("0.500", "1.00", "1.00")
    assert isinstance(words, str)
    assert words.startswith("After 1,500 samples")
    assert "Where x has at least 90% of the power joint is right in" in words
    # "Where x has less than 90% of the power" is left out: no noise of this test's small plan is of this kind
    assert "less than" not in words


@pytest.mark.slow
def test_figures(tiny: list[Row], monkeypatch: pytest.MonkeyPatch) -> None:
    """Only two of the maps of α and f are drawn here, since drawing a map takes most of a second."""
    monkeypatch.setattr(figures, "MAPS", {name: figures.MAPS[name] for name in ("error", "coverage")})
    drawn = figures.draw(tiny)
    assert set(drawn) == {"error", "coverage", "settings", "live"}
    assert all(data.startswith(b"\x89PNG") for data in drawn.values())
    assert len(set(drawn.values())) == len(drawn)


def test_a_cell_is_empty_where_half_have_no_value() -> None:
    made = [scored(0.1, 1.0, without=lost) for lost in (9, 10)] + [{**scored(0.1, 1.0), "alpha": None}]
    some, half = figures.shown(frame(made, "rows")).itertuples()  # the white noise (α None) gets no row
    assert (some.rmse, some.coverage, some.error_of_f) == pytest.approx((0.1, 1.0, 0.1))
    assert np.isnan([half.rmse, half.bias, half.coverage, half.error_of_f]).all()
