"""Tests of the comparison of the guards, which keep estimates within bounds: what the comparison counts, and
that no run with a guard diverges.
"""

import json
from dataclasses import replace

import numpy as np
import pytest
from fltea.lab.reproduce import score as module
from fltea.lab.reproduce.runs import Options
from fltea.lab.reproduce.scenarios import SawTooth, example
from fltea.lab.reproduce.score import GUARDS, RESTING, SAWTEETH, document, driven, score, steps


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    """Replace the cases in which an input drives the system by two short ones. In the second, the paper's
    algorithm diverges.
    """
    cases = [replace(example(n, SawTooth(a), 600), lengths=(600,)) for n, a in ((1, 1.0), (2, 20.0))]
    monkeypatch.setattr(module, "driven", lambda: cases)


def test_cases_are_those_that_were_promised() -> None:
    assert [s.amplitude for s in SAWTEETH] == [0.5, 1.0, 5.0, 20.0, 1.0, 5.0, 20.0]
    assert [s.unipolar for s in SAWTEETH] == [False] * 4 + [True] * 3
    assert len(driven()) == 2 * len(SAWTEETH) + 1
    assert {case.R_over_V for case in RESTING} == {0.1, 0.3, 0.5, 1.0, 2.0, 3.0, 10.0}
    assert len({case.name for case in RESTING}) == len(RESTING)


def test_every_case_and_guard_is_scored_and_no_guarded_run_is_lost(short: None) -> None:
    done: list[int] = []
    rows = score(3, Options(memory="compressed"), lambda _, n: done.append(n))
    assert sum(done) == steps(3) == 3 * len(rows)
    assert [row["guard"] for row in rows] == list(GUARDS) * (len(rows) // len(GUARDS))
    guarded = [row for row in rows if row["guard"] != "off"]
    assert all(row["not_finite"] + row["far_off"] == 0 for row in guarded), guarded
    assert any(row["not_finite"] + row["far_off"] == 3 for row in rows if row["guard"] == "off")
    json.dumps(rows, allow_nan=False)
    text = document(rows)
    assert text.count("\n| ") == len(rows) // len(GUARDS) + 2
    assert "nan" not in text


def test_without_a_lost_run_both_medians_are_the_same(short: None) -> None:
    rows = score(4, Options(memory="compressed"), lambda *_: None)
    assert rows[1]["guard"] == rows[4]["guard"] == "faithful"
    assert rows[1]["kept"] == {name: rows[1][name] for name in ("state", "parameter", "order")}
    # In the second case, every run of the paper's algorithm diverges, so there is no run to compare with.
    assert set(rows[4]["kept"].values()) == {None}
    assert rows[4]["state"] is not None


@pytest.mark.parametrize("case", RESTING, ids=lambda case: case.name)
def test_resting_cases_are_what_they_are_called(case: module.Resting) -> None:
    noise = np.random.default_rng(1).normal(0, 0.15, (1200, 2))
    y = case.turn(noise.copy())
    assert y.shape == noise.shape
    assert np.isfinite(y).all()
    if "offset" in case.name:
        assert y.mean() == pytest.approx(float(case.name.split()[1]), abs=0.05)
