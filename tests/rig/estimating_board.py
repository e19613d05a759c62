"""Simulate a board that computes estimates.

The functions yield the board's messages in order, and the events that the host reads from these messages.
"""

from collections.abc import Callable, Iterable, Iterator
from typing import Any

import msgspec
import numpy as np
from fltea.records.estimate import FlteaEstimate
from fltea.records.events import Chunk, Event, Opened, RawSample
from fltea.records.records import AnyRecord, DeviceEstimates, Estimate
from fltea.settings.config import load_config
from fltea.sources.wire_events import WireEvents
from fltea.stream.pipeline import Pipeline
from fltea.wire import layout as wire
from fltea.wire.message_events import axis_event, estimator_event, hello_event

from tests.rig.blocks import as_block, of, records_of
from tests.rig.device_stream_support import Source
from tests.rig.host_support import WIRE_HELLO
from tools.made_up_board import MadeUpBoard, Sent
from tools.own_estimator import JOINT, OwnEstimator

ESTIMATOR = JOINT._replace(startup=30, remaining=30, gate=8.0)
"""Settings of the board's estimator.

Two differ from the host's: the length of the start-up window, and `gate`, the guard's limit of innovations.
"""
STARTUP = ESTIMATOR.startup

LSB_PER_DPS = 16.4
PERIOD_US = 10_000
START_NS = 10**9
AXES = ("gyro_x", "gyro_y", "gyro_z")


def noise(n: int, seed: int = 1) -> list[tuple[int, ...]]:
    """Return counts of three axes at rest: noise with an offset."""
    counts = np.rint(np.random.default_rng(seed).normal((3, -40, 0), 2.5, (n, 3)))
    return [tuple(map(int, row)) for row in counts]


class Board(MadeUpBoard):
    """A simulated board that sends the messages HELLO and ESTIMATOR (its settings) every 100 samples, and
    computes an estimate after each sample.

    `late`: number of samples by which the board sends an estimate later than its sample. `stated`: the
    settings in the message ESTIMATOR; None if the board computes no estimates. `first`: sequence number of
    the first sample.
    """

    def __init__(
        self,
        stated: wire.Estimator | None = ESTIMATOR,
        *,
        hello: wire.Hello = WIRE_HELLO,
        late: int = 0,
        first: int = 0,
    ) -> None:
        own = None if stated is None else OwnEstimator(stated, LSB_PER_DPS, PERIOD_US * 1e-6)
        super().__init__(hello, first=first, own=own, own_late=late)

    def run(self, counts: Iterable[tuple[int, ...] | None]) -> Iterator[Sent]:
        """Process samples and yield the messages that the board sends.

        None among the counts stands for a sample that the board misses.
        """
        return (sent for row in counts for sent in self.tick(row))


def said(at: int, message: wire.Message, sequence: int = 0) -> Sent:
    """Return a message with the time at which the board sends it: `at` sampling periods after its start."""
    return Sent(at, message, sequence, at * PERIOD_US)


def chunks(sent: Iterable[Sent], start: int = 0) -> Iterator[Chunk]:
    """Yield each sent frame as a chunk of bytes with an arrival time.

    `start`: number of sampling periods by which all arrival times are later.
    """
    for one in sent:
        yield Chunk(one.frame, START_NS + (start + one.instant) * PERIOD_US * 1000, 0)


def events(sent: Iterable[Sent], link: WireEvents | None = None, start: int = 0) -> Iterator[Event]:
    """Yield the events that the host reads from these frames."""
    if link is None:
        link = WireEvents("board")
        yield from link.feed(Opened(START_NS, 0), START_NS)
    for chunk in chunks(sent, start):
        yield from link.feed(chunk, chunk.host_ns)


def exact(sent: Iterable[Sent]) -> Iterator[Event]:
    """Yield the events of these frames. The estimates in the events keep double precision, which frames would
    round to single precision.
    """
    for at, message, sequence, device_us in sent:
        host_ns = at * 10_000_000
        match message:
            case wire.Hello():
                yield hello_event(message, "test", host_ns)
            case wire.Estimator():
                yield estimator_event(message, host_ns)
            case wire.Estimate():
                yield axis_event(message, sequence, host_ns)
            case wire.Sample():
                yield as_block(RawSample(sequence, device_us, host_ns, message[:3], message[3:6]))


def changed(
    sent: Iterable[Sent],
    kind: type[wire.Message],
    which: Callable[[Sent], bool] = lambda one: True,
    **changes: object,
) -> Iterator[Sent]:
    """Replace fields in the messages of one kind, or in those of them for which `which` returns True."""
    for one in sent:
        is_meant = isinstance(one.message, kind) and which(one)
        yield one._replace(message=one.message._replace(**changes)) if is_meant else one


def pipeline(who: str, **settings: object) -> Pipeline:
    """Return a pipeline that takes estimates from `who`: "host", "device" or "both".

    An argument such as `estimator__R` changes the setting estimator.R.
    """
    changes = {"estimator__estimate_on": who} | settings
    return Pipeline(Source(), load_config(None, {k.replace("__", "."): v for k, v in changes.items()}))


def feed(walk: Pipeline, found: Iterable[Event]) -> list[AnyRecord]:
    """Return the records for these events, after checking that JSON encodes and decodes them unchanged."""
    records = records_of(item for event in found for item in walk.feed(event))
    text = msgspec.json.encode(records)
    assert b"NaN" not in text
    assert msgspec.json.decode(text, type=list[AnyRecord]) == records
    return records


def estimates_of(who: str, records: Iterable[AnyRecord]) -> list[Any]:
    """Return the records that hold the device's estimates.

    If only the device estimates (`who` is "device"), these are of type `Estimate`, otherwise of type
    `DeviceEstimates`.
    """
    return of(Estimate if who == "device" else DeviceEstimates, records)


def of_filters(e: Estimate | DeviceEstimates) -> list[FlteaEstimate]:
    """Return the estimates that the board's filters made for one sample, one for each axis."""
    return [a.fltea for a in e.axes.values()]


def reasons(compared: Iterable[DeviceEstimates], *axes: str) -> set[str | None]:
    """Return the reasons why estimates of the device for `axes` (by default all axes) are not compared with
    the host's.
    """
    return {a.why_not for e in compared for name, a in e.axes.items() if name in (axes or AXES)}
