"""What was found out, as rows for people (terminal and page) and as one JSON object for programs."""

from collections.abc import Mapping, Sequence
from typing import Any

import msgspec

from fltea.identification.allan import SQRT_HOUR, scales
from fltea.identification.axis import AxisResult
from fltea.identification.fltea_fit import FlteaFit
from fltea.identification.load import GYRO_UNIT
from fltea.identification.run import AxisReport, Failure, FileReport
from fltea.identification.traps import Trap
from fltea.spectrum.allan_coefficients import HOUR, Coefficient
from fltea.spectrum.composite_intervals import Estimate
from fltea.spectrum.profile import Parameter
from fltea.spectrum.wording import MODELS

UNDEFINED = "undefined"
NONE = "–"
SEVERITIES = ("bad", "warning", "note")

Row = tuple[str, str]
"""A label and a value."""


def document(reports: Sequence[FileReport]) -> dict[str, Any]:
    """Return all of it, for JSON."""
    return {"files": [_file(report) for report in reports]}


def _file(report: FileReport) -> dict[str, Any]:
    found: dict[str, Any] = {"file": report.name}
    if report.failure is not None:
        found["error"] = str(report.failure)
    if report.recording is not None:
        hello = report.recording.hello
        found |= {
            "device_id": hello.device_id,
            "sensor": hello.sensor,
            "clock_ppm": report.recording.clock_ppm,
            "samples": msgspec.to_builtins(report.recording.counts),
            "traps": msgspec.to_builtins(report.recording.traps),
        }
    return found | {"axes": {name: _axis(axis) for name, axis in report.axes.items()}}


def _axis(axis: AxisReport | Failure) -> dict[str, Any]:
    if isinstance(axis, Failure):
        return {"error": axis.error}
    result: dict[str, Any] = msgspec.to_builtins(axis.result)
    return {
        "unit": axis.unit,
        "lsb": axis.lsb,
        **result,
        "model": msgspec.to_builtins(axis.model),
        "allan": msgspec.to_builtins(axis.allan),
        "reproduction": msgspec.to_builtins(axis.reproduction),
        "allan_reason": axis.allan_reason,
        "traps": msgspec.to_builtins(axis.traps),
    }


def heading(report: FileReport) -> str:
    """Return what the recording is, in a line."""
    if report.recording is None:
        return ""
    hello, c = report.recording.hello, report.recording.counts
    parts = [hello.sensor, hello.device_id and f"device {hello.device_id}", f"{hello.rate_hz:.6g} Hz"]
    parts.append(f"{c.used:,} samples" + ("" if c.used == c.samples else f" of {c.samples:,}"))
    parts.append(f"{c.used / hello.rate_hz:.1f} s")
    return ", ".join(part for part in parts if part)


def doubts(report: FileReport) -> list[str]:
    """Return what the device or the link said of the samples; nothing where all is well."""
    if report.recording is None:
        return []
    c = report.recording.counts
    counts = (
        (c.duplicates, "came twice"),
        (c.before_hello, "could not be used, for their device was not known"),
        (c.late, "were read late"),
        (c.retried, "were read at the second attempt"),
        (c.saturated, "are at the end of the range"),
    )
    return [f"{count:,} samples {what}." for count, what in counts if count]


def traps(report: FileReport) -> list[tuple[str, Trap]]:
    """Return all of a recording with their axis, the worst first.

    What several axes have in common comes once.
    """
    found: dict[tuple[str, str], tuple[list[str], Trap]] = {}
    of_axes = [(name, axis.traps) for name, axis in report.axes.items() if isinstance(axis, AxisReport)]
    of_all = report.recording.traps if report.recording else ()
    for name, those in [("", of_all), *of_axes]:
        for trap in those:
            found.setdefault((trap.kind, trap.text), ([], trap))[0].append(name)
    named = [(", ".join(filter(None, names)), trap) for names, trap in found.values()]
    return sorted(named, key=lambda one: SEVERITIES.index(one[1].severity))


