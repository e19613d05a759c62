"""Make families of metrics from records.

Their names follow Prometheus' rules: base units, `_total` for counters.

The table of figures (`fltea.sinks.figures`) declares which field of a record becomes which metric. For a
value that is unknown or not valid, Prometheus gets no sample, so that a graph shows a gap and not a
meaningless number.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from operator import attrgetter
from typing import Any, NamedTuple

from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric

from fltea.sinks.figures import figure as figures
from fltea.sinks.figures.table import FIGURES

DEVICE, AXIS = ("device",), ("device", "axis")

Labelled = Sequence[tuple[tuple[str, ...], Any]]
"""Pairs: the values of labels, and a record or part of a record whose metrics get these labels."""


class Row(NamedTuple):
    """Declares how a metric is made from a field of a record.

    `of`: the field's name, or a function that computes the value from the record; empty if the field has the
    metric's name. `factor`: factor from the field's unit to the base unit. `key`: if the field is a mapping,
    the name of a label, whose values are the mapping's keys. A field that holds a word counts as the mapping
    {word: 1}.
    """

    make: type[CounterMetricFamily] | type[GaugeMetricFamily]
    name: str
    text: str
    of: str | Callable[[Any], Any] = ""
    factor: float = 1.0
    key: str | None = None


counter, gauge = partial(Row, CounterMetricFamily), partial(Row, GaugeMetricFamily)


def families(
    prefix: str, labels: tuple[str, ...], rows: Sequence[Row], records: Labelled
) -> Iterator[Metric]:
    """Yield the metrics of records of one type. `prefix`: beginning of the metrics' names, after `fltea_`."""
    for row in rows:
        names = labels if row.key is None else (*labels, row.key)
        yield filled(row.make(f"fltea_{prefix}{row.name}", row.text, labels=names), _values(row, records))


def filled(
    family: CounterMetricFamily | GaugeMetricFamily, values: Sequence[tuple[tuple[str, ...], float]]
) -> Metric:
    """Add values to a metric, and return the metric.

    `values`: for each value to add, the values of its labels and the number itself.
    """
    for names, value in values:
        family.add_metric(names, value)
    return family


def _values(row: Row, records: Labelled) -> list[tuple[tuple[str, ...], float]]:
    get = row.of if callable(row.of) else attrgetter(row.of or row.name)
    found = []
    for names, record in records:
        value = get(record)
        if isinstance(value, str):
            value = {value: 1.0}
        if isinstance(value, Mapping):
            found += [((*names, str(key)), one) for key, one in value.items()]
        elif value is not None:
            found.append((names, value * row.factor))
    return found


def of_kind(kind: type) -> tuple[Row, ...]:
    """Return the metrics that are declared for figures in records, or in parts of records, of a type."""
    return tuple(
        Row(
            CounterMetricFamily if metric.kind == "counter" else GaugeMetricFamily,
            metric.name,
            metric.text,
            partial(_value, field=figure.field, convert=metric.convert),
            metric.factor,
            metric.key,
        )
        for figure in FIGURES
        if figure.kind is kind and isinstance(metric := figure.metric, figures.Metric)
    )


def _value(record: Any, field: str, convert: Callable[[Any], float] | None) -> Any:
    value = figures.lookup(record, field)
    return value if convert is None or value is None else convert(value)
