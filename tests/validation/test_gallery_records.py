"""The gallery from end to end: verdicts on some of its noises, tables, and pictures."""

from typing import Any

import pytest

from tools.validation.gallery import against, records
from tools.validation.gallery.noises import NOISES
from tools.validation.gallery.records import analyse, pictures, summary, tables, tasks
from tools.validation.runner import Options, Row
from tools.validation.tables import Table

EXAMINED = (
    *("white", "white, t4", "rounded, 0.3 LSB", "outliers", "1 relaxation", "2 relaxations"),
    *("3 relaxations", "4 relaxations", "AR(.99) + AR(.5)", "slow relaxation", "ARFIMA d .4"),
    *("ARFIMA d -.3", "ARFIMA(1, .4, 1)", "state 0.8, -1, 3", "1/f, 1 Hz", "1/f, 10 Hz", "random walk"),
    *("ramp", "1 pole, 20 Hz", "2 poles, 20 Hz", "mean of 4", "MPU-9250, 20 Hz", "2 poles, 20 Hz, 1/f"),
    *("AC, 0.1 Hz", "AC, 1 Hz, 2 poles", "auto-zero", "AC, relaxation"),
    *("state 0.35, -4, 3", "3 relaxations, angle", "3 relaxations, sharpened", "walk, angle", "notch"),
    *("resonance, Q 10", "line", "line at the end", "slow line", "hum", "differenced", "variance steps"),
    *("swing, 2,000 × 2", "swing, 250 × 1.5", "dead band", "telegraph"),
)


@pytest.mark.long
@pytest.mark.parametrize("name", EXAMINED)
def test_verdicts(name: str) -> None:
    """The verdicts on one record of 10 min at 100 Hz of each noise are right."""
    (row,) = analyse(name, 100.0, 600.0, 0)
    assert row["outcome"] != "wrong", row["text"]
    if row["kind"] == "fractional":
        assert row["has_order"]
        assert row["ahead"] > records.MARGIN


def seen(name: str, kind: str, outcome: str, number: int = 0, ahead: float | None = 0.0) -> Row:
    reason = "too short" if outcome == "cannot be told" else ""
    judged = {"kind": kind, "text": "Text.", "outcome": outcome, "right": ["white"], "reason": reason}
    where = {"noise": name, "rate_hz": 100.0, "duration_s": 600.0, "record": number}
    known = {"has_order": NOISES[name].has_order, "true_alpha": NOISES[name].alpha, "alpha": [0.3, 0.2, 0.4]}
    return where | judged | known | {"ahead": ahead}


MADE = [
    seen("white", "white", "right", ahead=None),
    seen("white", "undecided", "cannot be told", 1),
    seen("1 relaxation", "fractional", "wrong", ahead=3.0),
    seen("1 relaxation", "relaxations", "right", 1),
    seen("ARFIMA d .4", "fractional", "right", ahead=20.0),
]


def test_figures_that_count() -> None:
    first, second, power, third = summary(MADE)
    assert "Of 5 records 3 verdicts are right (60.0%), 1 say less" in first
    assert first.endswith("and 1 are wrong (20.0%).")
    assert second.startswith("Of 4 records of noises without an order 1 are")
    assert power.startswith('Of 1 records of noises with an order 1 are called "fractional", 0 of the 0')
    assert third.startswith('Of 2 claims of "fractional" 1')
    assert "(–)" in summary([])[1]


def test_tables() -> None:
    wrong, whole, not_notified = (one for one in tables(MADE) if not isinstance(one, str))
    assert wrong.rows == [("1 relaxation", "100 Hz, 10 min", "fractional 1 of 2", "white")]
    assert not_notified.rows == [("white", "100 Hz, 10 min", "undecided 1 of 2", "too short")]
    lines = whole.markdown().splitlines()
    assert lines[2] == "| noise | truth | 100 Hz, 10 min |"
    assert lines[4] == "| white | Gaussian white noise | white 1, undecided? 1 |"
    assert lines[6].endswith("| fractional |")


def test_two_runs_cell_by_cell() -> None:
    """Two runs of the gallery are compared cell by cell of their tables. A cell that only one of the runs has
    is not counted.
    """
    after = [
        seen("white", "white", "right"),
        seen("white", "fractional", "wrong", 1),
        seen("1 relaxation", "fractional or relaxations", "right"),
        seen("1 relaxation", "fractional or relaxations", "right", 1),
        seen("ARFIMA d .4", "fractional", "right") | {"alpha": [0.5, 0.45, None]},
        seen("ramp", "drift", "right"),
    ]
    count, held, changed = against.tables(MADE, after)
    assert count == "Of 5 cells of both runs: 1 better, 1 worse, 1 other, as good, 2 same."
    assert held == "Intervals that hold the true α: 1 of 1 (100.0%) before, 0 of 0 (–) now."
    assert isinstance(changed, Table)
    assert [(row[0], row[1], row[4]) for row in changed.rows] == [
        ("better", "1 relaxation", "0"),
        ("worse", "white", "1"),
        ("other, as good", "1 relaxation", "1"),
    ]


def test_true_orders() -> None:
    found = {name: NOISES[name].alpha for name in ("ARFIMA d .4", "state 0.8, -1, 3", "1/f, 1 Hz", "ramp")}
    assert list(found.values()) == [0.4, 0.8, 0.5, None]
    assert NOISES["ARFIMA(1, .4, 1)"].alpha is None


def test_what_is_said_of_a_line() -> None:
    (row,) = analyse("line", 100.0, 30.0, 7)
    assert row["record"] == 7
    assert row["lines_hz"] == pytest.approx([23.01], abs=0.05)
    assert row["alpha"][1] is None or row["alpha"][1] <= row["alpha"][0]


def test_tasks() -> None:
    whole, quick = tasks(Options(1)), tasks(Options(3, quick=True, only=("relaxation", "1/f")))
    assert len(whole) == len({one.key for one in whole}) == 9 * len(NOISES) >= 9 * 45
    names = {one.name for one in quick}
    assert len(quick) == 3 * len(names)
    assert all("relaxation" in name or "1/f" in name for name in names)
    assert {one.arguments[1:3] for one in quick} == {(100.0, 600.0)}
    assert {one.arguments[3] for one in tasks(Options(2, first=5))} == {5, 6}


def test_constant_record() -> None:
    found = (analyse("rounded, 0.1 LSB", 5.0, 30.0, i)[0] for i in range(100))
    constant = next(row for row in found if row["kind"] == "constant")
    assert (constant["outcome"], constant["ahead"], constant["alpha"]) == ("cannot be told", None, None)


@pytest.mark.slow
def test_pictures() -> None:
    rows: list[Any] = [row for name in ("white", "rounded, 1 LSB") for row in analyse(name, 5.0, 30.0, 0)]
    drawn = pictures(rows)
    assert set(drawn) == {"cells", "spectra"}
    assert all(data.startswith(b"\x89PNG") for data in drawn.values())
