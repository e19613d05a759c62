"""Families of metrics out of rows of labels and values."""

from collections.abc import Sequence

from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric

Rows = list[tuple[tuple[str, ...], float | None]]
"""Values of the labels, and the value; None where it is not known."""


def counter_family(name: str, text: str, labels: Sequence[str], rows: Rows) -> Metric:
    """Return a family of counters, which only grow."""
    return _filled(CounterMetricFamily(name, text, labels=labels), rows)


def gauge_family(name: str, text: str, labels: Sequence[str], rows: Rows) -> Metric:
    """What goes up and down."""
    return _filled(GaugeMetricFamily(name, text, labels=labels), rows)


def _filled(family: CounterMetricFamily | GaugeMetricFamily, rows: Rows) -> Metric:
    for values, value in rows:
        if value is not None:
            family.add_metric(values, value)
    return family
