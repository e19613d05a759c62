"""Declare the figures of a device that estimates noise itself: processor, estimator and estimates."""

from collections.abc import Iterator
from functools import partial

from fltea.records.estimate import DeviceAxisEstimate
from fltea.records.records import Hello, Stats
from fltea.records.stats import DeviceEstimatorStats, DeviceStatus
from fltea.sinks.figures.figure import (
    Cells,
    Figure,
    Hidden,
    Row,
    Rows,
    Seen,
    Shown,
    counter,
    gauge,
    loss,
    thousands,
)
from fltea.sinks.figures.hidden import (
    NARROW,
    NO_ENTITY,
    NO_METRIC,
    NO_PANEL,
    NO_ROW,
    OF_HOST,
    ONLY_METRIC,
)
from fltea.sinks.words import quantity

COMPARED = Shown("the device's estimates beside this computer's")
TABLE = Shown("the table of the device's estimates")
HEALTH = Shown("the line of the device's health")
PANEL = Shown("a panel")

_board, _own = partial(Figure, DeviceStatus), partial(Figure, DeviceEstimatorStats)
_estimate = partial(Figure, DeviceAxisEstimate)


def estimates_rate(stats: Stats | None, hello: Hello | None) -> str:
    """Return how many estimates a second the device sends, as the end of a text; empty if unknown."""
    own = stats.device_estimator if stats else None
    return (
        "" if own is None or hello is None or not own.every else f", {hello.rate_hz / own.every:g} a second"
    )


def _milliseconds(us: int) -> str:
    return f"{us / 1000:.2f} ms"


def _every(seen: Seen) -> Iterator[Cells]:
    own: DeviceEstimatorStats | None = seen.record(DeviceEstimatorStats)
    if own is not None:
        samples = "every sample" if own.every == 1 else f"every {own.every:,} samples"
        yield ["estimates", samples + estimates_rate(seen.stats, seen.hello), "plain"]


