"""Define which field of a record is which metric, in Prometheus' naming: base units, `_total` for counters.

A value that is unknown or not valid has no sample, so a graph shows a gap rather than a meaningless number.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from operator import attrgetter
from typing import Any, NamedTuple

from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric

DEVICE, AXIS = ("device",), ("device", "axis")

Labelled = Sequence[tuple[tuple[str, ...], Any]]
"""Records, each with the values of its labels."""


class Row(NamedTuple):
    """A metric made from a field of a record.

    `of`: the field, if its name differs from the metric's, or a function that gives the value from the
    record. `factor`: factor from the field's unit to the base unit. `key`: label of the keys if the field is
    a mapping; a field that is a word counts as a mapping of that word to 1.
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
    """Yield the metrics of all records of a kind. `prefix`: what their names begin with after `fltea_`."""
    for row in rows:
        names = labels if row.key is None else (*labels, row.key)
        yield filled(row.make(f"fltea_{prefix}{row.name}", row.text, labels=names), _values(row, records))


def filled(
    family: CounterMetricFamily | GaugeMetricFamily, values: Sequence[tuple[tuple[str, ...], float]]
) -> Metric:
    """Return the family with its values added, each with the values of its labels."""
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


LINK = (
    counter("received_bytes", "Bytes received.", "bytes"),
    counter("frames", "Good frames."),
    counter("bad_frames", "Damaged frames, by reason.", key="reason"),
    counter("unknown_frames", "Intact frames of an unknown type.", "unknown_type"),
    counter("refused_frames", "Frames of a device of another protocol version.", "refused"),
    counter("overflow_bytes", "Bytes thrown away: the program was too slow."),
    counter("reconnects", "Times that the port was opened again."),
)

STATS = (
    counter("samples_delivered", "Samples that went on to the estimator.", "sample_counts.delivered"),
    counter("samples_lost", "Samples missing in gaps.", "sample_counts.lost"),
    counter("gaps", "Gaps.", "sample_counts.gaps"),
    counter("samples_duplicate", "Samples that came twice and were dropped.", "sample_counts.duplicates"),
    counter(
        "samples_before_hello",
        "Samples before the first HELLO, which cannot be used.",
        "sample_counts.before_hello",
    ),
    counter(
        "samples_rate_differs",
        "Samples of a device whose clock contradicts its HELLO, which are not used.",
        "sample_counts.rate_differs",
    ),
    counter("epochs", "Epochs begun.", "epoch"),
    gauge("sample_rate_hertz", "Sampling rate by the host's clock.", "rate_hz"),
    gauge("clock_drift_ratio", "How much faster than the host's the device's clock runs.", "clock_ppm", 1e-6),
    gauge("startup_remaining_samples", "Samples until the start-up window is full.", "startup_remaining"),
    gauge("stats_timestamp_seconds", "Unix time of the newest statistics.", "host_ns", 1e-9),
)

INTERVENTIONS = "Samples since the axis's last start in which the guard stepped in, by cause."
LAG1 = "Correlation of an innovation with the one before; near 0 if the model fits."
NIS = "Mean square of the innovations over their predicted variance; near 1 if the model fits."
DESCRIBES = (
    "1: the innovations are white and the order is the fit's; 0: alpha and f say nothing of the noise."
)

