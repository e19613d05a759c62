"""Records as metrics, in Prometheus' naming: base units, `_total` for what only grows.

What is not known or not valid has no sample: a gap in a graph, rather than a number that means nothing.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

from prometheus_client.core import (
    HistogramMetricFamily,
    InfoMetricFamily,
    Metric,
)
from prometheus_client.registry import Collector

from fltea.records.block import Block
from fltea.records.clock import host_ns
from fltea.records.device_fit import DeviceAxisFit
from fltea.records.ports import LATENCY_BOUNDS_MS, OutputView
from fltea.records.records import (
    DeviceAxisEstimate,
    DeviceEstimates,
    DeviceEstimatorStats,
    DeviceStatus,
    Estimate,
    Fit,
    Hello,
    Sample,
    Stats,
)
from fltea.records.version import __version__
from fltea.sinks.metrics.fits import fit_families
from fltea.sinks.metrics.rows import Rows, counter_family, gauge_family
from fltea.wire import layout as wire

FRESH_NS = 5 * 10**9
"""An estimate that is older, by its arrival, is no longer shown: the device is gone, or starts again."""

_BOUNDS_S = [repr(bound * 1e-3) for bound in LATENCY_BOUNDS_MS] + ["+Inf"]


@dataclass
class Newest:
    """The newest record of each kind of one device. …_ns: when the estimate came, monotonic."""

    hello: Hello | None = None
    stats: Stats | None = None
    block: Block | None = None
    estimate: Estimate | Block | None = None
    estimate_ns: int = 0
    device_estimate: DeviceEstimates | None = None
    device_estimate_ns: int = 0
    device_fits: dict[str, DeviceAxisFit] = field(default_factory=dict)
    fit: Fit | None = None

    def take(self, block: Block) -> None:
        """Remember samples and estimates; records are made of them when somebody asks."""
        self.block = block
        if block.estimates and block.due_rows:
            self.estimate, self.estimate_ns = block, host_ns()

    def newest_sample(self) -> Sample | None:
        """Return the last sample."""
        n = len(self.block) if self.block is not None else 0
        return next(self.block.samples(slice(n - 1, n))) if self.block is not None else None

    def newest_estimate(self) -> Estimate | None:
        """Return the last estimate."""
        return self.estimate.last_estimate() if isinstance(self.estimate, Block) else self.estimate


class Families(Collector):
    """What the registry asks for, in whatever thread, while the sink writes."""

    def __init__(
        self,
        newest: dict[str, Newest],
        errors: dict[tuple[str, str], int],
        outlets: Callable[[], Sequence[tuple[str | None, OutputView]]],
    ) -> None:
        self._newest = newest
        self._errors = errors
        self._outlets = outlets

    def describe(self) -> list[Metric]:
        """Promise nothing, so that registering does not collect."""
        return []

    def collect(self) -> Iterator[Metric]:
        """Yield every metric that has a value."""
        build = {"version": __version__, "protocol": f"{wire.PROTOCOL_MAJOR}.{wire.PROTOCOL_MINOR}"}
        yield InfoMetricFamily("fltea_build", "This program.", value=build)
        devices = list(self._newest.copy().items())  # the copy: the sink may be adding one
        yield _devices([(name, d.hello) for name, d in devices if d.hello is not None])
        stats = [(name, d.stats) for name, d in devices if d.stats is not None]
        yield from _link(stats)
        yield from _samples(stats)
        yield from _axes_stats(stats)
        yield from _board(stats)
        yield from _device_estimator([(name, s.device_estimator) for name, s in stats if s.device_estimator])
        yield from _sample([(name, s) for name, d in devices if (s := d.newest_sample()) is not None])
        oldest_ns = host_ns() - FRESH_NS
        recent = [(name, d.newest_estimate()) for name, d in devices if d.estimate_ns >= oldest_ns]
        fresh = [(name, estimate) for name, estimate in recent if estimate is not None]
        yield from _estimates(fresh)
        yield from _device_estimates(
            [
                (name, d.device_estimate)
                for name, d in devices
                if d.device_estimate and d.device_estimate_ns >= oldest_ns
            ]
        )
        yield from _device_fits([(name, d.device_fits) for name, d in devices])
        yield from fit_families([(name, d.fit) for name, d in devices if d.fit is not None])
        errors: Rows = [(labels, n) for labels, n in self._errors.copy().items()]
        yield counter_family("fltea_errors", "Errors reported, by kind.", ("device", "kind"), errors)
        yield from _outputs([(device or "", outlet) for device, outlet in self._outlets()])


def _devices(hellos: Sequence[tuple[str, Hello]]) -> Metric:
    family = InfoMetricFamily("fltea_device", "What the device states of itself.", labels=("device",))
    for name, hello in hellos:
        facts = {
            "source": hello.source,
            "device_id": hello.device_id,
            "sensor": hello.sensor,
            "firmware_version": hello.firmware_version,
            "sampling_mode": hello.sampling_mode,
        }
        family.add_metric((name,), {key: value for key, value in facts.items() if value is not None})
    return family


def _link(stats: Sequence[tuple[str, Stats]]) -> Iterator[Metric]:
    def counter(name: str, text: str, key: str) -> Metric:
        rows: Rows = [((device,), getattr(s.link, key)) for device, s in stats]
        return counter_family(f"fltea_link_{name}", text, ("device",), rows)

    yield counter("received_bytes", "Bytes received.", "bytes")
    yield counter("frames", "Good frames.", "frames")
    bad: Rows = [((device, why), n) for device, s in stats for why, n in s.link.bad_frames.items()]
    yield counter_family("fltea_link_bad_frames", "Damaged frames, by reason.", ("device", "reason"), bad)
    yield counter("unknown_frames", "Intact frames of an unknown type.", "unknown_type")
    yield counter("refused_frames", "Frames of a device of another protocol version.", "refused")
    yield counter("overflow_bytes", "Bytes thrown away: the program was too slow.", "overflow_bytes")
    yield counter("reconnects", "Times that the port was opened again.", "reconnects")


def _samples(stats: Sequence[tuple[str, Stats]]) -> Iterator[Metric]:
    def counter(name: str, text: str, key: str) -> Metric:
        rows: Rows = [((device,), getattr(s.samples, key)) for device, s in stats]
        return counter_family(f"fltea_{name}", text, ("device",), rows)

    def gauge(name: str, text: str, value: Callable[[Stats], float | None]) -> Metric:
        return gauge_family(
            f"fltea_{name}", text, ("device",), [((device,), value(s)) for device, s in stats]
        )

    yield counter("samples_delivered", "Samples that went on to the estimator.", "delivered")
    yield counter("samples_lost", "Samples missing in gaps.", "lost")
    yield counter("gaps", "Gaps.", "gaps")
    yield counter("samples_duplicate", "Samples that came twice and were dropped.", "duplicates")
    yield counter("samples_before_hello", "Samples that nobody had introduced.", "before_hello")
    yield counter_family(
        "fltea_epochs", "Epochs begun.", ("device",), [((device,), s.epoch) for device, s in stats]
    )
    yield gauge("sample_rate_hertz", "Sampling rate by the host's clock.", lambda s: s.rate_hz)
    yield gauge(
        "clock_drift_ratio",
        "How much faster than the host's the device's clock runs.",
        lambda s: None if s.clock_ppm is None else s.clock_ppm * 1e-6,
    )
    yield gauge(
        "startup_remaining_samples",
        "Samples until the start-up window is full.",
        lambda s: s.startup_remaining,
    )
    yield gauge("stats_timestamp_seconds", "Unix time of the newest statistics.", lambda s: s.host_ns * 1e-9)


def _axes_stats(stats: Sequence[tuple[str, Stats]]) -> Iterator[Metric]:
    axes = [(device, axis, one) for device, s in stats for axis, one in s.axes.items()]
    labels = ("device", "axis")
    restarts: Rows = [((device, axis), one.restarts) for device, axis, one in axes]
    yield counter_family(
        "fltea_axis_restarts", "Times that the axis began again in this epoch.", labels, restarts
    )
    interventions: Rows = [
        ((device, axis, why), n) for device, axis, one in axes for why, n in one.interventions.items()
    ]
    text = "Samples since the axis's last start in which the guard stepped in, by cause."
    yield counter_family("fltea_axis_interventions", text, (*labels, "reason"), interventions)
    lag1: Rows = [((device, axis), one.innovation_lag1) for device, axis, one in axes]
    text = "Correlation of an innovation with the one before; near 0 if the model fits."
    yield gauge_family("fltea_axis_innovation_lag1", text, labels, lag1)
    nis: Rows = [((device, axis), one.innovation_nis) for device, axis, one in axes]
    text = "Mean square of the innovations over their predicted variance; near 1 if the model fits."
    yield gauge_family("fltea_axis_innovation_nis", text, labels, nis)
    white: Rows = [
        ((device, axis), None if one.describes_noise is None else float(one.describes_noise))
        for device, axis, one in axes
    ]
    text = "1: the innovations are about white; 0: alpha and f of the filter do not describe the noise."
    yield gauge_family("fltea_axis_describes_noise", text, labels, white)


def _board(stats: Sequence[tuple[str, Stats]]) -> Iterator[Metric]:
    boards: list[tuple[str, DeviceStatus]] = [(device, s.board) for device, s in stats if s.board]
    for name, text in (
        ("i2c_errors", "I2C transfers that failed, since the device's boot."),
        ("bus_recoveries", "Times that a held bus was freed, since the device's boot."),
        ("sensor_reinits", "Times that the sensor was set up again, since the device's boot."),
        ("overruns", "Sampling instants without a sample, since the device's boot."),
        ("dropped_frames", "Frames that the device could not send, since its boot."),
    ):
        rows: Rows = [((device,), getattr(board, name)) for device, board in boards]
        yield counter_family(f"fltea_board_{name}", text, ("device",), rows)

    shares: Rows = [((device,), _scaled(board.cpu_share_percent, 1e-2)) for device, board in boards]
    text = "Share of the last second that the device's main loop worked."
    yield gauge_family("fltea_board_cpu_ratio", text, ("device",), shares)
    steps: Rows = [((device,), _scaled(board.longest_step_us, 1e-6)) for device, board in boards]
    text = "Longest turn of the device's main loop within the last second."
    yield gauge_family("fltea_board_longest_step_seconds", text, ("device",), steps)


def _device_estimator(stats: Sequence[tuple[str, DeviceEstimatorStats]]) -> Iterator[Metric]:
    for name, key, text in (
        ("begun", "begun", "Times that the device began to estimate, since its boot."),
        ("skipped_samples", "skipped", "Samples that the device's estimator could not take, since its boot."),
        ("estimates", "estimates", "Estimates of an axis that came from the device."),
        ("estimates_lost", "lost", "Estimates of an axis that the device sent and that did not come."),
        ("estimates_unplaced", "unplaced", "Estimates of an axis that came and fit no sample."),
        ("fits", "fits", "Fits of an axis that came from the device."),
        ("fits_refused", "fits_refused", "Fits of an axis that came with numbers that no fit can have."),
    ):
        rows: Rows = [((device,), getattr(one, key)) for device, one in stats]
        yield counter_family(f"fltea_device_{name}", text, ("device",), rows)
    queues: Rows = [((device,), one.queue) for device, one in stats]
    yield gauge_family(
        "fltea_device_queue_samples", "Samples that wait for the device's estimator.", ("device",), queues
    )
    longest: Rows = [((device,), one.longest_axis_us * 1e-6) for device, one in stats]
    text = "Longest step of one axis on the device, since its boot."
    yield gauge_family("fltea_device_longest_axis_seconds", text, ("device",), longest)


def _device_estimates(estimates: Sequence[tuple[str, DeviceEstimates]]) -> Iterator[Metric]:
    axes: list[tuple[tuple[str, str], DeviceAxisEstimate]] = [
        ((device, axis), one) for device, e in estimates for axis, one in e.axes.items()
    ]
    labels = ("device", "axis")
    valid: Rows = [(names, float(one.valid)) for names, one in axes]
    yield gauge_family(
        "fltea_device_axis_valid", "1: the device's own estimate holds; 0: it does not.", labels, valid
    )
    for key, text in (
        ("alpha", "Order of the noise, as the device itself estimates it."),
        ("f", "Parameter f of the noise, as the device itself estimates it, in s^-alpha."),
        ("alpha_difference", "Order: the device's estimate minus the host's after the same sample."),
        ("f_difference", "Parameter f: the device's estimate minus the host's, in s^-alpha."),
    ):
        rows: Rows = [(names, getattr(one, key)) for names, one in axes]
        yield gauge_family(f"fltea_device_axis_{key}", text, labels, rows)


def _device_fits(fits: Sequence[tuple[str, dict[str, DeviceAxisFit]]]) -> Iterator[Metric]:
    axes = [((device, axis), one) for device, found in fits for axis, one in found.items()]
    labels = ("device", "axis")
    verdicts: Rows = [((*names, one.verdict), 1.0) for names, one in axes]
    text = "What the device's own maximum-likelihood fit of the noise."
    yield gauge_family("fltea_device_fit_verdict", text, (*labels, "verdict"), verdicts)
    for name, key, text in (
        ("alpha", "value", "Order by the device's own maximum-likelihood fit."),
        ("alpha_low", "low", "Lower end of its 95 % interval."),
        ("alpha_high", "high", "Upper end of its 95 % interval."),
    ):
        rows: Rows = [(names, getattr(one.alpha, key)) for names, one in axes]
        yield gauge_family(f"fltea_device_fit_{name}", text, labels, rows)
    apart: Rows = [(names, one.alpha_difference) for names, one in axes]
    text = "Order: the device's fit minus this computer's newest one."
    yield gauge_family("fltea_device_fit_alpha_difference", text, labels, apart)


def _scaled(value: float | None, factor: float) -> float | None:
    return None if value is None else value * factor


def _sample(samples: Sequence[tuple[str, Sample]]) -> Iterator[Metric]:
    temperatures: Rows = [((device,), s.temperature_c) for device, s in samples]
    yield gauge_family(
        "fltea_temperature_celsius", "Die temperature of the sensor.", ("device",), temperatures
    )
    times: Rows = [((device,), s.host_ns * 1e-9) for device, s in samples]
    yield gauge_family(
        "fltea_sample_timestamp_seconds", "Unix time of the newest sample.", ("device",), times
    )


def _estimates(estimates: Sequence[tuple[str, Estimate]]) -> Iterator[Metric]:
    axes = [((device, axis), one) for device, e in estimates for axis, one in e.axes.items()]
    labels = ("device", "axis")
    valid: Rows = [(names, float(one.valid)) for names, one in axes]
    yield gauge_family(
        "fltea_axis_valid", "1: the estimate holds; 0: it ran away, or was held.", labels, valid
    )
    for key, text in (
        ("alpha", "Order of the noise."),
        ("alpha_std", "The order filter's own standard deviation."),
        ("f", "Parameter f of the noise, in s^-alpha."),
        ("f_std", "The parameter filter's own standard deviation, in s^-alpha."),
        ("null_p", "How often white noise would look at least as unlike white as the samples."),
    ):
        rows: Rows = [(names, getattr(one, key)) for names, one in axes]
        yield gauge_family(f"fltea_axis_{key}", text, labels, rows)
    white: Rows = [(names, one.whiteness and float(one.whiteness == "rejected")) for names, one in axes]
    text = "1: the samples are not white noise, see fltea identify; 0: white noise is not rejected, no order."
    yield gauge_family("fltea_axis_not_white", text, labels, white)


def _outputs(outlets: Sequence[tuple[str, OutputView]]) -> Iterator[Metric]:
    stats = [((outlet.name, device), outlet.stats()) for device, outlet in outlets]
    labels = ("output", "device")
    yield counter_family(
        "fltea_output_written", "Records that an output took.", labels, [(o, s.written) for o, s in stats]
    )
    text = "Records that an output lost: too slow, or broken."
    yield counter_family("fltea_output_dropped", text, labels, [(o, s.dropped) for o, s in stats])
    yield gauge_family(
        "fltea_output_queue_records",
        "Records that wait for an output.",
        labels,
        [(o, s.queued) for o, s in stats],
    )
    latency = HistogramMetricFamily(
        "fltea_output_latency_seconds", "From a sample's arrival to its way out.", labels=labels
    )
    for device, outlet in outlets:
        total, buckets = 0, []
        for bound, count in zip(_BOUNDS_S, list(outlet.latency.counts), strict=True):
            total += count
            buckets.append((bound, float(total)))
        latency.add_metric((outlet.name, device), buckets, outlet.latency.sum_ms * 1e-3)
    yield latency
