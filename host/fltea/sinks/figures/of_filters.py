"""Declare the figures of the paper's filters for an axis, and of the checks of their innovations."""

from collections.abc import Iterator
from functools import partial

from fltea.records.estimate import AxisEstimate, FlteaEstimate
from fltea.records.plus_minus import plus_minus
from fltea.records.stats import AxisStats
from fltea.sinks.axis_words import unit_of
from fltea.sinks.figures.figure import Cells, Figure, Row, Rows, Seen, Shown, counter, gauge
from fltea.sinks.figures.hidden import (
    ESTIMATE,
    FIT,
    NARROW,
    NO_ENTITY,
    NO_METRIC,
    NO_PANEL,
    ONLY_METRIC,
    PER_SAMPLE,
)
from fltea.sinks.figures.of_axis import LAG1, NIS, PANEL, ROW, three
from fltea.sinks.words import quantity

TABLE = Shown("the table of FLTEA")

_axis, _estimate = partial(Figure, AxisStats), partial(Figure, AxisEstimate)


def _valid(seen: Seen) -> FlteaEstimate | None:
    return seen.estimate.fltea if seen.estimate is not None and seen.estimate.fltea.valid else None


def _settled(seen: Seen) -> Iterator[Cells]:
    e = _valid(seen)
    yield ["FLTEA (paper)", "–" if e is None else "settled" if e.settled else "settling"]


def _alpha(seen: Seen) -> Iterator[Cells]:
    e = _valid(seen)
    yield ["α, 95 %", plus_minus(e.alpha, e.alpha_std) if e else "–"]


def _f(seen: Seen) -> Iterator[Cells]:
    e = _valid(seen)
    yield ["f, 95 %", f"{plus_minus(e.f, e.f_std)} s^-α" if e else "–"]


def _fltea_state(seen: Seen) -> Iterator[Cells]:
    e = _valid(seen)
    yield ["state x̂ (paper)", quantity(e.state if e else None, unit_of(seen.axis), 4)]


def _describes(seen: Seen) -> Iterator[Cells]:
    axis: AxisStats | None = seen.record(AxisStats)
    if axis is not None and axis.describes_noise is False:
        yield ["these do not describe the noise", "no order, another, or coloured innovations"]


def _offset(seen: Seen) -> Iterator[Cells]:
    axis: AxisStats | None = seen.record(AxisStats)
    yield ["offset removed", quantity(axis.bias if axis else None, unit_of(seen.axis), 4)]


def _R(seen: Seen) -> Iterator[Cells]:
    axis: AxisStats | None = seen.record(AxisStats)
    R = axis.R_in_use if axis else None
    yield ["R", quantity(R, f"({unit_of(seen.axis)})²", 3, significant=True)]


FIGURES = (
    _estimate(
        "fltea.valid",
        gauge("fltea_valid", "1: the estimate of the paper's filters is valid; 0: it diverged, or was held."),
        page=Shown("the line that says the state of the device, and the rows of the filters"),
        terminal=TABLE,
        home_assistant=NO_ENTITY,
        grafana=PANEL,
    ),
    _estimate(
        "fltea.settled",
        gauge(
            "fltea_settled",
            "1: the filters' variances are known, and their innovations are white; 0: they still settle.",
        ),
        page=Rows("axis", _settled),
        terminal=TABLE,
        home_assistant=NO_ENTITY,
        grafana=NO_PANEL,
    ),
    _estimate(
        "fltea.alpha",
        gauge("fltea_alpha", "Order of the noise by the paper's filters."),
        page=Rows("axis", _alpha),
        terminal=TABLE,
        home_assistant=NO_ENTITY,
        grafana=PANEL,
    ),
    _estimate(
        "fltea.alpha_std",
        gauge("fltea_alpha_std", "Standard deviation of the order, by the filter of the order itself."),
        page=ROW,
        terminal=TABLE,
        home_assistant=NO_ENTITY,
        grafana=NO_PANEL,
    ),
    _estimate(
        "fltea.f",
        gauge("fltea_f", "Parameter f by the paper's filters, in s^-alpha."),
        page=Rows("axis", _f),
        terminal=TABLE,
        home_assistant=NO_ENTITY,
        grafana=PANEL,
    ),
    _estimate(
        "fltea.f_std",
        gauge(
            "fltea_f_std",
            "Standard deviation of the parameter f, by the filter of the parameter itself, in s^-alpha.",
        ),
        page=ROW,
        terminal=TABLE,
        home_assistant=NO_ENTITY,
        grafana=NO_PANEL,
    ),
    _axis(
        "describes_noise",
        gauge(
            "describes_noise",
            "1: the innovations are white and the order is the fit's; 0: alpha and f say nothing of the "
            "noise.",
        ),
        page=Rows("axis", _describes),
        terminal=TABLE,
        home_assistant=NO_ENTITY,
        grafana=NO_PANEL,
    ),
    _estimate(
        "fltea.state",
        PER_SAMPLE,
        page=Rows("axis", _fltea_state),
        terminal=TABLE,
        home_assistant=NO_ENTITY,
        grafana=NO_METRIC,
    ),
    _estimate(
        "fltea.innovation",
        PER_SAMPLE,
        page=PER_SAMPLE,
        terminal=TABLE,
        home_assistant=NO_ENTITY,
        grafana=NO_METRIC,
    ),
    _axis(
        "bias",
        ESTIMATE,
        page=Rows("axis", _offset),
        terminal=NARROW,
        home_assistant=NO_ENTITY,
        grafana=NO_METRIC,
    ),
    _axis(
        "R_in_use",
        FIT,
        page=Rows("axis", _R),
        terminal=NARROW,
        home_assistant=NO_ENTITY,
        grafana=NO_METRIC,
    ),
    _axis(
        "innovation_lag1",
        gauge("innovation_lag1", LAG1),
        page=Row("axis", "innovations, lag 1", three, absent="–"),
        terminal=NARROW,
        home_assistant=NO_ENTITY,
        grafana=PANEL,
    ),
    _axis(
        "innovation_nis",
        gauge("innovation_nis", NIS),
        page=Row("axis", "innovations, NIS", three, absent="–"),
        terminal=NARROW,
        home_assistant=NO_ENTITY,
        grafana=PANEL,
    ),
    _axis(
        "restarts",
        counter("restarts", "Number of restarts of the axis's filters in this epoch."),
        page=Row("axis", "started again", absent="–"),
        terminal=NARROW,
        home_assistant=NO_ENTITY,
        grafana=PANEL,
    ),
    _axis(
        "interventions",
        counter(
            "interventions",
            "Number of samples in which the guard intervened since the last start of the axis's filters, "
            "by cause.",
            key="reason",
        ),
        page=Shown("the list of what the guard did"),
        terminal=NARROW,
        home_assistant=NO_ENTITY,
        grafana=PANEL,
    ),
    _estimate(
        "null_p",
        gauge(
            "null_p",
            "Probability that white noise looks at least as unlike white noise as the samples do (p-value).",
        ),
        **ONLY_METRIC,
    ),
    _estimate(
        "whiteness",
        gauge(
            "not_white",
            "1: the samples are not white noise, see fltea identify; 0: white noise is not rejected, so "
            "there is no order.",
            convert=lambda word: float(word == "rejected"),
        ),
        **ONLY_METRIC,
    ),
)
