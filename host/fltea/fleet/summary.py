"""Summaries of the fleet: counts, a table, distributions, and values that differ between sensors."""

import math
import re
from collections import Counter
from typing import Any, Literal, NamedTuple

import msgspec
import numpy as np

from fltea.fleet.figures import QUANTITIES, SHOWN, Figure, Quantity
from fltea.fleet.outliers import LEVEL, Fleet, comparisons_of, judge
from fltea.fleet.roll import SILENT_S, Axis, Roll, Sensor
from fltea.records.plus_minus import NORMAL_95

SOME = 20
"""Largest number of names that a summary lists."""

Group = tuple[str, str, str]
"""A group: kind of sensor, axis, and quantity. The values of all sensors in one group are compared."""


class Oddity(msgspec.Struct, frozen=True):
    """A value of an axis that differs from the values of the other sensors of its kind.

    `middle`: usual value of the kind. `spread`: standard deviation between sensors, or a factor for
    quantities that are compared by ratios. `times`: distance from `middle`, in standard deviations. `p`:
    p-value of this one comparison.
    """

    device_id: str
    axis: str
    quantity: str
    value: float
    low: float
    high: float
    middle: float
    spread: float
    times: float
    p: float
    kind: str
    unit: str

    @property
    def key(self) -> tuple[str, str, str]:
        """Device, axis and quantity of the value."""
        return self.device_id, self.axis, self.quantity

    @property
    def text(self) -> str:
        """Text that describes the difference to the user."""
        side = "above" if self.value > self.middle else "below"
        return (
            f"{self.device_id} {self.axis}: {self.quantity} {self.value:.4g} {self.unit} "
            f"({self.low:.4g} to {self.high:.4g}) is {abs(self.times):.1f} deviations {side} the usual "
            f"{self.middle:.4g} of {self.kind}"
        )


class Comparison(NamedTuple):
    """Result of one comparison of all sensors of the fleet.

    `odd`: the values that differ from those of the other sensors. `usual`: usual value of each group with
    enough sensors, and standard deviation of the sensors in the group. For quantities that are compared by
    ratios, both are those of logarithms. `took_s`: time that the comparison and the update of the alerts took
    [s].
    """

    odd: list[Oddity]
    usual: dict[Group, Fleet]
    took_s: float = 0.0


def compare(roll: Roll, now: float, silent_s: float = SILENT_S, level: float = LEVEL) -> Comparison:
    """Compare every sensor that is neither offline nor silent with the others of its kind."""
    groups: dict[Group, list[tuple[Sensor, Axis, Figure]]] = {}
    for sensor, name, axis in roll.axes():
        if sensor.state(now, silent_s) in ("offline", "silent"):
            continue
        for quantity in QUANTITIES:
            figure = axis.figures.get(quantity.name)
            if figure is not None and (figure.low > 0 or not quantity.log):
                groups.setdefault((sensor.kind, name, quantity.name), []).append((sensor, axis, figure))
    comparisons = comparisons_of([len(members) for members in groups.values()])
    odd, usual = [], {}
    scales = {quantity.name: quantity for quantity in QUANTITIES}
    for group, members in groups.items():
        scale = scales[group[2]]
        figures = np.array([figure for _, _, figure in members])
        columns = (np.log(figures) if scale.log else figures).T
        fleet, outliers = judge(*columns, comparisons=comparisons, level=level)
        if fleet is None:
            continue
        usual[group] = fleet
        for outlier in outliers:
            sensor, axis, figure = members[outlier.place]
            middle, spread = (math.exp(fleet.middle), math.exp(fleet.spread)) if scale.log else fleet[:2]
            odd.append(
                Oddity(
                    sensor.device_id,
                    group[1],
                    scale.name,
                    *figure,
                    middle,
                    spread,
                    outlier.distance,
                    outlier.p,
                    group[0],
                    unit_of(scale, axis.unit),
                )
            )
    odd.sort(key=lambda oddity: -abs(oddity.times))
    return Comparison(odd, usual)


def unit_of(quantity: Quantity, unit: str) -> str:
    """Return the unit of a quantity for an axis whose samples are in `unit`."""
    if quantity.name in ("alpha", "f"):
        return quantity.unit
    return unit + quantity.unit


