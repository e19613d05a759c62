"""Tests that each place shows a figure in the unit that ends the name of its field, such as `_s` or `_hz`."""

import difflib
import json
import re
from collections.abc import Callable, Iterator
from types import ModuleType
from typing import NamedTuple

import pytest
from fltea.records.records import Estimate, Stats
from fltea.records.stats import AxisStats, DeviceStatus, LinkStats
from fltea.sinks.figures import of_axis, of_device, of_filters, of_fit, of_link
from fltea.sinks.figures.figure import (
    ROOTS,
    Entity,
    Figure,
    Hidden,
    Metric,
    Row,
    Rows,
    Shown,
    counter,
    gauge,
    lookup,
    loss,
)
from fltea.sinks.figures.table import FIGURES
from fltea.sinks.words import duration

from tests.rig.figure_records import EVERYTHING, EXAMPLES, PLACES, Records, with_changed
from tests.rig.host_support import ROOT

DASHBOARD = "tools/deploy/grafana/fltea.json"
PANELS = json.loads((ROOT / DASHBOARD).read_text(encoding="utf-8"))["panels"]


class Unit(NamedTuple):
    """A unit of fields of records, and how the outputs write it.

    `base`: Prometheus' base unit, at the end of a metric's name. `factor`: factor from the unit to the base
    unit. `symbol`: the unit for people and for Home Assistant. `device_class`: Home Assistant's class of
    quantities that have this unit, by its documentation of version 2025.4, "Sensor"; None if there is none.
    """

    base: str
    factor: float
    symbol: str
    device_class: str | None = None


UNITS = {
    "ns": Unit("seconds", 1e-9, "ns"),
    "us": Unit("seconds", 1e-6, "µs"),
    "ms": Unit("seconds", 1e-3, "ms", "duration"),
    "s": Unit("seconds", 1.0, "s", "duration"),
    "hz": Unit("hertz", 1.0, "Hz", "frequency"),
    "c": Unit("celsius", 1.0, "°C", "temperature"),
    "ppm": Unit("ratio", 1e-6, "ppm"),
    "percent": Unit("ratio", 1e-2, "%"),
    "bytes": Unit("bytes", 1.0, "B", "data_size"),
}
"""The units at the ends of fields' names."""

OF_PEOPLE = {
    "seconds": {"µs": 1e-6, "ms": 1e-3, "s": 1.0, "min": 60.0, "h": 3600.0},
    "hertz": {"Hz": 1.0, "kHz": 1e3},
    "celsius": {"°C": 1.0},
    "ratio": {"ppm": 1e-6, "%": 1e-2},
    "bytes": {"bytes": 1.0, "B": 1.0, "kB": 1e3, "MB": 1e6},
}
"""For each base unit, the units in which people may read a value, with their factors to the base unit."""

GRAFANA = {
    "seconds": "s",
    "hertz": "hertz",
    "celsius": "celsius",
    "ratio": "percentunit",
    "bytes": "bytes",
    "degrees": "degree",
}
"""Grafana's name of each base unit (Grafana, "Standard options", unit)."""
RATES = {"seconds": "percentunit", "bytes": "Bps"}
"""Grafana's name of a base unit a second."""


def unit_of(figure: Figure) -> Unit | None:
    """Return the unit at the end of the field's name; None if the name has none."""
    name, _, ending = figure.path.rpartition(".")[2].rpartition("_")
    return UNITS.get(ending) if name else None


def metric_amiss(figure: Figure) -> Iterator[str]:
    if not isinstance(figure.metric, Metric):
        return
    unit = unit_of(figure) or Unit("", 1.0, "")
    if figure.metric.factor != unit.factor:
        yield f"the metric {figure.metric.name} needs factor={unit.factor}"
    if unit.base and not figure.metric.name.endswith(f"_{unit.base}"):
        yield f"the name of the metric {figure.metric.name} has to end in _{unit.base}"


def entity_amiss(figure: Figure) -> Iterator[str]:
    """Home Assistant gets the field's value as it is, so the entity needs the field's unit."""
    entity, unit = figure.home_assistant, unit_of(figure)
    if unit is None or not isinstance(entity, Entity) or entity.template:
        return
    if entity.unit != unit.symbol:
        yield f"the entity {entity.key} of Home Assistant needs unit={unit.symbol!r}"
    if entity.device_class != unit.device_class:
        yield f"the entity {entity.key} of Home Assistant needs device_class={unit.device_class!r}"


