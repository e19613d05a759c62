"""Every number of `stats`, `estimate` and `fit` is a metric, or has a reason why it is none."""

import types
from collections.abc import Iterator, Sequence
from typing import Any, Union, get_args, get_origin, get_type_hints

import msgspec
import pytest
from fltea.records.records import AxisEstimate, Stats
from fltea.records.stats import AxisStats, DeviceEstimatorStats, DeviceStatus, LinkStats, OutputStats
from fltea.sinks.metrics import tables
from fltea.sinks.metrics.tables import Row, families

ROWS: dict[type, tuple[Row, ...]] = {
    Stats: (*tables.STATS,),
    LinkStats: tables.LINK,
    AxisStats: tables.AXIS_STATS,
    DeviceStatus: tables.BOARD,
    DeviceEstimatorStats: tables.DEVICE_ESTIMATOR,
    AxisEstimate: tables.ESTIMATE,
    OutputStats: tables.OUTPUTS,
}
ESTIMATE = "it is in the metrics of the newest estimate, which come with every scrape"
FIT = "it is in the metrics of the newest fit"
SETTING = "it is a setting of the program or the device, and no measurement"
PER_SAMPLE = "it changes with every sample, and a scrape would show one of a thousand"
NO_METRIC = {
    "Stats.fit_period_s": SETTING,
    "AxisStats.bias": ESTIMATE,
    "AxisStats.Q_in_use": FIT,
    "AxisStats.R_in_use": FIT,
    "AxisStats.tuned": FIT,
    "AxisStats.tracker.K.value": FIT,
    "AxisStats.tracker.K.low": FIT,
    "AxisStats.tracker.K.high": FIT,
    "AxisStats.tracker.bias": ESTIMATE,
    "AxisStats.tracker.bias_std": ESTIMATE,
    "AxisStats.tracker.moving": ESTIMATE,
    "DeviceEstimatorStats.every": SETTING,
    "DeviceEstimatorStats.fit_every": SETTING,
    "DeviceEstimatorStats.startup_remaining": "it counts down once, in the first seconds",
    "DeviceEstimatorStats.interventions": "the host's guard, with the same rules, is in axis_interventions",
    "DeviceEstimatorStats.restarts": "the host's filters, which see the same samples, are in axis_restarts",
    "DeviceEstimatorStats.longest_slice_us": "longest_axis_seconds bounds it while the device keeps up",
    "AxisEstimate.alpha.value": FIT,
    "AxisEstimate.alpha.low": FIT,
    "AxisEstimate.alpha.high": FIT,
    "AxisEstimate.f.value": FIT,
    "AxisEstimate.f.low": FIT,
    "AxisEstimate.f.high": FIT,
    "AxisEstimate.fltea.state": PER_SAMPLE,
    "AxisEstimate.fltea.innovation": PER_SAMPLE,
    "AxisEstimate.innovation": PER_SAMPLE,
}
"""Numbers without a metric: Class.path, and why."""


class Probe:
    """Stands for a record and notes which of its fields are read."""

    def __init__(self, read: set[str], path: str = "") -> None:
        self._read, self._path = read, path

    def __getattr__(self, name: str) -> Any:
        path = f"{self._path}.{name}".lstrip(".")
        self._read.add(path)
        return Probe(self._read, path)

    def __mul__(self, factor: float) -> float:
        return factor

    def items(self) -> Sequence[tuple[str, "Probe"]]:
        return [("key", self)]

    def __float__(self) -> float:
        return 0.0


def numbers(kind: type[msgspec.Struct], prefix: str = "") -> Iterator[str]:
    """Yield the paths of all numbers of a record, but for those of records that have rows of their own."""
    for name, hint in get_type_hints(kind).items():
        path = f"{prefix}.{name}".lstrip(".")
        for one in parts_of(hint):
            if one in (int, float, bool):
                yield path
            elif isinstance(one, type) and issubclass(one, msgspec.Struct) and one not in ROWS:
                yield from numbers(one, path)


def parts_of(hint: Any) -> Iterator[Any]:
    """Yield the types that a hint consists of; of a mapping those of its values."""
    if get_origin(hint) in (types.UnionType, Union):
        for one in get_args(hint):
            yield from parts_of(one)
    elif get_origin(hint) is dict:
        yield from parts_of(get_args(hint)[1])
    else:
        yield hint


@pytest.mark.parametrize("kind", ROWS, ids=lambda kind: kind.__name__)
def test_each_number_is_a_metric_or_has_a_reason(kind: type[msgspec.Struct]) -> None:
    read: set[str] = set()
    list(families("", ("device",), ROWS[kind], [(("a",), Probe(read))]))
    found = set(numbers(kind))
    excused = {path.partition(".")[2] for path in NO_METRIC if path.startswith(f"{kind.__name__}.")}
    missing = found - read - excused
    assert not missing, (
        f"host/fltea/sinks/metrics/tables.py has no row for {kind.__name__}: {sorted(missing)}"
    )
    assert not excused & read, "these have metrics"
    assert excused <= found, "these are no numbers of the record"
