"""Declare the figures of the fits that this computer makes, and of those that a device makes itself."""

from functools import partial

from fltea.records.device_fit import DeviceAxisFit
from fltea.records.fit import AxisFit
from fltea.records.records import Fit
from fltea.sinks.figures.figure import Entity, Figure, Hidden, Shown, gauge
from fltea.sinks.figures.hidden import NARROW, NO_ENTITY, NO_METRIC, NO_PANEL, NO_ROW

ANSWER = Shown("the sentence and the details of the axis")
SENTENCE = Shown("the sentence of the axis")
OF_DEVICE = Shown("the device's own fit")
ATTRIBUTE = Shown("an attribute of the parameter's entity")
PANEL = Shown("a panel")
CURVE = Hidden("the number comes with the curves, in some fits only; Prometheus needs it with each fit")

_axis, _fit, _device = partial(Figure, AxisFit), partial(Figure, Fit), partial(Figure, DeviceAxisFit)


def _parameter(
    field: str,
    text: str,
    page: Shown | Hidden,
    terminal: Shown | Hidden,
    home_assistant: Entity | Hidden,
    grafana: tuple[Shown | Hidden, Shown | Hidden],
) -> tuple[Figure, ...]:
    """Return the figures of a fitted parameter: its value, and both ends of its 95 % interval.

    `grafana`: two declarations. The first says how Grafana shows the value, and the second how it shows the
    ends of the interval.
    """
    ends = home_assistant if isinstance(home_assistant, Hidden) else ATTRIBUTE
    return tuple(
        _axis(
            f"{field}.{end}",
            gauge(f"{field}{ending}", f"{text}{which}."),
            page=page,
            terminal=terminal,
            home_assistant=ends if ending else home_assistant,
            grafana=grafana[bool(ending)],
        )
        for end, ending, which in (
            ("value", "", ""),
            ("low", "_low", ": lower end of its 95 % interval"),
            ("high", "_high", ": upper end"),
        )
    )