AXIS_STATS = (
    counter("restarts", "Times that the axis began again in this epoch."),
    counter("interventions", INTERVENTIONS, key="reason"),
    gauge("innovation_lag1", LAG1),
    gauge("innovation_nis", NIS),
    gauge("describes_noise", DESCRIBES),
    gauge("tracker_nis", NIS, lambda axis: axis.tracker and axis.tracker.nis),
    gauge("tracker_lag1", LAG1, lambda axis: axis.tracker and axis.tracker.lag1),
    gauge(
        "tracker_holds",
        "1: the tracker's last 1,000 innovations are white; 0: its model does not describe the noise.",
        lambda axis: axis.tracker and axis.tracker.holds,
    ),
    counter(
        "tracker_restarts",
        "Times that the tracker of the bias began again.",
        lambda axis: axis.tracker and axis.tracker.restarts,
    ),
    gauge(
        "heading_std_degrees",
        "Standard deviation of the heading so many seconds after the last sample at rest.",
        lambda axis: axis.tracker and axis.tracker.heading_std,
        key="after_s",
    ),
    counter("moved_samples", "Samples in motion.", lambda axis: axis.tracker and axis.tracker.moved),
    counter("steps", "Steps of its bias.", lambda axis: axis.tracker and axis.tracker.steps),
    gauge(
        "bias_for_seconds",
        "The bias is the mean that is expected over so many seconds.",
        lambda axis: axis.tracker and axis.tracker.bias_for_s,
    ),
    gauge(
        "bias_error_ratio",
        "Mean of the next so many seconds less the bias, root mean square over its deviation; 1 if it holds.",
        lambda axis: axis.tracker and {t_s: one.rms for t_s, one in axis.tracker.checked.items()},
        key="for_s",
    ),
    gauge(
        "bias_error_pieces",
        "Pieces of so many seconds that this ratio is of.",
        lambda axis: axis.tracker and {t_s: one.pieces for t_s, one in axis.tracker.checked.items()},
        key="for_s",
    ),
)

MOTIONS = (counter("motions", "Times that the sensor has begun to move."),)


BOARD = (
    counter("i2c_errors", "I2C transfers that failed, since the device's boot."),
    counter("bus_recoveries", "Times that a held bus was freed, since the device's boot."),
    counter("sensor_reinits", "Times that the sensor was set up again, since the device's boot."),
    counter("overruns", "Sampling instants without a sample, since the device's boot."),
    counter("dropped_frames", "Frames that the device could not send, since its boot."),
    gauge(
        "cpu_ratio",
        "Share of the last second that the device's main loop worked.",
        "cpu_share_percent",
        1e-2,
    ),
    gauge(
        "longest_step_seconds",
        "Longest turn of the device's main loop within the last second.",
        "longest_step_us",
        1e-6,
    ),
)

DEVICE_ESTIMATOR = (
    counter("begun", "Times that the device began to estimate, since its boot."),
    counter(
        "skipped_samples",
        "Samples that the device's estimator could not take, since its boot.",
        "skipped",
    ),
    counter("estimates", "Estimates of an axis that came from the device."),
    counter("estimates_lost", "Estimates of an axis that the device sent and that did not come.", "lost"),
    counter("estimates_unplaced", "Estimates of an axis that came and fit no sample.", "unplaced"),
    counter("fits", "Fits of an axis that came from the device."),
    counter("fits_refused", "Fits of an axis that came with numbers that no fit can have."),
    gauge("queue_samples", "Samples that wait for the device's estimator.", "queue"),
    gauge(
        "longest_axis_seconds",
        "Longest step of one axis on the device, since its boot.",
        "longest_axis_us",
        1e-6,
    ),
)

SAMPLE = (
    gauge("temperature_celsius", "Die temperature of the sensor.", "temperature_c"),
    gauge("sample_timestamp_seconds", "Unix time of the newest sample.", "host_ns", 1e-9),
)

NOT_WHITE = (
    "1: the samples are not white noise, see fltea identify; 0: white noise is not rejected, no order."
)

