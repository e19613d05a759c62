"""Declare the figures of an axis that follow each sample: bias, tracker, and the paper's filters."""

from collections.abc import Iterator
from functools import partial

from fltea.records.estimate import AxisEstimate
from fltea.records.plus_minus import plus_minus
from fltea.records.stats import AxisStats
from fltea.sinks.axis_words import bias_words, unit_of
from fltea.sinks.figures.figure import (
    OF_AXIS,
    Cells,
    Entity,
    Figure,
    Hidden,
    Row,
    Rows,
    Seen,
    Shown,
    counter,
    gauge,
    thousands,
)
from fltea.sinks.figures.hidden import (
    ESTIMATE,
    NARROW,
    NO_ENTITY,
    NO_METRIC,
    NO_PANEL,
    ONLY_METRIC,
)
from fltea.sinks.words import quantity

PANEL = Shown("a panel")
ROW = Shown("the row of the value to which this number belongs")
SENTENCE = Shown("the sentence of the axis")
OF_STATS = Hidden("Home Assistant takes the number from the record `stats`, which comes once a second")

_axis, _estimate = partial(Figure, AxisStats), partial(Figure, AxisEstimate)

LAG1 = "Correlation of each innovation with the previous one; near 0 if the model fits."
NIS = "Mean of the squared innovations, divided by their predicted variance; near 1 if the model fits."
MOVES = """{% set moved = namespace(now=false) %}{% for axis in value_json.axes.values() %}\
{% if axis.tracker and axis.tracker.moving %}{% set moved.now = true %}{% endif %}{% endfor %}\
{{ 'ON' if moved.now else 'OFF' }}"""


def three(value: float) -> str:
    """Return a number as text with three decimals."""
    return quantity(value, "", 3)


def _bias(seen: Seen) -> Iterator[Cells]:
    yield ["bias", bias_words(seen.estimate, unit_of(seen.axis)).removeprefix("bias ") or "–"]


def _state(seen: Seen) -> Iterator[Cells]:
    e = seen.estimate
    yield ["state", f"{plus_minus(e.state, e.state_std)} {unit_of(seen.axis)}" if e else "–"]


def _checked(seen: Seen) -> Iterator[Cells]:
    axis: AxisStats | None = seen.record(AxisStats)
    for t_s, one in (axis.tracker.checked if axis and axis.tracker else {}).items():
        yield [
            f"the mean of the next {t_s} s minus the bias, over σ",
            f"{one.rms:.2f} ({one.pieces:,} pieces)",
        ]


FIGURES = (
    _estimate(
        "bias",
        gauge(
            "bias", "What to subtract from a sample: offset and state of the noise, in the unit of the axis."
        ),
        page=Rows("axis", _bias),
        terminal=SENTENCE,
        home_assistant=OF_STATS,
        grafana=PANEL,
    ),
    _estimate(
        "bias_std",
        gauge("bias_std", "Standard deviation of the bias."),
        page=ROW,
        terminal=SENTENCE,
        home_assistant=OF_STATS,
        grafana=PANEL,
    ),
    _estimate(
        "state",
        gauge("state", "State of the noise, without the offset."),
        page=Rows("axis", _state),
        terminal=NARROW,
        home_assistant=NO_ENTITY,
        grafana=NO_PANEL,
    ),
    _estimate(
        "state_std",
        gauge("state_std", "Standard deviation of the state."),
        page=ROW,
        terminal=NARROW,
        home_assistant=NO_ENTITY,
        grafana=NO_PANEL,
    ),
    _estimate(
        "moving",
        gauge("moving", "1: the sensor is moving, so the bias is predicted; 0: it is at rest."),
        page=ROW,
        terminal=SENTENCE,
        home_assistant=OF_STATS,
        grafana=NO_PANEL,
    ),
    _axis(
        "tracker.bias",
        ESTIMATE,
        page=ESTIMATE,
        terminal=ESTIMATE,
        home_assistant=Entity("bias", "bias", OF_AXIS, state_class="measurement"),
        grafana=NO_METRIC,
    ),
    _axis(
        "tracker.bias_std",
        ESTIMATE,
        page=ESTIMATE,
        terminal=ESTIMATE,
        home_assistant=Entity("bias_std", "bias σ", OF_AXIS, state_class="measurement"),
        grafana=NO_METRIC,
    ),
    _axis(
        "tracker.moving",
        ESTIMATE,
        page=ESTIMATE,
        terminal=ESTIMATE,
        home_assistant=Entity(
            "moves", "moves", platform="binary_sensor", device_class="motion", template=MOVES
        ),
        grafana=NO_METRIC,
    ),
    _axis(
        "tracker.model",
        NO_METRIC,
        page=Row("axis", "model of the bias", absent="–"),
        terminal=NARROW,
        home_assistant=NO_ENTITY,
        grafana=NO_METRIC,
    ),
    _axis(
        "tracker.nis",
        gauge("tracker_nis", NIS),
        page=Row("axis", "its innovations, NIS", three, absent="–"),
        terminal=NARROW,
        home_assistant=NO_ENTITY,
        grafana=NO_PANEL,
    ),
    _axis("tracker.lag1", gauge("tracker_lag1", LAG1), **ONLY_METRIC),
    _axis(
        "tracker.holds",
        gauge(
            "tracker_holds",
            "1: the bias tracker's last 1,000 innovations are white; 0: the tracker's model does not "
            "describe the noise.",
        ),
        **ONLY_METRIC,
    ),
    _axis(
        "tracker.restarts",
        counter("tracker_restarts", "Number of restarts of the bias tracker."),
        **ONLY_METRIC,
    ),
    _axis(
        "tracker.heading_std",
        gauge(
            "heading_std_degrees",
            "Standard deviation of the heading, by the number of seconds since the last sample at rest.",
            key="after_s",
        ),
        page=Shown("the heading after the rest so far, and its curve"),
        terminal=Shown("the heading after a rest"),
        home_assistant=NO_ENTITY,
        grafana=PANEL,
    ),
    _axis("tracker.moved", counter("moved_samples", "Samples in motion."), **ONLY_METRIC),
    _axis(
        "tracker.bias_for_s",
        gauge("bias_for_seconds", "The bias is the mean that is expected over this time, in seconds."),
        page=Row("axis", "it is the mean expected over", lambda t_s: f"{t_s:g} s"),
        terminal=NARROW,
        home_assistant=NO_ENTITY,
        grafana=NO_PANEL,
    ),
    _axis(
        "tracker.checked.rms",
        gauge(
            "bias_error_ratio",
            "Root mean square of (mean of the next T seconds minus the bias) / (its standard deviation), "
            "by T; 1 if the deviation is right.",
            key="for_s",
        ),
        page=Rows("axis", _checked),
        terminal=NARROW,
        home_assistant=NO_ENTITY,
        grafana=NO_PANEL,
    ),
    _axis(
        "tracker.checked.pieces",
        gauge(
            "bias_error_pieces",
            "Number of pieces of T seconds from which the ratio is computed, by T.",
            key="for_s",
        ),
        page=ROW,
        terminal=NARROW,
        home_assistant=NO_ENTITY,
        grafana=NO_PANEL,
    ),
    _axis(
        "tracker.steps",
        counter("steps", "Number of steps of the axis's bias."),
        page=Row("axis", "steps of the bias", thousands),
        terminal=NARROW,
        home_assistant=Entity("steps", "steps of the bias", state_class="total_increasing"),
        grafana=PANEL,
    ),
)