FIGURES = (
    _axis(
        "verdict",
        gauge("verdict", "1 for the present verdict on the noise.", key="verdict"),
        page=ANSWER,
        terminal=SENTENCE,
        home_assistant=Entity("noise", "noise"),
        grafana=PANEL,
    ),
    *_parameter(
        "alpha",
        "Order of the noise, by maximum likelihood",
        ANSWER,
        SENTENCE,
        Entity("alpha", "α", state_class="measurement"),
        (PANEL, PANEL),
    ),
    *_parameter(
        "f",
        "Parameter f by maximum likelihood, in s^-alpha",
        ANSWER,
        SENTENCE,
        Entity("f", "f", "s^-α", state_class="measurement"),
        (PANEL, PANEL),
    ),
    *_parameter(
        "F", "F = h^alpha f + alpha by maximum likelihood", NO_ROW, NARROW, NO_ENTITY, (NO_PANEL, NO_PANEL)
    ),
    *_parameter(
        "s2",
        "Variance of the noise's source by maximum likelihood, in the axis's unit squared",
        NO_ROW,
        NARROW,
        NO_ENTITY,
        (NO_PANEL, NO_PANEL),
    ),
    *_parameter(
        "R",
        "Variance of the white noise by maximum likelihood, in the axis's unit squared",
        NO_ROW,
        NARROW,
        NO_ENTITY,
        (PANEL, NO_PANEL),
    ),
    _axis(
        "null_p",
        gauge(
            "null_p",
            "Probability that white noise looks at least as unlike white noise as the samples do (p-value).",
        ),
        page=NO_ROW,
        terminal=NARROW,
        home_assistant=NO_ENTITY,
        grafana=PANEL,
    ),
    _axis(
        "until_s.seconds",
        gauge(
            "until_seconds",
            "Seconds until the order is known as precisely as live.target asks; no value if this cannot be "
            "predicted.",
        ),
        page=ANSWER,
        terminal=SENTENCE,
        home_assistant=NO_ENTITY,
        grafana=PANEL,
    ),
    _axis(
        "until_s.target",
        Hidden("it is a setting, live.target"),
        page=ANSWER,
        terminal=SENTENCE,
        home_assistant=NO_ENTITY,
        grafana=NO_METRIC,
    ),
    _axis(
        "left_out",
        gauge(
            "left_out_samples",
            "Number of samples that the fit leaves out or replaces, by cause.",
            key="reason",
        ),
        page=ANSWER,
        terminal=NARROW,
        home_assistant=NO_ENTITY,
        grafana=PANEL,
    ),
    _axis(
        "breaks",
        gauge("breaks", "Number of interruptions in the series of samples, by cause.", key="reason"),
        page=ANSWER,
        terminal=NARROW,
        home_assistant=NO_ENTITY,
        grafana=PANEL,
    ),
    _axis(
        "stable",
        Hidden("if the fit's verdict is not stable, the estimates show the last stable verdict"),
        page=ANSWER,
        terminal=SENTENCE,
        home_assistant=NO_ENTITY,
        grafana=NO_METRIC,
    ),
    _axis(
        "odds",
        Hidden("the number is known for two of the verdicts only, and the text of the verdict has it"),
        page=ANSWER,
        terminal=SENTENCE,
        home_assistant=NO_ENTITY,
        grafana=NO_METRIC,
    ),
    _axis(
        "allan.N",
        CURVE,
        page=ANSWER,
        terminal=SENTENCE,
        home_assistant=NO_ENTITY,
        grafana=NO_METRIC,
    ),
    *(
        _axis(
            f"allan.{coefficient}",
            CURVE,
            page=Shown("the figures of a data sheet"),
            terminal=NARROW,
            home_assistant=NO_ENTITY,
            grafana=NO_METRIC,
        )
        for coefficient in "BK"
    ),
    _fit(
        "samples",
        gauge("samples", "Number of samples that the newest fit uses."),
        page=Shown("the line on the newest fit"),
        terminal=NARROW,
        home_assistant=NO_ENTITY,
        grafana=NO_PANEL,
    ),
    _fit(
        "host_ns",
        gauge("timestamp_seconds", "Unix time of the last sample that the newest fit uses.", factor=1e-9),
        page=NO_ROW,
        terminal=NARROW,
        home_assistant=NO_ENTITY,
        grafana=NO_PANEL,
    ),
    _device(
        "verdict",
        gauge("verdict", "Verdict of the device's own maximum-likelihood fit.", key="verdict"),
        page=OF_DEVICE,
        terminal=OF_DEVICE,
        home_assistant=NO_ENTITY,
        grafana=NO_PANEL,
    ),
    _device(
        "alpha.value",
        gauge("alpha", "Order by the device's own maximum-likelihood fit."),
        page=OF_DEVICE,
        terminal=OF_DEVICE,
        home_assistant=NO_ENTITY,
        grafana=NO_PANEL,
    ),
    _device(
        "alpha.low",
        gauge("alpha_low", "Lower end of its 95 % interval."),
        page=OF_DEVICE,
        terminal=OF_DEVICE,
        home_assistant=NO_ENTITY,
        grafana=NO_PANEL,
    ),
    _device(
        "alpha.high",
        gauge("alpha_high", "Upper end of its 95 % interval."),
        page=OF_DEVICE,
        terminal=OF_DEVICE,
        home_assistant=NO_ENTITY,
        grafana=NO_PANEL,
    ),
    _device(
        "alpha_difference",
        gauge("alpha_difference", "Order: by the device's fit, minus that of this computer's newest fit."),
        page=OF_DEVICE,
        terminal=OF_DEVICE,
        home_assistant=NO_ENTITY,
        grafana=NO_PANEL,
    ),
    _device(
        "half_widths",
        Hidden("the number is alpha_difference divided by the half-width of fit_alpha's interval"),
        page=OF_DEVICE,
        terminal=OF_DEVICE,
        home_assistant=NO_ENTITY,
        grafana=NO_METRIC,
    ),
    _device(
        "samples",
        Hidden("both computers fit the same samples, which fit_samples counts"),
        page=OF_DEVICE,
        terminal=OF_DEVICE,
        home_assistant=NO_ENTITY,
        grafana=NO_METRIC,
    ),
    _device(
        "bins_left_out",
        Hidden("it is a property of the message"),
        page=OF_DEVICE,
        terminal=NARROW,
        home_assistant=NO_ENTITY,
        grafana=NO_METRIC,
    ),
)
