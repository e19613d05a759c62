"""Every published interval is measured, and its coverage is compared with the stated one."""

import re
from functools import cache

import numpy as np
import pytest
from fltea.noise import parts as p
from fltea.records.fit import Interval

from tests.rig.host_support import ROOT
from tools.validation.coverage import measure, published, run
from tools.validation.coverage.populations import POPULATIONS
from tools.validation.coverage.published import ALLAN, FIGURES, Elsewhere, Field
from tools.validation.runner import Options
from tools.validation.tables import Table


def test_each_published_interval_has_a_row_or_a_reason() -> None:
    """If this test fails for a new field of a record, state in `FIGURES` what is measured for the field."""
    fields = list(published.fields())
    assert {one.name for one in fields} == FIGURES.keys()
    assert Field("tau_s", "identification/navigation_file.GaussMarkovState") in fields
    assert Field("bias_std", "records/stats.TrackerStats") in fields
    assert all(one.why for one in FIGURES.values() if isinstance(one, Elsewhere))


FITTED = [kind for kind in p.CODES if kind.row().free_parameters]
"""Kinds of parts of noise models that have free parameters. A fit gives an interval for each parameter."""


@pytest.mark.parametrize("kind", FITTED, ids=lambda kind: kind.tag())
def test_each_kind_of_part_has_a_population(kind: type[p.Part]) -> None:
    where = "POPULATIONS of tools/validation/coverage/populations.py"
    assert kind in drawn_kinds(), f"no noise in {where} has the part {kind.tag()}"


@cache
def drawn_kinds() -> set[type[p.Part]]:
    """Return the kinds of parts that noises of all populations have."""
    rng = np.random.default_rng(1)
    return {type(part) for population in POPULATIONS.values() for part in population.draw(rng)}


@pytest.mark.parametrize("name", POPULATIONS)
def test_each_population_is_on_the_page_of_the_coverage(name: str) -> None:
    """The page has a row for each population in the table of N, or a line with the number of its records."""
    page = "host/docs/evaluation/coverage.md"
    text = (ROOT / page).read_text(encoding="utf-8")
    is_there = re.search(
        rf"^(\| {name} \||- \*\*{name}\*\* \([0-9,]+ records)", text, re.MULTILINE | re.IGNORECASE
    )
    assert is_there, f"{page} has no figures of the population {name}: `make validate ARGS=coverage`"


@pytest.mark.parametrize("kind", FITTED, ids=lambda kind: kind.tag())
def test_each_parameter_of_a_part_is_on_the_page_of_the_coverage(kind: type[p.Part]) -> None:
    """The page has a row for each parameter, or a line with the number of records with such a part."""
    page = "host/docs/evaluation/coverage.md"
    text = (ROOT / page).read_text(encoding="utf-8")
    tag = kind.tag()
    if re.search(rf"^- \*\*{tag}\*\* \([0-9,]+ records", text, re.MULTILINE | re.IGNORECASE):
        return
    for name in kind.__struct_fields__:
        # an order's own figures have the rows "α of an order"; those of its part are marked as such
        row = f"{'α' if name == 'alpha' else name} of order (part)" if kind is p.Order else f"{name} of {tag}"
        assert f"\n| {row} |" in text, (
            f"{page} has no row `{row}`: `make validate ARGS='coverage --only NAME'`"
        )


@pytest.mark.slow
def test_each_row_is_measured() -> None:
    """The populations of simulated noises contain every kind of part of noise models, so every interval is
    measured. A new kind of part needs a population.
    """
    rows = [row for name in POPULATIONS for row in run.count(name, 1)]
    measured = {row["quantity"] for row in rows}
    wanted = {one for one in FIGURES.values() if isinstance(one, str)}
    assert measured == wanted | {ALLAN, *published.parameters()}
    assert [one.name for one in run.tasks(Options(5))] == list(POPULATIONS)
    assert len(run.tasks(Options(5, only=("walk",)))) == 1
    for table in run.tables(rows):
        assert isinstance(table, Table)
        assert {len(row) for row in table.rows} == {len(table.headings)}