def counts(roll: Roll, now: float, silent_s: float = SILENT_S) -> dict[str, Any]:
    """Return how many sensors, axes and messages there are.

    The sensors are also counted by state, by kind and by verdict, and the axes by verdict.
    """
    states: Counter[str] = Counter(sensor.state(now, silent_s) for sensor in roll.sensors.values())
    axes: Counter[str] = Counter()
    sensors: Counter[str] = Counter()
    for sensor in roll.sensors.values():
        verdicts = [axis.verdict for axis in sensor.axes.values()]
        axes.update(verdicts)
        sensors.update(set(verdicts) or {"no fit yet"})
    kinds: Counter[str] = Counter(sensor.kind for sensor in roll.sensors.values())
    return {
        "sensors": len(roll.sensors),
        "states": dict(states.most_common()),
        "axes": dict(axes.most_common()),
        "sensors_by_verdict": dict(sensors.most_common()),
        "kinds": dict(kinds.most_common(50)),
        "flooding": roll.flooding()[:SOME],
        "twins": [s.device_id for s in roll.sensors.values() if s.fits.has_twin(now)][:SOME],
        "messages": roll.messages,
        "bytes": roll.bytes,
        "fits": roll.fits,
        "repeated": roll.repeated,
        "bad_messages": dict(roll.bad),
        "candidates": len(roll.candidates),
        "refused": roll.refused,
        "refused_names": list(roll.refused_names),
    }


COLUMNS = (
    "device",
    "kind",
    "state",
    "axis",
    "verdict",
    *(q.name for q in SHOWN),
    "samples",
    "age_s",
    "odd",
)
"""Columns of the table; noise parameters are numbers, and the other columns are texts."""

Row = dict[str, Any]


def rows(roll: Roll, seen: Comparison, now: float, silent_s: float = SILENT_S) -> list[Row]:
    """Return the rows of the table: one for each axis, and one for each sensor without a fit."""
    odd: dict[tuple[str, str], list[str]] = {}
    for one in seen.odd:
        odd.setdefault((one.device_id, one.axis), []).append(one.quantity)
    found = []
    for sensor in roll.sensors.values():
        state = sensor.state(now, silent_s)
        for name, axis in sensor.axes.items() or [("", None)]:
            row: Row = {
                "device": sensor.device_id,
                "kind": sensor.kind,
                "state": state,
                "axis": name,
                "verdict": "no fit yet" if axis is None else axis.verdict,
                "samples": 0 if axis is None else axis.samples,
                "age_s": round(now - (sensor.heard if axis is None else axis.at), 1),
                "odd": ", ".join(odd.get((sensor.device_id, name), [])),
            }
            for quantity in SHOWN:
                figure = None if axis is None else axis.figure(quantity.name)
                row[quantity.name] = None if figure is None else figure.value
                if quantity.name == "bias":
                    row["bias_std"] = None if figure is None else (figure.high - figure.value) / NORMAL_95
            found.append(row)
    return found


_TERM = re.compile(r'(device|kind|state|axis|verdict):(?:"([^"]*)"|(\S+))|(\S+)', re.IGNORECASE)


def table(
    found: list[Row], sort: str, order: Literal["up", "down"], words: str, begin: int, count: int
) -> tuple[int, list[Row]]:
    """Return the number of rows that match `words`, and `count` of these rows from index `begin` on, sorted.

    `state:online` or `verdict:"too few samples"` must match the whole text of that column; other words may be
    anywhere in a row. Rows without a value in the column `sort` come last.
    """
    exact, anywhere = [], []
    for column, quoted, plain, term in _TERM.findall(words):
        if column:
            exact.append((column.lower(), (quoted or plain).lower()))
        else:
            anywhere.append(term.lower())
    chosen = [
        row
        for row in found
        if all(row[column].lower() == entry for column, entry in exact)
        and all(term in _text_of(row) for term in anywhere)
    ]
    known = [row for row in chosen if row[sort] not in (None, "")]
    unknown = [row for row in chosen if row[sort] in (None, "")]
    known.sort(key=lambda row: row[sort], reverse=order == "down")
    return len(chosen), (known + unknown)[begin : begin + count]


def _text_of(row: Row) -> str:
    odd = f"odd {row['odd']}" if row["odd"] else ""
    return f"{row['device']} {row['kind']} {row['state']} {row['axis']} {row['verdict']} {odd}".lower()


def distribution(roll: Roll, seen: Comparison, group: Group) -> dict[str, Any]:
    """Return each sensor's value in one group, and the group's usual value.

    A value that differs from those of the other sensors is marked as odd.
    """
    kind, axis_name, quantity = group
    points: list[dict[str, Any]] = []
    odd = {one.key for one in seen.odd}
    for sensor, name, axis in roll.axes():
        figure = axis.figures.get(quantity)
        if sensor.kind == kind and name == axis_name and figure is not None:
            key = sensor.device_id, name, quantity
            points.append({"device": sensor.device_id, "value": figure.value, "odd": key in odd})
    points.sort(key=lambda point: point["value"])
    return {"points": points, "usual": seen.usual.get(group)}


def groups(seen: Comparison) -> list[Group]:
    """Return the groups of sensors that were large enough to be compared, the largest first."""
    return sorted(seen.usual, key=lambda group: (-seen.usual[group].sensors, group))
