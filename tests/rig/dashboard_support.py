"""Make records in the form of a running pipeline's, for the tests of the live page.

The results of live fits in these records are invented (tests/rig/fit_support.py).
"""

import functools
import json
from collections.abc import Callable, Iterable
from typing import Any, ParamSpec

import msgspec
import numpy as np
from fltea.records.estimate import AxisEstimate, DeviceAxisEstimate, FlteaEstimate, WhyNot
from fltea.records.events import Break, Event, RawSample
from fltea.records.ports import Recorder
from fltea.records.records import AXES, AnyRecord, DeviceEstimates, Epoch, Estimate, EstimatorInfo, Stats
from fltea.records.stats import DeviceEstimatorStats, DeviceStatus
from fltea.settings.config import Config
from fltea.settings.estimator import EstimateOn, EstimatorConfig
from fltea.settings.live import LiveConfig
from fltea.sinks.page.history import DeviceHistory
from fltea.sinks.page.state import State
from fltea.sinks.page.tiers import Cursor
from fltea.sources.synthetic import SyntheticSource
from fltea.stream.pipeline import Pipeline

from tests.rig.blocks import as_block, records_of
from tests.rig.device_stream_support import Source
from tests.rig.host_support import hello

P = ParamSpec("P")

QUICK = EstimatorConfig(startup=50, window=200)
WITHOUT = LiveConfig(on=False)
BOARD = DeviceStatus(0, 0, 0, 0, 0, "user", cpu_share_percent=16.75, longest_step_us=8210)
OWN = DeviceEstimatorStats(
    begun=1,
    startup_remaining=0,
    every=10,
    queue=0,
    skipped=0,
    longest_axis_us=2412,
    estimates=100,
    lost=0,
    unplaced=0,
    restarts=dict.fromkeys(AXES, 0),
    interventions={},
)


def remembered(make: Callable[P, list[AnyRecord]]) -> Callable[P, list[AnyRecord]]:
    """Cache the records made from the same arguments; each caller gets its own list."""
    made: dict[str, list[AnyRecord]] = {}

    @functools.wraps(make)
    def give(*arguments: P.args, **named: P.kwargs) -> list[AnyRecord]:
        key = repr((arguments, named))
        if key not in made:
            made[key] = make(*arguments, **named)
        return list(made[key])

    return give


@remembered
def records(query: str, config: EstimatorConfig = QUICK) -> list[AnyRecord]:
    """Return the records that the pipeline publishes for synthetic noise."""
    source = SyntheticSource(query, realtime=False)
    pipeline = Pipeline(source, Config(name="due", estimator=config, live=WITHOUT))
    found = records_of(item for event in source.events() for item in pipeline.feed(event))
    return [*found, pipeline.stats()]


@remembered
def with_breaks(
    lengths: list[int], reason: str = "restart", config: EstimatorConfig = QUICK, accel: bool = False
) -> list[AnyRecord]:
    """Return records of several epochs, between which the filters restart.

    The noise is made of the low bits of a counter, plus an offset.
    """
    events: list[Event] = [hello()]
    k = 0
    for length in lengths:
        for _ in range(length):
            raw = tuple(20 + (k * factor) % 7 for factor in (3, 5, 8))
            force = (16384 + k % 5, k % 3, -k % 4) if accel else None
            sample = RawSample(k % 65536, k * 10_000 % 2**32, k * 10_000_000, raw, force, 0.0)
            events.append(as_block(sample))
            k += 1
        events.append(Break(reason, k * 10_000_000))  # type: ignore[arg-type]
    channels = ["gyro_x", "accel_x", "accel_y"] if accel else None
    pipeline = Pipeline(Source(), Config(name="due", estimator=config, live=WITHOUT, channels=channels))  # type: ignore[arg-type]
    found = records_of(item for event in events for item in pipeline.feed(event))
    return [*found, pipeline.stats()]


def told(*groups: list[AnyRecord], who: EstimateOn = "host") -> DeviceHistory:
    """Return a history of a device, as the live page keeps it, after it has received the records of all lists
    in `groups`.

    `who`: where the gyroscope's estimates are computed.
    """
    history = DeviceHistory("due", who)
    for group in groups:
        for record in group:
            history.write(record)
    return history


