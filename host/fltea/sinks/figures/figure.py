"""Define the declaration of a published figure (a number of a record): its field, and who shows it.

The places where people may see a figure are the Prometheus metrics, the live page, the table in a terminal,
Home Assistant, and the Grafana dashboard. For each place, the declaration says one of three things: the place
shows the figure as the declaration says (`Metric`, `Row`, `Rows`, `Entity`), the place shows the figure in a
layout of its own (`Shown`), or the place does not show the figure (`Hidden`).
"""

import types
from collections.abc import Callable, Iterable, Mapping
from typing import Any, Literal, NamedTuple, get_args, get_type_hints

from fltea.records.device_fit import DeviceAxisFit
from fltea.records.estimate import AxisEstimate, DeviceAxisEstimate
from fltea.records.fit import AxisFit
from fltea.records.records import DeviceEstimates, DeviceFits, Estimate, Fit, Hello, Record, Sample, Stats
from fltea.records.stats import AxisStats, DeviceEstimatorStats, DeviceStatus, LinkStats, OutputStats
from fltea.sinks.words import Level

Cells = list[str]
"""A row of text on the live page: a label, a value, and how severe the value is ("good", "bad" and so on)."""

Section = Literal["link", "own", "axis"]
"""A list of rows on the live page.

"link": about the connection to the device. "own": about the device's own estimator. "axis": about the filters
of an axis.
"""


class Hidden(NamedTuple):
    """Declares that an output, such as the page or the terminal, does not show a figure.

    `why`: the reason, for readers of the source code.
    """

    why: str


class Shown(NamedTuple):
    """Declares that an output shows a figure in its own way. `where`: where in the output it stands."""

    where: str


class Metric(NamedTuple):
    """A metric.

    Its name follows Prometheus' recommendations: base units, and no ending `_total`, which is added to
    counters later.

    `text`: explanation of the metric. `factor`: factor from the field's unit to the base unit. `key`: if the
    field is a mapping, the name of a label, whose values are the mapping's keys. A field that holds a word
    counts as the mapping {word: 1}. `convert`: function that converts the field's value to a number.
    """

    kind: Literal["counter", "gauge"]
    name: str
    text: str
    factor: float = 1.0
    key: str | None = None
    convert: Callable[[Any], float] | None = None


class Seen(NamedTuple):
    """The newest records, from which a section of the live page is made.

    `axis`: name of the axis, for a section about an axis. `estimate`: newest estimate of this axis.
    """

    stats: Stats | None
    hello: Hello | None = None
    axis: str = ""
    estimate: AxisEstimate | None = None

    def record(self, kind: type) -> Any:
        """Return the newest record, or part of a record, of the type `kind`; None if there is none yet."""
        if kind is AxisEstimate:
            return self.estimate
        found = None if self.stats is None else lookup(self.stats, ROOTS[kind].path)
        return found.get(self.axis) if kind is AxisStats and found else found


class Row(NamedTuple):
    """A row of the live page that is made from one figure.

    `text`: function that returns the text for a value. `absent`: text for an unknown value; None leaves the
    row out.
    `level`: function that returns how severe a value is.
    """

    section: Section
    label: str
    text: Callable[[Any], str] = str
    absent: str | None = None
    level: Callable[[Any], Level] = lambda value: "plain"


class Rows(NamedTuple):
    """Rows of the live page that are made from more than one figure's value."""

    section: Section
    make: Callable[[Seen], Iterable[Cells]]


class Entity(NamedTuple):
    """An entity of Home Assistant, which is a sensor of the device or of each axis of the device.

    `key`: end of the entity's identifier. `unit`: unit of the value; `OF_AXIS` stands for the unit of the
    axis. `template`: Home Assistant's expression that extracts the value from the record; empty if the value
    is that of the figure's field. An entity with a template belongs to the device, not to an axis.
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
    """A published figure, and how each place shows it.

    `kind`: type of the record, or of the part of a record, that contains the figure. `field`: path of fields
    from `kind` to the figure.
    """

    kind: type
    field: str
    metric: Metric | Shown | Hidden
    page: Row | Rows | Shown | Hidden
    terminal: Shown | Hidden
    home_assistant: Entity | Shown | Hidden
    grafana: Shown | Hidden

    @property
    def metric_name(self) -> str:
        """Name of the figure's metric as Prometheus stores it; empty if the figure is not a metric."""
        if not isinstance(self.metric, Metric):
            return ""
        ending = "_total" if self.metric.kind == "counter" else ""
        return f"fltea_{ROOTS[self.kind].metrics}{self.metric.name}{ending}"

    @property
    def path(self) -> str:
        """Name of the record, and path of the figure in the record, as the documentation writes them."""
        root = ROOTS[self.kind]
        key = {"axes": ".<axis>", "outputs": ".<output>"}.get(root.path, "")
        return ".".join(
            part for part in (str(root.record.__struct_config__.tag), root.path + key, self.field) if part
        )

    @property
    def places(self) -> list[str]:
        """Names of the places that show the figure, such as "page"; without the Prometheus metrics."""
        where = {
            "page": self.page,
            "terminal": self.terminal,
            "Home Assistant": self.home_assistant,
            "Grafana": self.grafana,
        }
        return [name for name, how in where.items() if not isinstance(how, Hidden)]


class Root(NamedTuple):
    """The place of the objects of a class: the records that contain them, and where in such a record.

    `record`: type of the record. `path`: path of fields from the record to the object; empty if the object is
    the record itself. `metrics`: the names of the metrics begin with `fltea_` and this text.
    """

    record: type[Record]
    path: str
    metrics: str

    @property
    def by_axis(self) -> bool:
        """Whether the record has one part of this type for each axis."""
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
"""All classes whose fields are figures: types of records, and of parts of records. For each class: in which
records its objects are, and where.
"""


def lookup(record: Any, path: str) -> Any:
    """Return the value at a path of fields in a record; None if a part of the path is absent.

    If the path goes through a mapping, return a mapping from the same keys to the values at the rest of the
    path.
    """
    value = record
    while path and value is not None:
        if isinstance(value, Mapping):
            return {key: lookup(one, path) for key, one in value.items()}
        name, _, path = path.partition(".")
        value = getattr(value, name)
    return value


def is_optional(kind: type, field: str) -> bool:
    """Return whether a field may be None in records, or parts of records, of the type `kind`."""
    return types.NoneType in get_args(get_type_hints(kind)[field])


def counter(name: str, text: str, *, factor: float = 1.0, key: str | None = None) -> Metric:
    """Declare a metric that only grows. Prometheus adds the ending `_total` to its name."""
    return Metric("counter", name, text, factor, key)


def gauge(
    name: str,
    text: str,
    *,
    factor: float = 1.0,
    key: str | None = None,
    convert: Callable[[Any], float] | None = None,
) -> Metric:
    """Declare a metric that may rise and fall."""
    return Metric("gauge", name, text, factor, key, convert)


def thousands(value: int) -> str:
    """Return a count as text, with commas between thousands."""
    return f"{value:,}"


def loss(section: Section, label: str, remark: str = "") -> Row:
    """Declare a row of the live page for a count of unwanted events.

    `remark`: text after a count above zero.
    """
    return Row(
        section,
        label,
        lambda count: f"{count:,} ({remark})" if count and remark else f"{count:,}",
        level=lambda count: "bad" if count else "plain",
    )
