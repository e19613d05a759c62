"""Records of one device whose numbers are all known, and the text that each output makes of them."""

import io
import json
import types
from collections.abc import Callable, Iterator, Sequence
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

import jinja2
import msgspec
from fltea.records.clock import host_ns
from fltea.records.device_fit import DeviceAxisFit
from fltea.records.estimate import DeviceAxisEstimate
from fltea.records.fit import AxisFit, Until
from fltea.records.ports import Latency
from fltea.records.records import (
    DeviceEstimates,
    DeviceFits,
    Epoch,
    Estimate,
    EstimatorInfo,
    Fit,
    Sample,
    Stats,
)
from fltea.records.stats import OutputStats
from fltea.settings.estimator import EstimateOn
from fltea.sinks.figures.figure import ROOTS, Root
from fltea.sinks.metrics.families import Families, Newest
from fltea.sinks.mqtt.discovery import discovery
from fltea.sinks.page import facts
from fltea.sinks.page.history import DeviceHistory
from fltea.sinks.page.state import PARTS, View
from fltea.sinks.table import TableSink
from msgspec.structs import replace
from prometheus_client import CollectorRegistry, generate_latest
from rich.console import Console

from tests.rig.dashboard_support import BOARD, OWN, told
from tests.rig.example_records import GOOD, STATS, axis_estimate
from tests.rig.fit_support import FRACTIONAL, with_curves
from tests.rig.host_support import hello

KEYS: dict[str, Any] = {"str": "order_box", "int": 60}
"""Two keys, by their type. One of them is put into each mapping that the example records leave empty."""


def parts_of(hint: Any) -> Iterator[Any]:
    """Yield the types in a type hint: each type of a union, and of a mapping the types of its values."""
    if get_origin(hint) in (types.UnionType, Union):
        for one in get_args(hint):
            yield from parts_of(one)
    elif get_origin(hint) is dict:
        yield from parts_of(get_args(hint)[1])
    else:
        yield hint


def completed(struct: Any) -> Any:
    """Return a record in which every number, object and mapping has a value; values already set are kept."""
    found = {}
    for name, hint in get_type_hints(type(struct)).items():
        value = getattr(struct, name)
        if value is None or value == {}:
            value = _example(hint)
        if isinstance(value, dict):
            value = {key: completed(one) if _is_struct(one) else one for key, one in value.items()}
        found[name] = completed(value) if _is_struct(value) else value
    return replace(struct, **found)


def _is_struct(value: Any) -> bool:
    return isinstance(value, msgspec.Struct)


def _example(hint: Any) -> Any:
    of = next(one for one in [*_members(hint)] if one is not types.NoneType)
    if get_origin(of) is dict:
        key, value = get_args(of)
        return {KEYS[key.__name__]: _example(value)}
    if get_origin(of) is Literal:
        return get_args(of)[0]
    if get_origin(of) is list:
        return []
    if issubclass(of, msgspec.Struct):
        return of(**{name: _example(one) for name, one in get_type_hints(of).items()})
    return {int: 7, float: 0.75, bool: True, str: "a"}[of]


def _members(hint: Any) -> Sequence[Any]:
    return get_args(hint) if get_origin(hint) in (types.UnionType, Union) else (hint,)


OTHER_WORDS = {"not rejected": "rejected", "fractional": "white", "user": "watchdog", "white": "walks"}
"""For each word that occurs in the example records, another valid word."""


def changed(value: Any, path: Sequence[str]) -> Any:
    """Return a copy of a record in which one value differs. `path`: names of the fields that lead to it.

    If one of these fields is a mapping, the value differs under each of its keys.
    """
    if isinstance(value, dict):
        return {key: changed(one, path) for key, one in value.items()}
    if path:
        return replace(value, **{path[0]: changed(getattr(value, path[0]), path[1:])})
    match value:
        case bool():
            return not value
        case int():
            return 3 * value + 1001
        case float():
            return 1.5 * value + 0.25
        case str():
            return OTHER_WORDS.get(value, f"not {value}")
    raise TypeError(value)


AXIS = "gyro_x"
PLACE: dict[str, Any] = {"seq": 701, "epoch": 3, "device_us": 7_010_000, "host_ns": 7_250_000_000}
HELLO = hello(device="due", sensor="MPU-9250", gyro_range_dps=2000.0, firmware_version="0.1.0")
SETTINGS = EstimatorInfo("joint", "both", "compressed", "consistent", 9, 9, (0.0,), ())
EPOCH = Epoch(3, "gap", 1, 8, 8, 7, SETTINGS, device="due")
SAMPLE = Sample(**PLACE, gyro_dps=(0.5, 0.25, 0.125), temperature_c=21.5, device="due")
DEVICE_ESTIMATOR = replace(OWN, restarts={AXIS: 2}, interventions={AXIS: {"order_box": 3}})
EVERY_STATS: Stats = completed(
    replace(
        STATS,
        axes={AXIS: STATS.axes[AXIS]},
        board=replace(
            BOARD, i2c_errors=11, bus_recoveries=12, sensor_reinits=14, overruns=15, dropped_frames=16
        ),
        outputs={"mqtt": OutputStats(written=10, dropped=7, queued=300)},
        device_estimator=replace(DEVICE_ESTIMATOR, startup_remaining=40),
    )
)
EVERY_ESTIMATE: Estimate = completed(Estimate(**PLACE, variant="joint", axes={AXIS: GOOD}, device="due"))
FRACTIONAL_FIT: AxisFit = completed(
    replace(with_curves(FRACTIONAL), left_out={"lost": 12}, breaks={"gaps": 1, "steps": 2}, odds=0.75)
)
EVERY_FIT = Fit(**PLACE, samples=702, axes={AXIS: FRACTIONAL_FIT}, device="due")
FILTERS = axis_estimate(0.4, 0.03, -2.0, 0.25, 0.12, -0.05, True, True).fltea
OF_DEVICE = replace(completed(DeviceAxisEstimate(fltea=FILTERS, age=7)), why_not=None, tracker_bias_std=0.01)
EVERY_DEVICE_ESTIMATE = DeviceEstimates(
    **PLACE, variant="joint", axes={AXIS: OF_DEVICE}, comparable=True, device="due"
)
DEVICE_FIT = DeviceAxisFit(
    verdict="fractional",
    number=3,
    age=701,
    samples=640,
    ordinates=99.0,
    evaluations=230,
    searched=True,
    tuned=True,
    bins_left_out=True,
    ratio_white=40.0,
    ratio_relaxation=9.5,
)
EVERY_DEVICE_FIT = DeviceFits(**PLACE, axes={AXIS: completed(DEVICE_FIT)}, device="due")
Records = dict[type, Any]