def columns(history: DeviceHistory, axis: str, window: int = 0) -> dict[str, np.ndarray]:
    """Return the columns of data that the live page's diagrams of one axis show, for a time window."""
    values = history.course.read(window, Cursor()).values
    return {name: values[:, place] for name, place in history.course.columns(axis).items()}


class Reader:
    """Content of a browser page after the updates that it has received.

    `parts`: content of each part of the page, by the part's name.
    """

    def __init__(self, *histories: DeviceHistory, recorder: Recorder | None = None) -> None:
        self.state = State({history.name: history for history in histories}, recorder)
        self.parts: dict[str, Any] = {}
        self._checksums: dict[str, str] = {}
        self.cursor = ""

    def read(
        self, device: str = "", axis: str = "", window: int = 0, parts: str = "now axes axis curves own"
    ) -> dict[str, Any]:
        """Return the next update that the program sends to the page, and apply it to the parts that this page
        already has.

        The update is sent as if a second had passed since the last one.
        """
        self.state._kept.clear()
        had = {name: self._checksums.get(name, "") for name in parts.split()}
        view = self.state.view(device, axis, window)
        found: dict[str, Any] = json.loads(self.state.read(view, had, self.cursor))
        for name, (checksum, content) in found["parts"].items():
            self._checksums[name], self.parts[name] = checksum, content
        self.cursor = found.get("cursor", self.cursor)
        return found


def alone(found: Iterable[AnyRecord], every: int = 10, late: int = 0, **own: Any) -> list[AnyRecord]:
    """Return the records with the host's estimates replaced by estimates that the device computed.

    Only samples whose number is a multiple of `every` have an estimate. It comes `late` samples after its
    sample.
    """
    made: list[AnyRecord] = []
    waiting: list[Estimate] = []
    for record in found:
        match record:
            case Estimate():
                if record.seq % every == 0:
                    waiting.append(record)
                if waiting and waiting[0].seq <= record.seq - late:
                    made.append(waiting.pop(0))
            case _:
                made.append(_with_device(record, "device", {"every": every, **own}))
    return made


def both(
    found: Iterable[AnyRecord],
    apart: Callable[[int], float | None] = lambda seq: 1e-7,
    every: int = 10,
    why_not: WhyNot = "other_settings",
    **own: Any,
) -> list[AnyRecord]:
    """Return the records with additional estimates by the device.

    For each sample, the device's α and f differ from the host's by `apart(sequence number)`.

    `apart`: returns None for a sample whose estimates cannot be compared. `why_not`: reason given for such a
    sample.
    """
    made: list[AnyRecord] = []
    first: int | None = None
    for record in found:
        made.append(_with_device(record, "both", {"every": every, **own}))
        if not isinstance(record, Estimate):
            continue
        first = record.seq if first is None else first
        if record.seq % every == 0:
            d, age = apart(record.seq), record.seq - first + 1
            axes = {axis: _of_device(e, age, d, why_not) for axis, e in record.axes.items()}
            place = record.seq, record.epoch, record.device_us, record.host_ns, record.variant
            made.append(DeviceEstimates(*place, axes, d is not None, device=record.device))
    return made


def _of_device(e: AxisEstimate, age: int, apart: float | None, why_not: WhyNot) -> DeviceAxisEstimate:
    own = e.fltea
    assert own.alpha is not None
    assert own.f is not None
    d = apart or 0.0
    numbers = own.alpha + d, own.alpha_std, own.f - 3 * d, own.f_std, own.state, own.innovation
    if apart is None:
        return DeviceAxisEstimate(fltea=FlteaEstimate(*numbers, True), age=age, why_not=why_not)
    differences = {"alpha_difference": d, "f_difference": -3 * d, "state_difference": d / 2}
    return DeviceAxisEstimate(fltea=FlteaEstimate(*numbers, True), age=age, **differences)


def _with_device(record: AnyRecord, estimate_on: str, own: dict[str, Any]) -> AnyRecord:
    match record:
        case Epoch(estimator=EstimatorInfo() as info):
            info = msgspec.structs.replace(info, estimate_on=estimate_on, window=0)
            return msgspec.structs.replace(record, estimator=info)
        case Stats():
            estimator = msgspec.structs.replace(OWN, **own)
            return msgspec.structs.replace(record, board=BOARD, device_estimator=estimator)
    return record