def rows(axis: AxisReport) -> list[Row]:
    """Return the rows of one axis for the report."""
    r = axis.result
    found = [
        (f"mean [{axis.unit}]", f"{r.mean:.4g}"),
        (f"σ [{axis.unit}]", f"{r.std:.4g}"),
        ("σ [LSB]", _lsb(axis)),
    ]
    for fit in (r.fltea, r.fltea_other):
        found.append((f"FLTEA {fit.variant} α", _pm(fit.alpha, fit.alpha_std)))
        found.append(("  describes the noise", _yes_no(fit.describes_noise)))
        if fit is r.fltea and r.null.shuffled:
            found.append(("  shuffled gives", _span(r.null.shuffled.alpha)))
        found.append(("  over last third", _moved(fit)))
        found.append((f"{fit.variant} f [s^-α]", _pm(fit.f, fit.f_std)))
        if fit is r.fltea and r.null.shuffled:
            found.append(("  shuffled gives", _span(r.null.shuffled.f)))
    found += [
        (f"R [({axis.unit})²]", f"{r.fltea.R:.4g}"),
        ("guard stepped in", _guard(r.fltea)),
        ("null test p", f"{r.null.p_value:.2g}"),
        ("  as fitted", f"{r.null.p_clean:.2g}"),
        ("Whittle F = g + α", _parameter(r.whittle.F)),
        ("Whittle α", _parameter(r.whittle.alpha)),
        ("Whittle f [s^-α]", _parameter(r.whittle.f)),
        (f"Whittle √R [{axis.unit}]", _root(r.whittle.R)),
        ("best by BIC", best(r)),
        ("best rival", _rival(r)),
        ("fractional", f"BIC {r.rivals.models['fractional'].bic:+.1f}"),
    ]
    found += composite_rows(axis)
    if innovations := r.innovations.get(r.fltea.variant):
        found += [
            ("innovations' NIS", f"{innovations.nis:.3g}"),
            ("  lag-1", f"{innovations.lag1:+.3f}"),
            ("  Ljung–Box p", f"{innovations.ljung_box_p:.2g}"),
        ]
    if axis.allan:
        a = axis.allan
        of = scales(axis.unit)
        found += [
            (f"Allan {letter} [{scale.unit}]", _coefficient(c, scale.factor))
            for letter, c, scale in (("N", a.N, of.N), ("B", a.B, of.B), ("K", a.K, of.K))
        ]
    return found


def composite_rows(axis: AxisReport) -> list[Row]:
    """Return what a navigation filter needs.

    Of a gyroscope in the units of data sheets, with the 95 % interval.
    """
    c, unit = axis.result.composite, axis.unit
    degrees = unit == GYRO_UNIT
    found = [
        ("composite model", c.name),
        (
            f"  N [{'deg/√h' if degrees else f'{unit}/√Hz'}]",
            _estimate(c.N, SQRT_HOUR if degrees else 1.0),
        ),
    ]
    for i, part in enumerate(c.gauss_markov, start=1):
        found += [
            (f"  Gauss–Markov {i} σ [{unit}]", _estimate(part.sigma)),
            (f"  Gauss–Markov {i} τ [s]", _estimate(part.tau_s)),
        ]
    if c.K:
        walk_unit = "deg/h/√h" if degrees else f"{unit}/√s"
        found.append((f"  K [{walk_unit}]", _estimate(c.K, HOUR * SQRT_HOUR if degrees else 1.0)))
    if c.Q:
        found.append((f"  Q [{'deg' if degrees else f'{unit}·s'}]", _estimate(c.Q)))
    if c.drift_rate:
        rate_unit = "deg/h/h" if degrees else f"{unit}/s"
        found.append((f"  drift rate [{rate_unit}]", _estimate(c.drift_rate, HOUR**2 if degrees else 1.0)))
    return found


def _estimate(e: Estimate, factor: float = 1.0) -> str:
    """Return the value and its interval; … without a number: no such end is known."""
    low, high = ("" if end is None else f"{end * factor:.3g}" for end in (e.low, e.high))
    return f"{e.value * factor:.3g}" + (f" ({low}…{high})" if low or high else ", not known well")


def settings(axis: AxisReport) -> str:
    """Return what FLTEA was run with, in a line."""
    f = axis.result.fltea
    guard = ", ".join(f"{cause} {n:,}" for cause, n in f.interventions.items()) or "never"
    drift = NONE if f.alpha_drift is None else f"{f.alpha_drift:+.3g}"
    moved = f"{drift} over the last third{'' if f.converged else ': not converged'}"
    return (
        f"{method(axis.result)}; the guard stepped in: {guard}; R = {f.R:.4g} ({axis.unit})²; "
        f"{f.restarts} restarts; α moved by {moved}."
    )


def not_described(axes: Mapping[str, AxisReport]) -> list[str]:
    """Return a sentence for each variant whose α and f say nothing about some axes."""
    names: dict[str, list[str]] = {}
    for name, axis in axes.items():
        for fit in (axis.result.fltea, axis.result.fltea_other):
            if fit.describes_noise is False:
                names.setdefault(fit.variant, []).append(name)
    return [
        f"FLTEA {variant} does not describe the noise of {', '.join(those)}: its innovations are not white, "
        "so its α and f say nothing there, however small their ±."
        for variant, those in names.items()
    ]


def method(r: AxisResult) -> str:
    """Return the settings that the axes have in common, and over how many of the samples FLTEA was run."""
    f = r.fltea
    window = "unlimited" if f.settings.window is None else f"{f.settings.window:,} samples"
    return (
        f"FLTEA {f.variant}, guard {f.guard}, window {window}, start-up {f.startup_samples:,} samples, "
        f"R from the {f.R_from}"
        + (
            f", over the longest part, {f.samples:,} of {r.samples:,} samples"
            if f.samples < r.samples
            else ""
        )
    )


