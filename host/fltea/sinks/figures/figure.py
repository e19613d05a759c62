"""What the declaration of a published figure says: its field, and how each place shows it.

A place is the metrics, the live page, the table of a terminal, Home Assistant, or the Grafana dashboard. It
either makes what it shows of the declaration (`Metric`, `Row`, `Rows`, `Entity`), or it has a layout of its
own (`Shown`), or it does not show the figure, for a reason (`Hidden`).
"""

import types
from collections.abc import Callable, Iterable, Mapping
from typing import Any, Literal, NamedTuple, get_args, get_type_hints

from fltea.records.device_fit import DeviceAxisFit
from fltea.records.fit import AxisFit
from fltea.records.records import (
    AxisEstimate,
    DeviceAxisEstimate,
    DeviceEstimates,
    DeviceFits,
    Estimate,
    Fit,
    Hello,
    Record,
    Sample,
    Stats,
)
from fltea.records.stats import AxisStats, DeviceEstimatorStats, DeviceStatus, LinkStats, OutputStats
from fltea.sinks.words import Level

Cells = list[str]
"""A row of the page: its label, its value, and the level of severity."""

Section = Literal["link", "own", "axis"]
"""A list of rows on the page: the link, the device's own estimator, the filters of an axis."""


class Hidden(NamedTuple):
    """The place does not show the figure. `why`: the reason, for the reader of the declaration."""

    why: str


class Shown(NamedTuple):
    """The place shows the figure in a layout of its own. `where`: what to look at there."""

    where: str


class Metric(NamedTuple):
    """A metric in Prometheus' naming: base units; `_total` of a counter is added to its name.

    `factor`: the base unit's value of one unit of the field. `key`: label of the keys if the field is a
    mapping; a field that is a word counts as a mapping of that word to 1. `convert`: makes a number of the
    field's value.
    """

    kind: Literal["counter", "gauge"]
    name: str
    text: str
    factor: float = 1.0
    key: str | None = None
    convert: Callable[[Any], float] | None = None


class Seen(NamedTuple):
    """What a section of the page is made of. `axis`: name of the axis, with its newest `estimate`."""

    stats: Stats | None
    hello: Hello | None = None
    axis: str = ""
    estimate: AxisEstimate | None = None

    def record(self, kind: type) -> Any:
        """Return the newest record, or part of a record, that has figures of this kind; None if unknown."""
        if kind is AxisEstimate:
            return self.estimate
        found = None if self.stats is None else lookup(self.stats, ROOTS[kind].path)
        return found.get(self.axis) if kind is AxisStats and found else found


class Row(NamedTuple):
    """A row of the page. `absent`: text for an unknown value; None leaves the row out."""

    section: Section
    label: str
    text: Callable[[Any], str] = str
    absent: str | None = None
    level: Callable[[Any], Level] = lambda value: "plain"


class Rows(NamedTuple):
    """Rows of the page that need more than the figure's value."""

    section: Section
    make: Callable[[Seen], Iterable[Cells]]


class Entity(NamedTuple):
    """An entity of Home Assistant: a sensor of the device, or of each axis for figures of axes.

    `key`: end of its identity. `unit`: `OF_AXIS` for the axis's own. `template`: extracts the value from the
    record; empty for the value of the field. An entity with a template is the device's.
    """

    key: str
    title: str
    unit: str | None = None
    state_class: str | None = None
    category: str | None = None
    device_class: str | None = None
    platform: str = "sensor"
    template: str = ""


OF_AXIS = "unit of the axis"


class Figure(NamedTuple):
    """A published figure. `kind`: the record, or part of a record, that has it. `field`: path from there."""

    kind: type
    field: str
    metric: Metric | Shown | Hidden
    page: Row | Rows | Shown | Hidden
    terminal: Shown | Hidden
    home_assistant: Entity | Shown | Hidden
    grafana: Shown | Hidden

    @property
    def metric_name(self) -> str:
        """Name of the metric as Prometheus stores it; empty if the figure is none."""
        if not isinstance(self.metric, Metric):
            return ""
        ending = "_total" if self.metric.kind == "counter" else ""
        return f"fltea_{ROOTS[self.kind].metrics}{self.metric.name}{ending}"

    @property
    def path(self) -> str:
        """Name of the record, and the path of the figure in it as the reference of records has it."""
        root = ROOTS[self.kind]
        key = {"axes": ".<axis>", "outputs": ".<output>"}.get(root.path, "")
        return ".".join(
            part for part in (str(root.record.__struct_config__.tag), root.path + key, self.field) if part
        )

    @property
    def places(self) -> list[str]:
        """The names of the places beside the metrics that show the figure."""
        where = {
            "page": self.page,
            "terminal": self.terminal,
            "Home Assistant": self.home_assistant,
            "Grafana": self.grafana,
        }
        return [name for name, how in where.items() if not isinstance(how, Hidden)]


class Root(NamedTuple):
    """Where a part of a record stands. `metrics`: what its metrics begin with after `fltea_`."""

    record: type[Record]
    path: str
    metrics: str

    @property
    def by_axis(self) -> bool:
        """Whether each axis has such a part."""
        return self.path == "axes"


ROOTS: dict[type, Root] = {
    Stats: Root(Stats, "", ""),
    LinkStats: Root(Stats, "link", "link_"),
    DeviceStatus: Root(Stats, "board", "board_"),
    OutputStats: Root(Stats, "outputs", "output_"),
    DeviceEstimatorStats: Root(Stats, "device_estimator", "device_"),
    AxisStats: Root(Stats, "axes", "axis_"),
    Sample: Root(Sample, "", ""),
    AxisEstimate: Root(Estimate, "axes", "axis_"),
    DeviceAxisEstimate: Root(DeviceEstimates, "axes", "device_axis_"),
    Fit: Root(Fit, "", "fit_"),
    AxisFit: Root(Fit, "axes", "fit_"),
    DeviceAxisFit: Root(DeviceFits, "axes", "device_fit_"),
}
"""The parts of records that have figures."""


def lookup(record: Any, path: str) -> Any:
    """Return the value of a path of fields; None if a part is absent; of a mapping the values by key."""
    value = record
    while path and value is not None:
        if isinstance(value, Mapping):
            return {key: lookup(one, path) for key, one in value.items()}
        name, _, path = path.partition(".")
        value = getattr(value, name)
    return value


def is_optional(kind: type, field: str) -> bool:
    """Return whether the records of a kind may lack an object; `field`: its name."""
    return types.NoneType in get_args(get_type_hints(kind)[field])


def counter(name: str, text: str, *, factor: float = 1.0, key: str | None = None) -> Metric:
    """Declare a metric that only grows; its name gets the ending `_total`."""
    return Metric("counter", name, text, factor, key)


def gauge(
    name: str,
    text: str,
    *,
    factor: float = 1.0,
    key: str | None = None,
    convert: Callable[[Any], float] | None = None,
) -> Metric:
    """Declare a metric that may fall."""
    return Metric("gauge", name, text, factor, key, convert)


def thousands(value: int) -> str:
    """Return a count with commas."""
    return f"{value:,}"


def loss(section: Section, label: str, remark: str = "") -> Row:
    """Declare a row for a count of unwanted events. `remark`: follows a count that is not zero."""
    return Row(
        section,
        label,
        lambda count: f"{count:,} ({remark})" if count and remark else f"{count:,}",
        level=lambda count: "bad" if count else "plain",
    )
