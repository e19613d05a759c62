"""Make the files to download from the live page: a report of all data so far, and Kalibr's imu.yaml."""

import re
from collections.abc import Iterable, Sequence
from datetime import UTC, datetime
from html import escape
from typing import NamedTuple

import msgspec

from fltea.documents import curves
from fltea.documents.html_page import html_page, table
from fltea.documents.imu_yaml import AxisNoise, Shown, imu_yaml
from fltea.records.errors import UsageError
from fltea.records.fit import AxisFit, Interval
from fltea.records.records import AXES, Fit
from fltea.records.sensor_kind import SENSOR_KINDS
from fltea.records.visible import visible, visible_lines
from fltea.sinks.page import facts
from fltea.sinks.page.answer import Answer, order
from fltea.sinks.page.axis_sentence import answer_of
from fltea.sinks.page.data_sheet import coefficients
from fltea.sinks.page.history import DeviceHistory

UNDEFINED = "undefined"
NOT_SHOWN = "the Allan deviation does not show it yet: record longer"


class Seen(NamedTuple):
    """The data from which both downloads are made, copied from the device's history at one moment."""

    name: str
    when: datetime
    fit: Fit
    axes: dict[str, AxisFit]
    answers: dict[str, Answer]
    rate_hz: float
    heading: str
    settings: str
    tables: dict[str, list[list[str]]]
    events: list[tuple[str, str]]

    @property
    def stem(self) -> str:
        """Beginning of the name of the downloaded file."""
        return f"fltea_{re.sub(r'[^A-Za-z0-9_.-]+', '_', self.name)}_{self.when:%Y%m%dT%H%M%SZ}"


def seen(history: DeviceHistory) -> Seen:
    """Copy what is known about a device. The caller holds the lock of the history.

    Raises:
        UsageError: there is no fit yet.
    """
    fit, hello = history.fits.newest, history.hello
    if fit is None or hello is None:
        raise UsageError("There is no fit yet: it comes within seconds of the first samples.")
    axes = {}
    for axis in history.axes or fit.axes:
        found = history.fits.axes.get(axis)
        if found is not None:
            curves = history.fits.curves.get(axis)
            spectrum, allan = (curves.spectrum, curves.allan) if curves else (None, None)
            axes[axis] = msgspec.structs.replace(found, spectrum=spectrum, allan=allan)
    parts = [visible(hello.sensor or hello.source), f"{hello.rate_hz:.6g} Hz", facts.fitted(history)]
    when = datetime.fromtimestamp(fit.host_ns * 1e-9, UTC)
    events = [(_clock(e.host_ns), visible_lines(e.text)) for e in history.happenings]
    temperature_c = history.sample.temperature_c if history.sample else None
    return Seen(
        history.name,
        when,
        fit,
        axes,
        {axis: answer_of(history.fits, history.stats, axis) for axis in axes},
        hello.rate_hz,
        ", ".join([*parts, f"until {when:%Y-%m-%d %H:%M:%S} UTC"]),
        facts.settings(history),
        {"Link": facts.link(history.stats), "Device": facts.device(hello, temperature_c)},
        events,
    )


def yaml_of(found: Seen) -> str:
    """Return the file imu.yaml for Kalibr, with N and K from the live Allan deviations.

    Raises:
        UsageError: no axis of the gyroscope has an Allan deviation yet.
    """
    gyro, accel = (
        {
            axis: AxisNoise(_shown(fit.allan.N), _shown(fit.allan.K))
            for axis, fit in found.axes.items()
            if axis in kind.axes and fit.allan is not None
        }
        for kind in SENSOR_KINDS
    )
    if not gyro:
        raise UsageError("There is no Allan deviation of the gyroscope yet: wait until the page shows one.")
    source = f"{found.name}, live: {found.heading}"
    return imu_yaml(gyro, found.rate_hz, source, accel=accel)


def report_of(found: Seen) -> str:
    """Return the report: one self-contained HTML page, with the last fit as JSON in it."""
    body = [f'<section><h2>{escape(found.name)}</h2><p class="faint">{escape(found.heading)}</p>']
    body += [_verdict(axis, said) for axis, said in found.answers.items()]
    body.append(_parameters(found.axes))
    for axis, fit in found.axes.items():
        body.append(f'<h3 class="axis">{axis}</h3>')
        if fit.allan is not None:
            body.append(_pairs(coefficients(fit.allan, axis in AXES)))
        figures = "".join(f'<figure class="chart">{one}</figure>' for one in _figures(fit))
        body.append(f'<div class="figures">{figures}</div>')
    for title, rows in found.tables.items():
        body.append(f"<h3>{title}</h3>{_pairs(rows)}")
    body.append(f"<h3>What happened</h3>{_pairs(found.events)}")
    body.append(f'<p class="faint">FLTEA: {escape(found.settings)}</p></section>')
    of_all = msgspec.structs.replace(found.fit, axes=found.axes)
    data = msgspec.json.encode(of_all).decode().replace("<", "\\u003c")
    body.append(f'<script type="application/json" id="fit">{data}</script>')
    title, made_by = f"Noise of {found.name}, live", "the live page of <code>fltea run</code>"
    return html_page(title, "".join(body), made_by)


def _figures(fit: AxisFit) -> list[str]:
    """Return the diagrams of an axis (spectrum, Allan deviation) for which its fit contains the data."""
    shown = [curves.spectrum(fit.spectrum, fit.unit, fit.rate_left_out)] if fit.spectrum else []
    return [*shown, curves.allan(fit.allan, fit.unit)] if fit.allan else shown


def _verdict(axis: str, found: Answer) -> str:
    rest = " ".join(f"{part}." for part in (found.until, found.left_out) if part)
    return f'<p class="verdict"><b>{axis}: {escape(found.head)}.</b> {escape(found.text)} {escape(rest)}</p>'


def _pairs(rows: Iterable[Sequence[str]]) -> str:
    return table((row[:2] for row in rows), kinds=("th", "text"))


def _parameters(axes: dict[str, AxisFit]) -> str:
    """Return a table of α, f and the other parameters of all axes."""
    rows: dict[str, list[str]] = {}
    for fit in axes.values():
        alpha, f = order(fit)
        values = {
            "verdict": fit.verdict,
            "null test p": "–" if fit.null_p is None else f"{fit.null_p:.2g}",
            "α": _interval(alpha),
            "f [s^-α]": _interval(f),
            "F = g + α": _interval(fit.F if alpha else None),
            f"s² [({fit.unit})²]": _interval(fit.s2),
            f"R [({fit.unit})²]": _interval(fit.R),
        }
        for label, value in values.items():
            rows.setdefault(label, []).append(value)
    return table(([label, *values] for label, values in rows.items()), ["", *axes], ["th"])


def _interval(p: Interval | None) -> str:
    if p is None or p.value is None or p.low is None or p.high is None:
        return UNDEFINED
    return f"{p.value:.4g} ({p.low:.4g} … {p.high:.4g})"


def _shown(value: float | None) -> Shown:
    return Shown(value, "" if value is not None else NOT_SHOWN)


def _clock(host_ns: int) -> str:
    return f"{datetime.fromtimestamp(host_ns * 1e-9, UTC):%Y-%m-%d %H:%M:%S}"