def row_amiss(figure: Figure) -> Iterator[str]:
    """Yield what is wrong with the figure's row on the page. The row has to name a unit, in its text or its
    label, and the number in the text has to be the value in this unit.
    """
    row, unit = figure.page, unit_of(figure)
    if unit is None or not isinstance(row, Row):
        return
    known, value = OF_PEOPLE[unit.base], 5000
    text = row.text(value)
    number, _, shown = text.partition(" ")
    if not shown and set(row.label.split()) & known.keys():
        shown = unit.symbol
    if shown not in known:
        yield f"the page's row {row.label!r} shows {value} as {text!r}, without a unit: {', '.join(known)}"
    elif float(number.replace(",", "")) * known[shown] != pytest.approx(value * unit.factor, rel=0.03):
        yield f"the page's row {row.label!r} shows {value} {unit.symbol} as {text!r}"


def panels_amiss(figure: Figure, panels: list[dict[str, object]]) -> Iterator[str]:
    """A panel has the base unit of each metric that it shows."""
    for panel, expression in asked(panels):
        if not figure.metric_name or not re.search(rf"\b{figure.metric_name}\b", expression):
            continue
        base = figure.metric_name.removesuffix("_total").rpartition("_")[2]
        needed = RATES.get(base) if "rate(" in expression else GRAFANA.get(base)
        if base == "ratio" and re.search(r"\* 1e6$", expression):
            needed = "ppm"
        found = panel["fieldConfig"]["defaults"].get("unit")  # type: ignore[index]
        if needed and found != needed:
            yield f"the panel {panel['title']!r} of {DASHBOARD} needs the unit {needed!r}, not {found!r}"


def asked(panels: list[dict[str, object]]) -> Iterator[tuple[dict[str, object], str]]:
    """Yield each query of the panels, with its panel."""
    for panel in panels:
        for target in panel.get("targets", ()):  # type: ignore[attr-defined]
            yield panel, target["expr"]


def amiss(figure: Figure, panels: list[dict[str, object]] = PANELS) -> list[str]:
    """Return what is wrong with the units in which the places show a figure."""
    return [
        *metric_amiss(figure),
        *entity_amiss(figure),
        *row_amiss(figure),
        *panels_amiss(figure, panels),
    ]


MODULES = of_link, of_fit, of_axis, of_filters, of_device


@pytest.mark.parametrize("module", MODULES, ids=lambda one: one.__name__.rpartition(".")[2])
def test_each_place_has_the_unit_of_the_field(module: ModuleType) -> None:
    found = [f"{figure.path}: {words}" for figure in module.FIGURES for words in amiss(figure)]
    assert not found, f"host/{module.__name__.replace('.', '/')}.py: " + "; ".join(found)


IN_A_LAYOUT = [
    (figure, place)
    for figure in FIGURES
    for place in ("page", "terminal")
    if unit_of(figure) and isinstance(getattr(figure, place), Rows | Shown)
]
NUMBER = r"([-+]?\d[\d,]*(?:\.\d+)?)"


def shown_in(figure: Figure, text: str) -> list[float]:
    """Return the values in a text with a unit that people may read for this figure, in the base unit.

    The unit stands after the number, or at the end of a key of JSON.
    """
    unit = unit_of(figure)
    assert unit is not None
    known = OF_PEOPLE[unit.base]
    found = re.findall(rf"{NUMBER} ({'|'.join(known)})(?!\w)", text)
    found += [(number, ending) for ending, number in re.findall(rf'_(\w+)": {NUMBER}', text)]
    return [float(number.replace(",", "")) * known[name] for number, name in found if name in known]


def layout_amiss(figure: Figure, show: Callable[[Records], str]) -> str | None:
    """Return how a place shows a figure without its unit; None if it has the unit."""
    unit = unit_of(figure)
    assert unit is not None
    root = ROOTS[figure.kind]
    for records in (*EXAMPLES, {kind: one for kind, one in EVERYTHING.items() if kind is not Estimate}):
        others = with_changed(records, figure.kind, figure.field)
        usual, text = show(records), show(others)
        if usual == text:
            continue
        value = lookup(others[root.record], f"{root.path}.{figure.field}".strip("."))
        values = value.values() if isinstance(value, dict) else [value]
        wanted = {float(one) * unit.factor for one in values}
        if any(one == pytest.approx(w, rel=0.03) for one in shown_in(figure, text) for w in wanted):
            return None
        lines = difflib.ndiff(*(re.split(r"\n|, ", one) for one in (usual, text)))
        return f"{[line[2:] for line in lines if line.startswith('+ ')][:3]} without {unit.symbol}"
    return None  # test_figures.py says that the place does not show it


