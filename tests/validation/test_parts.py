"""Tests the counts and tables of the smaller parts of `make validate` on a few short series."""

from typing import Any

import numpy as np
import pytest

from tests.rig.tiers import long
from tools.validation import __main__ as program
from tools.validation import anytime, bound, fleet, power, states
from tools.validation.runner import Options
from tools.validation.tables import Table


def cells(tables: list[Any]) -> list[Any]:
    """Check that each row of each table has as many cells as the table has headings. Return all rows of all
    tables.
    """
    for one in tables:
        assert isinstance(one, Table)
        assert one.rows
        assert {len(row) for row in one.rows} == {len(one.headings)}
    return [row for one in tables for row in one.rows]


def test_tasks_differ() -> None:
    for part in (anytime, bound, fleet, power, states):
        for quick in (False, True):
            keys = [one.key for one in part.tasks(Options(25, quick))]
            assert len(keys) == len(set(keys)) > (1 if part is bound else 5)
    assert {"gallery", "evaluate", "device", "forecast"} < set(program.PARTS)


@pytest.mark.slow
@pytest.mark.parametrize(
    "noise",
    ["walk, 0.002 a sample", long("low-pass of 20 Hz, relaxation of 1 s"), long("α .8, f -1, s2/R 3")],
)
def test_the_bias_is_near_the_best_possible(noise: str) -> None:
    early, late = states.track(noise, 6)
    assert late["bias"] < 1.06 * late["best"]
    assert early["bias"] < min(1.25 * early["best"], early["y"])
    assert 0.9 < late["within"] < 0.99


@pytest.mark.parametrize("noise", list(power.WHITE))
def test_about_five_white_series_in_a_hundred_are_rejected(
    noise: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of 200 short series of white noise, the null test rejects about ten.

    The probability of 3 or fewer, or of 19 or more, is 1 %.
    """
    monkeypatch.setitem(power.LENGTHS, "30 s", 1_000)
    rows = power.count(noise, "30 s", 200)
    assert [row["spectrum"] for row in rows] == ["live", "whole"]
    for row in rows:
        assert 4 <= row["at 5 %"] <= 18
        assert row["at 1 %"] <= row["at 5 %"]
        assert row["peaks"] <= 2
    (alarms,) = power.tables(rows)
    assert len(cells([alarms])) == 2


@pytest.mark.parametrize("noise", list(power.WHITE))
def test_the_noises_are_white_and_what_they_are_called(noise: str) -> None:
    rng = np.random.default_rng(1)
    y, other = power.WHITE[noise](50_000, rng), power.WHITE[noise](50_000, rng)
    assert float(np.corrcoef(y[1:], y[:-1])[0, 1]) == pytest.approx(0, abs=0.02)
    assert float(np.corrcoef(y, other)[0, 1]) == pytest.approx(0, abs=0.02)
    assert ("LSB" in noise) == bool((y == np.rint(y)).all())
    fourth = float(((y - y.mean()) ** 4).mean() / y.var() ** 2)
    assert (fourth > 5) == (noise == "t4 tails")


def test_strong_noise_is_found() -> None:
    (row,) = power.count("α 0.6, f -0.3, 100% of the power", "30 s", 5)
    assert (row["spectrum"], row["at 5 %"], row["peaks"]) == ("live", 5, 0)
    (found,) = power.tables([row])
    assert isinstance(found, Table)
    assert found.rows[0][1].startswith("100.0%")


@pytest.mark.parametrize(
    ("noise", "rules"),
    [
        ("Gaussian", ["null test", "sentences", "drift", "peaks", "not stationary", "verdict", "any rule"]),
        ("AR(.99)", ["fractional"]),
    ],
)
def test_an_axis_looked_at_all_the_while(noise: str, rules: list[str]) -> None:
    rows = [row for seed in range(2) for row in anytime.axis(noise, 3_000, seed)]
    assert [list(row["lowest"]) for row in rows] == [rules, rules]
    for row in rows:
        assert 1e-4 < min(row["lowest"].values()) <= max(row["lowest"].values()) <= 1
    shares = [[float(cell.rstrip("%")) for cell in line[1:]] for line in cells(anytime.tables(rows))]
    assert all(line == sorted(line, reverse=True) for line in shares)


def test_critical_values_rise_with_the_correlation() -> None:
    """Two estimates are made, and the second (a variance) cannot be negative. The critical value of the
    likelihood ratio for the first rises with the correlation of the two. Without correlation it is 3.84, as
    for a single estimate.
    """
    points = {row["rho"]: row["critical"] for row in bound.critical_values()}
    assert points[0.0] == pytest.approx(3.84 + 0.0, abs=0.03)
    assert list(points.values()) == sorted(points.values())
    assert points[1.0] == pytest.approx(5.14, abs=0.03)


def test_estimates_are_related_to_white_noise_that_is_not_there() -> None:
    rows = bound.correlated(3_000)
    assert {row["parameter"] for row in rows} == {"alpha", "f", "F", "s2"}
    assert all(0 < row["correlation"] <= 1 for row in rows)
    cells(bound.tables([*bound.critical_values(), *rows]))


@pytest.mark.slow
def test_equal_sensors_are_hardly_ever_odd() -> None:
    rows = [row for first in (0, 10) for row in fleet.fitted("white", first, 10, [3_000], 100.0)]
    (equal, differing) = cells(fleet.tables(rows))
    assert equal[:3] == ("white", "20", "0%")
    assert differing[2] == "3%"
    assert float(equal[3].rstrip("%")) < 10


def test_a_sensor_that_is_ten_times_as_strong_is_odd() -> None:
    rows = fleet.fitted("white", 0, 20, [20_000], 100.0)
    looks = [fleet.msgspec.convert(row["fits"], fleet.Fits) for row in rows]
    members: list[Any] = [(one, fleet._all_figures(one, 100.0), 1.0) for one in looks]
    turns = np.zeros(20, dtype=np.int64)
    assert fleet._odd_at(members, turns) == set()
    assert fleet._odd_at([*members[:-1], (*members[-1][:2], 10.0)], turns)