EVERYTHING: Records = {
    type(record): record
    for record in (
        HELLO,
        EPOCH,
        EVERY_STATS,
        SAMPLE,
        EVERY_FIT,
        EVERY_ESTIMATE,
        EVERY_DEVICE_ESTIMATE,
        EVERY_DEVICE_FIT,
    )
}
"""One record of each kind that has figures, in the order in which a device publishes them."""

UNDECIDED = {AXIS: replace(FRACTIONAL_FIT, verdict="undecided", until_s=Until(0.05, 440.0))}
EXAMPLES = (EVERYTHING, {**EVERYTHING, Fit: replace(EVERY_FIT, axes=UNDECIDED)})
"""Two sets of records. If an output gets both, it shows every figure that it can show."""


def with_changed(records: Records, kind: type, path: str) -> Records:
    """Return the records with one number changed, for all axes and outputs."""
    root = ROOTS.get(kind, Root(kind, "", ""))
    fields = f"{root.path}.{path}".strip(".").split(".")
    return {**records, root.record: changed(records[root.record], fields)}


def history(records: Records, who: EstimateOn = "both") -> DeviceHistory:
    """Return the live page's history of a device after these records."""
    return told(list(records.values()), who=who)


DRAWN = ("now", "spectra", "curves")
"""Parts of the live page that are not compared. "spectra" and "curves" only draw figures that other parts
contain, and "now" depends on the time of the request.
"""


def page(records: Records) -> str:
    """Return all compared parts of the live page, with one axis open."""
    found = history(records)
    view = View("due", AXIS, 0)
    parts = {name: make(found, view) for name, make in PARTS.items() if name not in DRAWN}
    return json.dumps([parts, facts.now(found, found.heard_ns or 0)], ensure_ascii=False)


def terminal(records: Records) -> str:
    """Return the table that `fltea` prints in a wide terminal."""
    console = Console(file=io.StringIO(), width=200, color_system=None)
    sink = TableSink(console)
    for record in records.values():
        sink.write(record)
    sink.close()
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue()


class _Held(Newest):
    sample: Sample | None = None

    def newest_sample(self) -> Sample | None:
        return self.sample


class _Output:
    name = "mqtt"

    def __init__(self, found: OutputStats) -> None:
        self._found, self.latency = found, Latency()

    def stats(self) -> OutputStats:
        return self._found


def metrics(records: Records) -> str:
    """Return the text that Prometheus reads for these records."""
    newest = _Held()
    newest.hello, newest.stats, newest.fit = records[type(HELLO)], records[Stats], records[Fit]
    newest.sample = records[Sample]
    newest.estimate, newest.estimate_ns = records.get(Estimate), host_ns()
    newest.device_estimate, newest.device_estimate_ns = records[DeviceEstimates], host_ns()
    newest.device_fits = records[DeviceFits].axes
    outputs = [("due", _Output(one)) for one in records[Stats].outputs.values()]
    registry = CollectorRegistry()
    registry.register(Families({"due": newest}, {}, lambda: outputs))
    return generate_latest(registry).decode()


def home_assistant(records: Records) -> str:
    """Return the states and attributes that Home Assistant makes of the published records."""
    stats = records[Stats]
    payloads = {
        f"fltea/due/{record.__struct_config__.tag}": json.loads(msgspec.json.encode(record))
        for record in records.values()
    }
    config = discovery("fltea/due", "due", records[type(HELLO)], stats.axes)
    found = {}
    for key, one in config["components"].items():
        for template, topic in (
            ("value_template", "state_topic"),
            ("json_attributes_template", "json_attributes_topic"),
        ):
            if template in one:
                found[key, template] = _render(one[template], payloads[one[topic]])
    return str(found)


def _render(template: str, payload: Any) -> str:
    return str(jinja2.Template(template).render(value_json=payload))


PLACES: dict[str, tuple[Callable[[Records], str], str]] = {
    "metric": (metrics, "host/fltea/sinks/metrics/families.py"),
    "page": (page, "host/fltea/sinks/page/facts.py"),
    "terminal": (terminal, "host/fltea/sinks/table.py"),
    "home_assistant": (home_assistant, "host/fltea/sinks/mqtt/discovery.py"),
}
"""For each place where figures are shown, the function that returns everything that this place shows of given
records, and the source file that shows it.
"""
