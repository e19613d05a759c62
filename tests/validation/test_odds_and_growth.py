"""Tests the counts and tables of `make validate ARGS=odds` and `ARGS=growth` on a few noises."""

from typing import Any

import pytest

from tools.validation.gallery import growth
from tools.validation.odds import run
from tools.validation.odds.populations import POPULATIONS
from tools.validation.runner import Options, Row
from tools.validation.tables import Table


def row(population: str, number: int, lead: float | None, odds: float | None) -> Row:
    figures = {"lead": lead, "over_rich": lead, "odds": odds, "kind": "relaxations"}
    return {"population": population, "samples": 3_000, "number": number, "ordinates": 1e3} | figures


def tables(rows: list[Row]) -> list[Any]:
    found = [one for one in run.tables(rows) if isinstance(one, Table)]
    for one in found:
        assert {len(cells) for cells in one.rows} == {len(one.headings)}
    return found


def test_tasks_differ() -> None:
    for part in (run, growth):
        keys = [one.key for one in part.tasks(Options(3, quick=True))]
        assert len(keys) == len(set(keys)) > 5
    assert sum(share for _, share in POPULATIONS.values()) == 1
    assert POPULATIONS["order"][1] == 0.5


def test_odds_that_come_true_are_on_the_line() -> None:
    """The verdict states odds that a noise has an order, such as 3 : 1. They come true if three in four
    noises with these odds have an order.

    The results here are made up: a hundred noises of each kind. When noises are counted, each kind has the
    weight that `POPULATIONS` gives it.
    """
    rows = [row("order", k, 5.0, 2.0) for k in range(100)]
    rows += [row(name, k, 5.0, 2.0) for name in POPULATIONS if name != "order" for k in range(50)]
    rows += [row(name, k, -20.0, 0.05) for name in POPULATIONS if name != "order" for k in range(50)]
    (low, high) = run.reliability(rows)
    assert low[0] == 150
    assert low[2] == 0.0
    assert high[1] == pytest.approx(2 / 3)
    assert high[2] == pytest.approx(2 / 3)
    reliability, claims, found = tables(rows)
    assert [cells[1] for cells in reliability.rows] == ["150", "250"]
    assert len(claims.rows) == 4
    assert {cells[-1] for cells in found.rows} == {"0%"}, "half of the sums are as far ahead as the orders"
    assert run.operating(rows, "random sum") == ([0.0, 0.5, 1.0], [0.0, 1.0, 1.0])


@pytest.mark.slow
def test_records_that_grow(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(growth, "LENGTHS", (3_000, 20_000))
    rows = growth.grow("1 relaxation", 0)
    assert [one["samples"] for one in rows] == list(growth.LENGTHS)
    assert rows[-1]["outcome"] == "right"
    assert growth.says_less(rows) == []
    worse = [*rows[:-1], rows[-1] | {"kind": "white", "outcome": "wrong"}]
    assert growth.says_less(worse) == worse[-1:]
    said, by_length, less = growth.tables([*rows, *({**one, "record": 1} for one in worse)])
    assert said == "Of 2 records 1 say less when they grow."
    assert isinstance(by_length, Table)
    assert isinstance(less, Table)
    assert len(by_length.rows) == 1
    assert "white ✗ 1" in by_length.rows[0][-1]
    assert less.rows == [("1 relaxation", "1", "20,000", "white")]
