"""Tests that the dashboard for Grafana queries only metrics that exist."""

import json
import re
from collections.abc import Iterator
from typing import Any

import pytest
from fltea.sinks.metrics.families import Families
from prometheus_client import CollectorRegistry, ProcessCollector

from tests.rig.host_support import ROOT

TEXT = (ROOT / "tools/deploy/grafana/fltea.json").read_text(encoding="utf-8")
BOARD = json.loads(TEXT)
SUFFIXES = {
    "counter": ("_total",),
    "gauge": ("",),
    "info": ("_info",),
    "histogram": ("_bucket", "_sum", "_count"),
}
OF_PROMETHEUS = {"le", "job", "instance"}
"""Labels that Prometheus, or its text format, adds to metrics."""


def metrics() -> dict[str, set[str]]:
    """Return the labels of every metric, by the name of its time series.

    The names and labels of the metrics are known even if there is no device.
    """
    ours = list(Families({}, {}, list).collect())
    process = list(ProcessCollector(registry=CollectorRegistry()).collect())
    return {
        family.name + suffix: {*getattr(family, "_labelnames", ()), *OF_PROMETHEUS}
        for family in ours + process
        for suffix in SUFFIXES[family.type]
    }


def expressions(part: Any) -> Iterator[str]:
    """Yield every query in panels and in variables of the dashboard."""
    if isinstance(part, dict):
        for key, value in part.items():
            if key in ("expr", "definition") and isinstance(value, str):
                yield value
            yield from expressions(value)
    elif isinstance(part, list):
        for value in part:
            yield from expressions(value)


def unknown(expression: str, known: dict[str, set[str]]) -> set[str]:
    """Return the names of metrics and labels in a query that do not exist."""
    names = set(re.findall(r"\b(?:fltea|process)_\w+", expression))
    there = set().union(*(known.get(name, set()) for name in names))
    labels = set(re.findall(r"(\w+)\s*(?:=~|!=|!~|=)\s*\"", expression))
    labels |= {
        word.strip() for group in re.findall(r"\bby \(([^)]*)\)", expression) for word in group.split(",")
    }
    labels |= set(re.findall(r"label_values\(\w+, (\w+)\)", expression))
    return (names - set(known)) | (labels - there if names <= set(known) else set())


def test_every_expression_asks_for_metrics_and_labels_that_there_are() -> None:
    known = metrics()
    asked = list(expressions(BOARD))
    assert len(asked) > 30
    assert all(re.search(r"\b(fltea|process)_", one) for one in asked)
    assert {one: missing for one in asked if (missing := unknown(one, known))} == {}


@pytest.mark.parametrize(
    ("expression", "missing"),
    [
        ("rate(fltea_gaps[5m])", {"fltea_gaps"}),
        ('fltea_gaps_total{axis="x"}', {"axis"}),
        ("sum by (le, kind) (fltea_output_latency_seconds_bucket)", {"kind"}),
        ("fltea_fit_alpha", set()),
    ],
)
def test_what_is_not_there_is_seen(expression: str, missing: set[str]) -> None:
    assert unknown(expression, metrics()) == missing


def test_legends_name_labels_that_the_metric_has() -> None:
    known = metrics()
    for panel in BOARD["panels"]:
        for target in panel.get("targets", ()):
            names = re.findall(r"\b(?:fltea|process)_\w+", target["expr"])
            there = set().union(*(known[name] for name in names))
            assert set(re.findall(r"{{(\w+)}}", target["legendFormat"])) <= there, target["expr"]


def test_panels_have_their_own_numbers_and_do_not_overlap() -> None:
    panels = BOARD["panels"]
    assert len({panel["id"] for panel in panels}) == len(panels)
    taken: set[tuple[int, int]] = set()
    for panel in panels:
        at = panel["gridPos"]
        cells = {(at["x"] + i, at["y"] + j) for i in range(at["w"]) for j in range(at["h"])}
        assert at["x"] + at["w"] <= 24
        assert not cells & taken, panel["title"]
        taken |= cells


def test_the_bias_and_the_heading_follow_the_verdict() -> None:
    titles = [panel["title"] for panel in BOARD["panels"]]
    after = titles.index("Verdict") + 1
    assert [title.split()[0] for title in titles[after : after + 2]] == ["Bias", "Heading"]


def test_the_file_is_written_so_that_a_change_is_a_small_difference() -> None:
    assert json.dumps(BOARD, indent=1) + "\n" == TEXT, (
        "tools/deploy/grafana/fltea.json: write it by json.dumps(…, indent=1), in ASCII, with a line end"
    )