def short(axis: AxisReport) -> list[str]:
    """Return one axis for a table over many, under `SHORT_HEADINGS`."""
    r = axis.result
    band = r.null.shuffled
    return [
        f"{r.duration_s:.0f}",
        NONE if r.fltea.alpha is None else f"{r.fltea.alpha:.3f}",
        _span(band.alpha) if band else NONE,
        f"{r.null.p_value:.1g}",
        r.verdict.kind,
    ]


SHORT_HEADINGS = ("s", "α", "shuffled α", "null p", "verdict")


def best(r: AxisResult) -> str:
    """Return the model of lowest BIC, and where its spectrum bends or peaks."""
    found = r.rivals.models[r.rivals.best].parameters
    at = found.get("resonance_hz", found.get("bend_hz", found.get("bend_1_hz")))
    if at is None:
        return MODELS[r.rivals.best]
    # Never a corner that the data do not have.
    where = f"{at:.2g} Hz"
    if at < r.band.from_hz:
        where = f"below {r.band.from_hz:.2g} Hz"
    elif at > r.band.to_hz:
        where = f"above {r.band.to_hz:.2g} Hz"
    return f"{MODELS[r.rivals.best]}, {where}"


def model_name(axis: AxisReport) -> str:
    """Return which of the models is exported, and compared with the sensor."""
    tag = str(axis.model.noise.__struct_config__.tag)
    return MODELS.get(tag, tag)


def _rival(r: AxisResult) -> str:
    name = r.rivals.best_rival
    return f"{MODELS[name]}, BIC {r.rivals.models[name].bic:+.1f}"


def _lsb(axis: AxisReport) -> str:
    return f"{axis.result.std / axis.lsb:.1f}" if axis.lsb else "not known"


def _moved(f: FlteaFit) -> str:
    if f.alpha_drift is None:
        return NONE
    return f"{f.alpha_drift:+.3f}" + ("" if f.converged else ", not converged")


def _yes_no(flag: bool | None) -> str:
    return NONE if flag is None else "yes" if flag else "no"


def _guard(f: FlteaFit) -> str:
    times = sum(f.interventions.values())
    return f"{times:,} times" if times else "never"


def _pm(value: float | None, std: float | None) -> str:
    if value is None:
        return "not valid"
    return f"{value:.3f} ± {std:.3f}" if std is not None else f"{value:.3f}"


def _span(band: tuple[float, float, float] | None) -> str:
    return NONE if band is None else f"{band[0]:.3f} … {band[2]:.3f}".replace("-0.000", "0.000")


def _parameter(p: Parameter) -> str:
    if p.low is None or p.high is None:
        return UNDEFINED
    return f"{_number(p.value)} ({_number(p.low)}…{_number(p.high)})"


def _number(value: float) -> str:
    """Return a number with two or three significant digits; less than a thousandth is 0."""
    return "0" if abs(value) < 5e-4 else f"{value:.2f}" if abs(value) < 10 else f"{value:.3g}"


def _root(p: Parameter) -> str:
    return UNDEFINED if p.low is None else f"{p.value**0.5:.4g}"


def _coefficient(c: Coefficient, scale: float) -> str:
    if c.value is None or c.low is None or c.high is None:
        return "not seen"
    return f"{c.value * scale:.3g} ({c.low * scale:.3g}…{c.high * scale:.3g})"


def by_sensor(axes: Mapping[str, AxisReport]) -> list[dict[str, AxisReport]]:
    """Return the axes of each sensor by themselves, for their rows have other units."""
    units = dict.fromkeys(axis.unit for axis in axes.values())
    return [{name: axis for name, axis in axes.items() if axis.unit == unit} for unit in units]


def side_by_side(axes: Mapping[str, AxisReport]) -> list[tuple[str, list[str]]]:
    """Return the rows of several axes: a label, and a value for each.

    Nothing where an axis has no such row.
    """
    columns = [_keyed(rows(axis)) for axis in axes.values()]
    labels: list[tuple[str, str]] = []
    for column in columns:
        place = 0
        for key in column:
            if key in labels:
                place = labels.index(key) + 1
            else:
                labels.insert(place, key)
                place += 1
    return [(key[1], [column.get(key, "") for column in columns]) for key in labels]


def _keyed(found: list[Row]) -> dict[tuple[str, str], str]:
    """Return the rows by label, and by the label above if an indented one comes twice."""
    keyed, above = {}, ""
    for label, value in found:
        above = above if label.startswith(" ") else label
        keyed[above, label] = value
    return keyed