@pytest.mark.parametrize(
    ("interval", "expected"),
    [
        (Interval(2.0, 1.0, 3.0), (True, 0.0, 0.0, 1.0)),
        (Interval(2.0, 2.1, 3.0), (True, 1.0, 0.0, 0.45)),
        (Interval(2.0, 1.0, 1.9), (True, 0.0, 1.0, 0.45)),
        (Interval(2.0, None, 1.9), (True, 0.0, 1.0, None)),
        (Interval(2.0), (False, 0.0, 0.0, None)),
        (Interval(), (False, 0.0, 0.0, None)),
    ],
)
def test_what_holds_a_truth_of_2(
    interval: Interval, expected: tuple[bool, float, float, float | None]
) -> None:
    found = measure._seen("N", interval, 2.0)
    assert found == ("N", *expected[:3], None if expected[3] is None else pytest.approx(expected[3]))


def test_coverage_has_its_error() -> None:
    """By hand: 4 of 100 published intervals miss the true value (1 below, 3 above), so the coverage is 96 %.
    It is shown with the statistical error of a proportion.
    """
    row = {"population": "white", "quantity": "N", "intervals": 120, "published": 100}
    row |= {"below": 1.0, "above": 3.0, "squares": 4.0, "width": 0.1}
    whole, single = run.tables([row])
    assert isinstance(whole, Table)
    assert isinstance(single, Table)
    assert whole.rows == [("N", "100 of 120", "96.0 ± 2.0 %", "1.0 %", "3.0 %", "0.1")]
    assert single.rows[0][:2] == ("white", "N")


def test_true_figures() -> None:
    """White noise with the variance R = 4 at 100 Hz has N = √(4 / 100 Hz) = 0.2.

    The Allan deviation of white noise falls with the square root of the averaging time.
    """
    white = (p.White(4.0), p.Relaxation(3.0, 0.2), p.Quantisation(0.1))
    assert measure.true_N(white) == pytest.approx(0.2)
    np.testing.assert_allclose(
        measure.true_allan(white[:1], np.array([1.0, 10.0, 100.0])), 2 / np.sqrt([1, 10, 100]), rtol=2e-3
    )


def held(rows: list[dict[str, object]], quantity: str) -> tuple[float, float]:
    """Return how many intervals of a quantity contain the true value, and how many intervals there are."""
    (row,) = (one for one in rows if one["quantity"] == quantity)
    published, below, above = (float(str(row[name])) for name in ("published", "below", "above"))
    return published - below - above, published


def test_N_holds_what_a_fast_relaxation_that_was_not_found_would_make_of_it() -> None:
    """The interval of N allows for a fast relaxation that the fit may have missed. Of 40 intervals, 38 (95 %)
    are expected to contain the true N. If intervals came from the chosen model alone, only 21 would contain
    it.
    """
    inside, published = held(run.count("fast relaxation", 40), "N")
    assert published >= 25
    assert inside >= 0.85 * published


def test_N_of_white_noise_is_no_wider() -> None:
    """In nine of ten records of white noise, the interval of N is as narrow as theory allows.

    In theory, the relative half width of N's interval is 1.96 / (2 √n) for n ordinates.
    """
    rng = np.random.default_rng(1)
    wider = []
    for _ in range(60):
        axis = measure.analyse((p.White(1.0),), rng.standard_normal(6_000))
        N = axis.figures.level.N
        assert N.value is not None
        assert N.low is not None
        assert N.high is not None
        wider.append((N.high - N.low) / N.value / (1.96 / np.sqrt(2_750)))
    assert np.median(wider) < 1.05
    assert np.mean(np.array(wider) > 1.1) < 0.2


def test_parameters_of_an_order_have_their_own_profile() -> None:
    """Noise of fractional order has the parameters α, f and Q. Of 40 intervals of each, 38 (95 %) are
    expected to contain the true value.

    The fitted f and Q change with α, so intervals of f and Q at a fixed α would contain the true value in
    half of the cases or less.
    """
    rows = run.count("order, no white", 40)
    for quantity in ("alpha of order", "f of order", "Q of order"):
        inside, published = held(rows, quantity)
        assert published >= 25
        assert inside >= 0.86 * published, quantity
