"""Tests that the outputs show all figures of the records.

A figure is a number of a record that outputs show, with its name and unit. Each number of a record is
declared as a figure, or there is a reason why not. Each output shows the figures that are declared for it.
"""

import re
from collections.abc import Iterator
from typing import get_args, get_type_hints

import msgspec
import pytest
from fltea.records.records import AnyRecord, Estimate, Placed, Record
from fltea.sinks.figures import of_axis, of_device, of_filters, of_fit, of_link
from fltea.sinks.figures.figure import ROOTS, Hidden
from fltea.sinks.figures.table import FIGURES, UNSHOWN, WITHOUT_FIGURES

from tests.rig.figure_records import (
    EVERYTHING,
    EXAMPLES,
    PLACES,
    parts_of,
    with_changed,
)
from tests.rig.host_support import ROOT

FOLDER = "host/fltea/sinks/figures"
DASHBOARD = "tools/deploy/grafana/fltea.json"
DECLARED = {(figure.kind, figure.field) for figure in FIGURES}
MODULES = of_link, of_fit, of_axis, of_filters, of_device


def files(kind: type) -> str:
    """Return the names of the files in which figures of this record, or part of a record, are declared."""
    having = (one.__name__ for one in MODULES if any(figure.kind is kind for figure in one.FIGURES))
    return " or ".join(f"{FOLDER}/{name.rpartition('.')[2]}.py" for name in having) or FOLDER


def numbers(kind: type, prefix: str = "") -> Iterator[str]:
    """Yield the paths of all numbers in a record.

    Parts of a record that are in ROOTS have declarations of their own, and are left out.
    """
    for name, hint in get_type_hints(kind).items():
        path = f"{prefix}.{name}".lstrip(".")
        for one in parts_of(hint):
            if one in (int, float, bool):
                yield path
            elif isinstance(one, type) and issubclass(one, msgspec.Struct) and one not in ROOTS:
                yield from numbers(one, path)


def kinds() -> Iterator[type]:
    """Yield the types of all records with figures, and of those parts of records whose figures are declared
    separately.
    """
    yield from (record for record in get_args(AnyRecord) if record not in WITHOUT_FIGURES)
    yield from (kind for kind in ROOTS if not issubclass(kind, Record))


def is_excused(kind: type, path: str) -> bool:
    return any((kind, path[: end.start()]) in UNSHOWN for end in re.finditer(r"\.|$", path))


@pytest.mark.parametrize("kind", [*kinds()], ids=lambda kind: kind.__name__)
def test_each_number_of_a_record_is_a_figure_or_has_a_reason(kind: type) -> None:
    of_place = set(numbers(Placed)) if issubclass(kind, Placed) else set()
    missing = [
        path
        for path in numbers(kind)
        if (kind, path) not in DECLARED and not is_excused(kind, path) and path not in of_place
    ]
    assert not missing, (
        f"{kind.__name__} has numbers that are no figures: {missing}. Declare each in "
        f"{files(kind)}, or say in UNSHOWN of {FOLDER}/table.py why no place shows it."
    )


def test_each_record_has_figures_or_a_reason_why_it_has_none() -> None:
    with_figures = {root.record for root in ROOTS.values()}
    without = set(WITHOUT_FIGURES)
    assert set(get_args(AnyRecord)) == (with_figures | without) - {Placed}
    assert not with_figures & without


def test_figures_and_exceptions_are_of_fields_that_there_are() -> None:
    assert len(DECLARED) == len(FIGURES)
    assert [one for one in DECLARED if is_excused(*one)] == []
    assert all(UNSHOWN.values())
    assert all(place.why for figure in FIGURES for place in figure if isinstance(place, Hidden))
    for kind, path in UNSHOWN:
        assert any(f"{found}.".startswith(f"{path}.") for found in numbers(kind)), (kind.__name__, path)
    for kind, path in DECLARED:
        with_changed(EVERYTHING, kind, path)  # this call raises an error if the record has no such field


def name_of(kind: type, path: str) -> str:
    return f"{kind.__name__}.{path}"


@pytest.mark.parametrize("place", PLACES)
def test_a_place_shows_each_figure_that_is_declared_for_it(place: str) -> None:
    show, file = PLACES[place]
    left = [(one.kind, one.field) for one in FIGURES if not isinstance(getattr(one, place), Hidden)]
    for records in (*EXAMPLES, {kind: one for kind, one in EVERYTHING.items() if kind is not Estimate}):
        if left:
            usual = show(records)
            left = [one for one in left if show(with_changed(records, *one)) == usual]
    assert not left, (
        f"{place} does not show {[name_of(*one) for one in left]}, which {FOLDER} declares: see {file}, or "
        "declare them Hidden there, with the reason"
    )


@pytest.mark.parametrize("place", PLACES)
def test_a_place_shows_no_number_that_is_hidden_there_or_an_exception(place: str) -> None:
    show, _ = PLACES[place]
    hidden = [(one.kind, one.field) for one in FIGURES if isinstance(getattr(one, place), Hidden)]
    hidden += [(kind, path) for kind in kinds() for path in numbers(kind) if is_excused(kind, path)]
    for records in EXAMPLES:
        usual, others = show(records), records
        for one in hidden:
            others = with_changed(others, *one)
        if show(others) != usual:
            shown = [name_of(*one) for one in hidden if show(with_changed(records, *one)) != usual]
            pytest.fail(f"{place} shows {shown}, which {FOLDER} declares Hidden or lists in UNSHOWN")


def test_the_dashboard_has_the_metrics_that_are_declared_for_it_and_no_others() -> None:
    text = (ROOT / DASHBOARD).read_text(encoding="utf-8")
    asked = set(re.findall(r"\bfltea_\w+", text))
    for figure in FIGURES:
        name, is_hidden = name_of(figure.kind, figure.field), isinstance(figure.grafana, Hidden)
        metric = figure.metric_name
        if not metric:
            assert is_hidden, f"{name} has no metric, so {DASHBOARD} cannot show it: declare it Hidden"
            continue
        assert (metric in asked) != is_hidden, (
            f"{name} is declared Hidden, and {DASHBOARD} asks for {metric}: see {FOLDER}"
            if is_hidden
            else f"{DASHBOARD} has no panel with {metric}: add one, or declare {name} Hidden with a reason"
        )