FIGURES = (
    _board(
        "cpu_share_percent",
        gauge(
            "cpu_ratio", "Proportion of the last second in which the device's main loop worked.", factor=1e-2
        ),
        page=Row("own", "CPU share", lambda share: quantity(share, "%", 1), absent="–"),
        terminal=HEALTH,
        home_assistant=NO_ENTITY,
        grafana=PANEL,
    ),
    _board(
        "longest_step_us",
        gauge(
            "longest_step_seconds",
            "Longest duration of one turn of the device's main loop within the last second.",
            factor=1e-6,
        ),
        page=Row("own", "longest turn of its loop", _milliseconds, absent="–"),
        terminal=NARROW,
        home_assistant=NO_ENTITY,
        grafana=NO_PANEL,
    ),
    _own(
        "longest_axis_us",
        gauge(
            "longest_axis_seconds",
            "Longest computing time of one step of one axis on the device, since its boot.",
            factor=1e-6,
        ),
        page=Row("own", "longest step of an axis", _milliseconds),
        terminal=HEALTH,
        home_assistant=NO_ENTITY,
        grafana=NO_PANEL,
    ),
    _own(
        "every",
        Hidden("it is a setting of the device"),
        page=Rows("own", _every),
        terminal=NARROW,
        home_assistant=NO_ENTITY,
        grafana=NO_METRIC,
    ),
    _own(
        "startup_remaining",
        Hidden("the number only counts down once, in the first seconds"),
        page=Row(
            "own",
            "start-up remaining",
            lambda n: f"{n:,} samples" if n else "none",
            level=lambda n: "wait" if n else "plain",
        ),
        terminal=NARROW,
        home_assistant=NO_ENTITY,
        grafana=NO_METRIC,
    ),
    _own(
        "queue",
        gauge("queue_samples", "Number of samples that wait for the device's estimator."),
        page=Row("own", "samples that wait", thousands),
        terminal=NARROW,
        home_assistant=NO_ENTITY,
        grafana=NO_PANEL,
    ),
    _own(
        "skipped",
        counter(
            "skipped_samples",
            "Number of samples that the device's estimator could not process, since the device's boot.",
        ),
        page=loss("own", "skipped samples", "it had fallen behind"),
        terminal=HEALTH,
        home_assistant=NO_ENTITY,
        grafana=NO_PANEL,
    ),
    _own(
        "estimates",
        counter("estimates", "Number of estimates (of one axis each) that arrived from the device."),
        **ONLY_METRIC,
    ),
    _own(
        "lost",
        counter(
            "estimates_lost",
            "Number of estimates (of one axis each) that the device sent and that did not arrive.",
        ),
        page=loss("own", "lost estimates"),
        terminal=NARROW,
        home_assistant=NO_ENTITY,
        grafana=NO_PANEL,
    ),
    _own(
        "unplaced",
        counter(
            "estimates_unplaced",
            "Number of estimates (of one axis each) that arrived but belong to no sample.",
        ),
        page=Row("own", "estimates of no sample", thousands),
        terminal=NARROW,
        home_assistant=NO_ENTITY,
        grafana=NO_PANEL,
    ),
    _own(
        "fits",
        counter("fits", "Number of fits (of one axis each) that arrived from the device."),
        **ONLY_METRIC,
    ),
    _own(
        "fits_refused",
        counter("fits_refused", "Number of fits (of one axis each) that arrived with impossible numbers."),
        page=loss("own", "refused fits"),
        terminal=NARROW,
        home_assistant=NO_ENTITY,
        grafana=NO_PANEL,
    ),
    _own(
        "begun",
        counter("begun", "Number of times that the device began to estimate, since its boot."),
        page=Row(
            "own",
            "began",
            lambda n: f"{n:,} times since its boot" if n != 1 else "once since its boot",
        ),
        terminal=NARROW,
        home_assistant=NO_ENTITY,
        grafana=NO_PANEL,
    ),
    _own(
        "restarts",
        Hidden("axis_restarts counts the restarts of this computer's filters, which see the same samples"),
        page=COMPARED,
        terminal=NARROW,
        home_assistant=NO_ENTITY,
        grafana=NO_METRIC,
    ),
    _own(
        "interventions",
        Hidden(
            "axis_interventions counts the interventions of this computer's guard, which has the same rules"
        ),
        page=COMPARED,
        terminal=NARROW,
        home_assistant=NO_ENTITY,
        grafana=NO_METRIC,
    ),
    _estimate(
        "fltea.valid",
        gauge("valid", "1: the device's own estimate is valid; 0: it is not."),
        page=NO_ROW,
        terminal=TABLE,
        home_assistant=NO_ENTITY,
        grafana=NO_PANEL,
    ),
    _estimate(
        "fltea.alpha",
        gauge("alpha", "Order of the noise, as the device itself estimates it."),
        page=COMPARED,
        terminal=TABLE,
        home_assistant=NO_ENTITY,
        grafana=PANEL,
    ),
    _estimate(
        "fltea.f",
        gauge("f", "Parameter f of the noise, as the device itself estimates it, in s^-alpha."),
        page=COMPARED,
        terminal=TABLE,
        home_assistant=NO_ENTITY,
        grafana=PANEL,
    ),
    _estimate(
        "alpha_difference",
        gauge("alpha_difference", "Order: the device's estimate minus the host's after the same sample."),
        page=COMPARED,
        terminal=TABLE,
        home_assistant=NO_ENTITY,
        grafana=NO_PANEL,
    ),
    _estimate(
        "f_difference",
        gauge("f_difference", "Parameter f: the device's estimate minus the host's, in s^-alpha."),
        page=COMPARED,
        terminal=TABLE,
        home_assistant=NO_ENTITY,
        grafana=NO_PANEL,
    ),
    _estimate(
        "state_difference",
        OF_HOST,
        page=COMPARED,
        terminal=NARROW,
        home_assistant=NO_ENTITY,
        grafana=NO_METRIC,
    ),
    _estimate(
        "tracker_bias",
        gauge("bias", "Bias to subtract from a sample, by the device's own fit, in deg/s."),
        page=COMPARED,
        terminal=TABLE,
        home_assistant=NO_ENTITY,
        grafana=NO_PANEL,
    ),
    _estimate(
        "tracker_bias_std",
        gauge("bias_std", "Standard deviation of that bias, in deg/s."),
        page=COMPARED,
        terminal=TABLE,
        home_assistant=NO_ENTITY,
        grafana=NO_PANEL,
    ),
    _estimate(
        "tracker_bias_difference",
        gauge(
            "bias_difference", "Bias: the device's estimate minus the host's after the same sample, in deg/s."
        ),
        page=COMPARED,
        terminal=TABLE,
        home_assistant=NO_ENTITY,
        grafana=NO_PANEL,
    ),
)