ESTIMATE = (
    gauge("bias", "What to subtract from a sample: offset and state of the noise, in the unit of the axis."),
    gauge("bias_std", "Standard deviation of the bias."),
    gauge("state", "State of the noise, without the offset."),
    gauge("state_std", "Standard deviation of the state."),
    gauge("moving", "1: the sensor is moving, so the bias is predicted; 0: it is at rest."),
    gauge(
        "fltea_valid",
        "1: the estimate of the paper's filters holds; 0: it ran away, or was held.",
        "fltea.valid",
    ),
    gauge(
        "fltea_settled",
        "1: their variances are known and their innovations white; 0: settling.",
        "fltea.settled",
    ),
    gauge("fltea_alpha", "Order of the noise by the paper's filters.", "fltea.alpha"),
    gauge("fltea_alpha_std", "The order filter's own standard deviation.", "fltea.alpha_std"),
    gauge("fltea_f", "Parameter f by the paper's filters, in s^-alpha.", "fltea.f"),
    gauge("fltea_f_std", "The parameter filter's own standard deviation, in s^-alpha.", "fltea.f_std"),
    gauge("null_p", "How often white noise would look at least as unlike white as the samples."),
    gauge("not_white", NOT_WHITE, lambda axis: axis.whiteness and axis.whiteness == "rejected"),
)

DEVICE_ESTIMATE = (
    gauge("valid", "1: the device's own estimate holds; 0: it does not.", "fltea.valid"),
    gauge("alpha", "Order of the noise, as the device itself estimates it.", "fltea.alpha"),
    gauge("f", "Parameter f of the noise, as the device itself estimates it, in s^-alpha.", "fltea.f"),
    gauge("alpha_difference", "Order: the device's estimate minus the host's after the same sample."),
    gauge("f_difference", "Parameter f: the device's estimate minus the host's, in s^-alpha."),
    gauge("bias", "What to subtract from a sample, by the device's own fit, in deg/s.", "tracker_bias"),
    gauge("bias_std", "Standard deviation of that bias, in deg/s.", "tracker_bias_std"),
    gauge(
        "bias_difference",
        "Bias: the device's minus the host's after the same sample, in deg/s.",
        "tracker_bias_difference",
    ),
)

DEVICE_FIT = (
    gauge("verdict", "Verdict of the device's own maximum-likelihood fit.", key="verdict"),
    gauge("alpha", "Order by the device's own maximum-likelihood fit.", "alpha.value"),
    gauge("alpha_low", "Lower end of its 95 % interval.", "alpha.low"),
    gauge("alpha_high", "Upper end of its 95 % interval.", "alpha.high"),
    gauge("alpha_difference", "Order: the device's fit minus this computer's newest one."),
)

PARAMETERS = (
    ("alpha", "Order of the noise, by maximum likelihood"),
    ("f", "Parameter f by maximum likelihood, in s^-alpha"),
    ("F", "F = h^alpha f + alpha by maximum likelihood"),
    ("s2", "Variance of the noise's source by maximum likelihood, in the axis's unit squared"),
    ("R", "Variance of the white part by maximum likelihood, in the axis's unit squared"),
)
ENDS = (
    ("value", "", ""),
    ("low", "_low", ": lower end of its 95 % interval"),
    ("high", "_high", ": upper end"),
)
UNTIL = "Seconds until the order is known as well as live.target asks; none if nobody knows."

AXIS_FIT = (
    *(
        gauge(f"{parameter}{ending}", f"{text}{which}.", f"{parameter}.{end}")
        for parameter, text in PARAMETERS
        for end, ending, which in ENDS
    ),
    gauge("null_p", "How often white noise would look at least as unlike white."),
    gauge("until_seconds", UNTIL, lambda axis: axis.until_s and axis.until_s.seconds),
    gauge("verdict", "1 for the verdict that the noise has.", key="verdict"),
    gauge(
        "left_out_samples",
        "Samples that are not in the fit, and bridged ones, by cause.",
        "left_out",
        key="reason",
    ),
    gauge("breaks", "How often its samples were broken, by cause.", key="reason"),
)

FIT = (
    gauge("samples", "Samples that the newest fit is of."),
    gauge("timestamp_seconds", "Unix time of its last sample.", "host_ns", 1e-9),
)

OUTPUTS = (
    counter("written", "Records that an output has written."),
    counter("dropped", "Records that an output lost: too slow, or broken."),
    gauge("queue_records", "Records that wait for an output.", "queued"),
)
