"""The newest fit of every axis as metrics."""

from collections.abc import Iterator, Sequence

from prometheus_client.core import Metric

from fltea.records.fit import AxisFit
from fltea.records.records import Fit
from fltea.sinks.metrics.rows import Rows, gauge_family

PARAMETERS = (
    ("alpha", "alpha", "Order of the noise, by maximum likelihood"),
    ("f", "f", "Parameter f by maximum likelihood, in s^-alpha"),
    ("F", "F", "F = h^alpha f + alpha by maximum likelihood"),
    ("s2", "s2", "Variance of the noise's source by maximum likelihood, in the axis's unit squared"),
    ("R", "R", "Variance of the white part by maximum likelihood, in the axis's unit squared"),
)
"""Field of an axis's fit, name of the metric, text."""


def fit_families(fits: Sequence[tuple[str, Fit]]) -> Iterator[Metric]:
    """Yield, of each device's newest fit, every parameter with its interval, test and verdict."""
    axes: list[tuple[tuple[str, str], AxisFit]] = [
        ((device, axis), one) for device, fit in fits for axis, one in fit.axes.items()
    ]
    labels = ("device", "axis")
    for field, name, text in PARAMETERS:
        for end, of_end in (("value", ""), ("low", "_low"), ("high", "_high")):
            rows: Rows = [(names, getattr(getattr(one, field), end)) for names, one in axes]
            which = {"value": "", "low": ": lower end of its 95 % interval", "high": ": upper end"}[end]
            yield gauge_family(f"fltea_fit_{name}{of_end}", f"{text}{which}.", labels, rows)
    p: Rows = [(names, one.null_p) for names, one in axes]
    yield gauge_family(
        "fltea_fit_null_p", "How often white noise would look at least as unlike white.", labels, p
    )
    until: Rows = [(names, one.until_s.seconds if one.until_s else None) for names, one in axes]
    text = "Seconds until the order is known as well as live.target asks; none if nobody knows."
    yield gauge_family("fltea_fit_until_seconds", text, labels, until)
    verdicts: Rows = [((*names, one.verdict), 1.0) for names, one in axes]
    yield gauge_family("fltea_fit_verdict", "1: what the noise is.", (*labels, "verdict"), verdicts)
    left_out: Rows = [((*names, why), n) for names, one in axes for why, n in one.left_out.items()]
    text = "Samples that are not in the fit, and bridged ones, by cause."
    yield gauge_family("fltea_fit_left_out_samples", text, (*labels, "reason"), left_out)
    breaks: Rows = [((*names, why), n) for names, one in axes for why, n in one.breaks.items()]
    text = "How often its samples were broken, by cause."
    yield gauge_family("fltea_fit_breaks", text, (*labels, "reason"), breaks)
    samples: Rows = [((device,), fit.samples) for device, fit in fits]
    yield gauge_family("fltea_fit_samples", "Samples that the newest fit is of.", ("device",), samples)
    times: Rows = [((device,), fit.host_ns * 1e-9) for device, fit in fits]
    yield gauge_family("fltea_fit_timestamp_seconds", "Unix time of its last sample.", ("device",), times)