@pytest.mark.parametrize(("figure", "place"), IN_A_LAYOUT, ids=lambda one: getattr(one, "path", one))
def test_a_place_with_a_layout_of_its_own_has_the_unit_of_the_field(figure: Figure, place: str) -> None:
    show, file = PLACES[place]
    found = layout_amiss(figure, show)
    assert found is None, f"{figure.path}: {file} shows {found}"


def test_a_layout_without_a_unit_is_named() -> None:
    rate = next(figure for figure, place in IN_A_LAYOUT if figure.path == "stats.rate_hz")
    for text in ("{:.2f}", "{:.2f} ms", "{:.0f} kHz"):
        found = layout_amiss(rate, lambda records, text=text: text.format(records[Stats].rate_hz))
        assert "without Hz" in (found or ""), text


NOWHERE = Hidden("a test")


def figure_of(
    field: str,
    kind: type = Stats,
    *,
    metric: Metric | Hidden = NOWHERE,
    page: Row | Hidden = NOWHERE,
    entity: Entity | Hidden = NOWHERE,
) -> Figure:
    return Figure(kind, field, metric, page, NOWHERE, entity, Shown("a panel"))


def panel_of(expression: str, unit: str) -> list[dict[str, object]]:
    return [
        {
            "title": "A panel",
            "fieldConfig": {"defaults": {"unit": unit}},
            "targets": [{"expr": expression}],
        }
    ]


RIGHT = [
    figure_of("longest_s", entity=Entity("longest", "longest", "s", device_class="duration")),
    figure_of("bias", AxisStats, entity=Entity("bias", "bias")),
    figure_of("longest_us", page=Row("link", "longest", lambda us: f"{us / 1000:.2f} ms")),
    figure_of("longest_s", page=Row("link", "longest", duration)),
    figure_of("thrown_bytes", page=loss("link", "bytes thrown away")),
]


@pytest.mark.parametrize("figure", RIGHT, ids=lambda one: one.field)
def test_a_right_unit_is_accepted(figure: Figure) -> None:
    assert amiss(figure, []) == []


WRONG = [
    (figure_of("longest_s", entity=Entity("longest", "longest", device_class="duration")), "unit='s'"),
    (figure_of("longest_s", entity=Entity("longest", "longest", "s")), "device_class='duration'"),
    (figure_of("rate_hz", entity=Entity("rate", "rate", "hz", device_class="frequency")), "unit='Hz'"),
    (figure_of("chip_c", entity=Entity("chip", "chip", "°C")), "device_class='temperature'"),
    (figure_of("longest_s", page=Row("link", "longest")), "without a unit"),
    (figure_of("longest_s", page=loss("link", "longest")), "without a unit"),
    (figure_of("longest_us", page=Row("link", "longest", lambda us: f"{us} ms")), "'5000 ms'"),
    (figure_of("longest_us", DeviceStatus, metric=gauge("longest_seconds", "A text.")), "factor=1e-06"),
    (figure_of("longest_s", LinkStats, metric=gauge("longest", "A text.")), "end in _seconds"),
    (figure_of("thrown_bytes", LinkStats, metric=counter("thrown", "A text.")), "end in _bytes"),
]


@pytest.mark.parametrize(("figure", "words"), WRONG)
def test_a_wrong_unit_is_named(figure: Figure, words: str) -> None:
    (found,) = amiss(figure, [])
    assert words in found


@pytest.mark.parametrize(
    ("expression", "unit", "needed"),
    [
        ('fltea_link_longest_seconds{device=~"$device"}', "short", "s"),
        ('fltea_link_longest_seconds{device=~"$device"}', "s", None),
        ("time() - fltea_link_longest_seconds", "ms", "s"),
        ("rate(fltea_link_longest_seconds[5m])", "s", "percentunit"),
        ("fltea_link_longest_seconds_more", "short", None),
    ],
)
def test_a_panel_has_the_unit_of_its_metric(expression: str, unit: str, needed: str | None) -> None:
    figure = figure_of("longest_s", LinkStats, metric=gauge("longest_seconds", "A text."))
    found = amiss(figure, panel_of(expression, unit))
    assert [f"needs the unit {needed!r}" in one for one in found] == ([True] if needed else [])
