"""Convert the newest records of all devices into Prometheus metrics at each request."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

from prometheus_client.core import CounterMetricFamily, HistogramMetricFamily, InfoMetricFamily, Metric
from prometheus_client.registry import Collector

from fltea.records.block import Block, Values
from fltea.records.clock import host_ns
from fltea.records.device_fit import DeviceAxisFit
from fltea.records.estimate import AxisEstimate, DeviceAxisEstimate
from fltea.records.fit import AxisFit
from fltea.records.ports import LATENCY_BOUNDS_MS, OutputView
from fltea.records.records import DeviceEstimates, Estimate, Fit, Hello, Sample, Stats
from fltea.records.stats import AxisStats, DeviceEstimatorStats, DeviceStatus, LinkStats, OutputStats
from fltea.records.version import __version__
from fltea.sinks.figures.figure import ROOTS
from fltea.sinks.metrics.tables import AXIS, DEVICE, Labelled, counter, families, filled, of_kind
from fltea.wire import layout as wire

FRESH_NS = 5 * 10**9
"""An estimate is shown only if it arrived at most this long ago [ns]. The device of an older estimate is lost
or has restarted.
"""

LAST = Values(slice(-1, None))
_BOUNDS_S = [repr(bound * 1e-3) for bound in LATENCY_BOUNDS_MS] + ["+Inf"]


MOTIONS = (counter("motions", "Number of times that the sensor has begun to move."),)
"""A counter whose value is in no record. It counts the records `motion` that say that a motion begins."""

FACTS = "source", "device_id", "sensor", "firmware_version", "sampling_mode"
"""Fields of the record `hello` that become labels of one metric."""


@dataclass
class Newest:
    """The newest record of each kind from one device.

    `estimate_ns`: monotonic arrival time of this computer's newest estimate [ns]. `device_estimate_ns`: the
    same for the device's own newest estimate. `motions`: number of motions that have begun.
    """

    hello: Hello | None = None
    stats: Stats | None = None
    block: Block | None = None
    estimate: Estimate | Block | None = None
    estimate_ns: int = 0
    device_estimate: DeviceEstimates | None = None
    device_estimate_ns: int = 0
    device_fits: dict[str, DeviceAxisFit] = field(default_factory=dict)
    fit: Fit | None = None
    motions: int = 0

    def take(self, block: Block) -> None:
        """Remember a block of samples and estimates. Records are made from the block only at a request."""
        self.block = block
        if block.estimates and block.due_rows:
            self.estimate, self.estimate_ns = block, host_ns()

    def newest_sample(self) -> Sample | None:
        """Return the newest sample; None if there is none."""
        return next(self.block.samples(LAST)) if self.block is not None else None

    def newest_estimate(self) -> Estimate | None:
        """Return the newest estimate; None if there is none."""
        return self.estimate.last_estimate() if isinstance(self.estimate, Block) else self.estimate


class Families(Collector):
    """Makes the metrics for Prometheus' library, in any thread, while the output receives new records."""

    def __init__(
        self,
        newest: dict[str, Newest],
        errors: dict[tuple[str, str], int],
        sink_queues: Callable[[], Sequence[tuple[str | None, OutputView]]],
    ) -> None:
        self._newest = newest
        self._errors = errors
        self._sink_queues = sink_queues

    def describe(self) -> list[Metric]:
        """Return no metrics.

        Without this method, the library would call `collect` when this collector is registered.
        """
        return []

    def collect(self) -> Iterator[Metric]:
        """Yield every metric that has a value."""
        build = {"version": __version__, "protocol": f"{wire.PROTOCOL_MAJOR}.{wire.PROTOCOL_MINOR}"}
        yield InfoMetricFamily("fltea_build", "This program.", value=build)
        # a copy is used, since the thread that receives records may be adding a device
        devices = list(self._newest.copy().items())
        yield _devices([(name, d.hello) for name, d in devices if d.hello])
        stats = [((name,), d.stats) for name, d in devices if d.stats]
        yield from _figures(LinkStats, DEVICE, [(names, s.link) for names, s in stats])
        yield from _figures(Stats, DEVICE, stats)
        yield from _figures(AxisStats, AXIS, _axes(stats))
        yield from families("", DEVICE, MOTIONS, [((name,), d) for name, d in devices if d.stats])
        yield from _figures(DeviceStatus, DEVICE, [(names, s.board) for names, s in stats if s.board])
        of_device = [(names, s.device_estimator) for names, s in stats if s.device_estimator]
        yield from _figures(DeviceEstimatorStats, DEVICE, of_device)
        samples = [((name,), s) for name, d in devices if (s := d.newest_sample())]
        yield from _figures(Sample, DEVICE, samples)
        oldest_ns = host_ns() - FRESH_NS
        fresh = [((name,), d.newest_estimate()) for name, d in devices if d.estimate_ns >= oldest_ns]
        yield from _figures(AxisEstimate, AXIS, _axes(fresh))
        own = [((name,), d.device_estimate) for name, d in devices if d.device_estimate_ns >= oldest_ns]
        yield from _figures(DeviceAxisEstimate, AXIS, _axes(own))
        device_fits = [((name, axis), fit) for name, d in devices for axis, fit in d.device_fits.items()]
        yield from _figures(DeviceAxisFit, AXIS, device_fits)
        fits = [((name,), d.fit) for name, d in devices if d.fit]
        yield from _figures(AxisFit, AXIS, _axes(fits))
        yield from _figures(Fit, DEVICE, fits)
        errors = CounterMetricFamily("fltea_errors", "Errors reported, by kind.", labels=("device", "kind"))
        yield filled(errors, list(self._errors.copy().items()))
        yield from _outputs([(device or "", sink_queue) for device, sink_queue in self._sink_queues()])


def _figures(kind: type, labels: tuple[str, ...], records: Labelled) -> Iterator[Metric]:
    """Yield the metrics for all figures in records, or in parts of records, of the type `kind`."""
    yield from families(ROOTS[kind].metrics, labels, of_kind(kind), records)


def _axes(records: Labelled) -> Labelled:
    """Split each record into its parts for the axes. Each part gets the axis as a further label."""
    return [((*names, axis), one) for names, record in records if record for axis, one in record.axes.items()]


def _devices(hellos: Sequence[tuple[str, Hello]]) -> Metric:
    family = InfoMetricFamily(
        "fltea_device",
        "The device, its firmware and its sensor, as the device states them.",
        labels=("device",),
    )
    for name, hello in hellos:
        facts = {fact: getattr(hello, fact) for fact in FACTS}
        family.add_metric((name,), {key: value for key, value in facts.items() if value is not None})
    return family


def _outputs(sink_queues: Sequence[tuple[str, OutputView]]) -> Iterator[Metric]:
    found = [((sink_queue.name, device), sink_queue.stats()) for device, sink_queue in sink_queues]
    yield from _figures(OutputStats, ("output", "device"), found)
    latency = HistogramMetricFamily(
        "fltea_output_latency_seconds",
        "Time from the arrival of a sample until its record is written.",
        labels=("output", "device"),
    )
    for device, sink_queue in sink_queues:
        total, buckets = 0, []
        for bound, count in zip(_BOUNDS_S, list(sink_queue.latency.counts), strict=True):
            total += count
            buckets.append((bound, float(total)))
        latency.add_metric((sink_queue.name, device), buckets, sink_queue.latency.sum_ms * 1e-3)
    yield latency
