"""Arrange the results: as rows for people (terminal and report), and as one JSON object for programs."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import msgspec

from fltea.identification.axis import AxisResult
from fltea.identification.axis_report import AxisReport, Failure, FileReport
from fltea.identification.comparison import compared
from fltea.identification.data_checks import DataCheck
from fltea.identification.fltea_fit import FlteaFit
from fltea.identification.lead import interval
from fltea.identification.load import GYRO_UNIT
from fltea.identification.quantities import quantities
from fltea.identification.shuffled import ShuffledBand
from fltea.noise.parts import kind_named
from fltea.records.odds import odds
from fltea.records.plus_minus import plus_minus
from fltea.records.quantity import Quantity, quantity_of, shown_units, texts, without_unit
from fltea.records.stats import CAUSE_WORDS
from fltea.spectrum.wording import duration

NONE = "–"
SEVERITIES = ("bad", "warning", "note")

Row = tuple[str, str]
"""A label and a value."""


def document(reports: Sequence[FileReport]) -> dict[str, Any]:
    """Return all results of all recordings as one object for JSON."""
    found: dict[str, Any] = {"files": [_file(report) for report in reports]}
    return found | ({"compared": msgspec.to_builtins(compared(reports))} if len(reports) > 1 else {})


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
            "data_checks": msgspec.to_builtins(report.recording.data_checks),
            "reading": msgspec.to_builtins(report.recording.reading),
        }
    return found | {"axes": {name: _axis(axis) for name, axis in report.axes.items()}}


def _axis(axis: AxisReport | Failure) -> dict[str, Any]:
    if isinstance(axis, Failure):
        return {"error": axis.error}
    own = dict.fromkeys(("curves", "tracked", "course"))
    found: dict[str, Any] = msgspec.to_builtins(msgspec.structs.replace(axis, **own))
    for name in (*own, "left_out"):
        del found[name]
    return {"unit": found.pop("unit"), "lsb": found.pop("lsb"), **found.pop("result"), **found}


def sheets(axes: Mapping[str, AxisReport]) -> list[str]:
    """Return sentences that compare each axis with the data sheet that the user named.

    The sentences also name the source of the data sheet.
    """
    found = [(name, axis.sheet) for name, axis in axes.items() if axis.sheet is not None]
    sources = dict.fromkeys(f"Data sheet of the {one.part}: {one.source}." for _, one in found if one.part)
    return [f"{name}: {one.text}" for name, one in found] + list(sources)


def heading(report: FileReport) -> str:
    """Return device, rate and length of the recording in one text line."""
    if report.recording is None:
        return ""
    hello, c = report.recording.hello, report.recording.counts
    parts = [hello.sensor, hello.device_id and f"device {hello.device_id}", f"{hello.rate_hz:.6g} Hz"]
    parts.append(f"{c.used:,} samples" + ("" if c.used == c.samples else f" of {c.samples:,}"))
    parts.append(f"{c.used / hello.rate_hz:.1f} s")
    return ", ".join(part for part in parts if part)


def reading(report: FileReport) -> list[Row]:
    """Return how another program's file was read.

    Each row is a question (such as the unit), its answer and the evidence for it.
    """
    return [] if report.recording is None else [(one.question, str(one)) for one in report.recording.reading]


def doubts(report: FileReport) -> list[str]:
    """Return what the device or the link reported about the samples; an empty list if nothing is wrong."""
    if report.recording is None:
        return []
    c = report.recording.counts
    counts = (
        (c.duplicates, "came twice"),
        (c.before_hello, "could not be used, since their device was not known"),
        (c.rate_differs, "were not used, since their device contradicts itself on its rate"),
        (c.late, "were read late"),
        (c.retried, "were read at the second attempt"),
        (c.saturated, "are at the end of the range"),
    )
    return [f"{count:,} samples {what}." for count, what in counts if count]


def data_checks(report: FileReport) -> list[tuple[str, DataCheck]]:
    """Return all data checks of a recording with their axes, the worst first.

    A finding that several axes share is returned once, with the names of all these axes.
    """
    found: dict[tuple[str, str], tuple[list[str], DataCheck]] = {}
    of_axes = [(name, axis.data_checks) for name, axis in report.axes.items() if isinstance(axis, AxisReport)]
    of_all = report.recording.data_checks if report.recording else ()
    for name, those in [("", of_all), *of_axes]:
        for data_check in those:
            found.setdefault((data_check.kind, data_check.text), ([], data_check))[0].extend(
                one for one in data_check.axes or (name,) if one in report.axes or not one
            )
    named = [(", ".join(filter(None, names)), data_check) for names, data_check in found.values()]
    return sorted(named, key=lambda one: SEVERITIES.index(one[1].severity))


def rows(axis: AxisReport) -> list[Row]:
    """Return the rows of figures of one axis for the report."""
    r = axis.result
    unit = axis.unit
    found = [
        (f"mean [{unit}]", f"{r.mean:.4g}"),
        (f"σ [{unit}]", f"{r.std:.4g}"),
        ("σ [LSB]", f"{r.std / axis.lsb:.1f}" if axis.lsb else "not known"),
    ]
    for fit in (r.fltea, r.fltea_other):
        if fit is not None:
            found += _fltea_rows(fit, r.null.shuffled if fit is r.fltea else None, unit)
    found += [
        ("null test p", f"{r.null.p_value:.2g}"),
        ("  as fitted", f"{r.null.p_clean:.2g}"),
        ("order α", interval(r.order.alpha)),
        ("  f [s^-α]", interval(r.order.f)),
        ("  F = g + α", interval(r.order.F)),
    ]
    found += part_rows(axis)
    found += [
        (f"best {how} an order", f"{one.name}, BIC {one.bic:+.1f}")
        for how, name in (("without", "plain"), ("with", "order"))
        if (one := r.models.get(name)) is not None
    ]
    if r.verdict.odds is not None:
        found.append(("odds of an order", odds(r.verdict.odds)))
    if r.fltea is not None and (innovations := r.innovations.get(r.fltea.variant)):
        found += [
            ("innovations' NIS", f"{innovations.nis:.3g}"),
            ("  lag-1", f"{innovations.lag1:+.3f}"),
            ("  Ljung–Box p", f"{innovations.ljung_box_p:.2g}"),
        ]
    return found


def _fltea_rows(fit: FlteaFit, shuffled: ShuffledBand | None, unit: str) -> Iterator[Row]:
    yield f"FLTEA {fit.variant} α", _pm(fit.alpha, fit.alpha_std)
    yield (
        "  describes the noise",
        NONE if fit.describes_noise is None else "yes" if fit.describes_noise else "no",
    )
    if shuffled:
        yield "  shuffled gives", _span(shuffled.alpha)
    moved = NONE if fit.alpha_drift is None else f"{fit.alpha_drift:+.3f}"
    yield (
        "  over last third",
        moved if fit.converged or fit.alpha_drift is None else f"{moved}, not converged",
    )
    yield f"{fit.variant} f [s^-α]", _pm(fit.f, fit.f_std)
    if shuffled:
        yield "  shuffled gives", _span(shuffled.f)
    yield f"{fit.variant} R [({unit})²]", f"{fit.R:.4g}"
    times = sum(fit.interventions.values())
    yield "  guard stepped in", f"{times:,} times" if times else "never"


def level_rows(axis: AxisReport) -> list[Row]:
    """Return rows with the names of the noise's parts, and with N, K and B and their 95 % intervals.

    The axes of a gyroscope have the units of data sheets, such as deg/√h.
    """
    known, of = quantities(axis.unit, axis.result.level, axis.allan, axis.now), shown_units(axis.unit)
    N, K, B = known.N.to(of.N), known.K.to(of.K), known.B.to(of.B)
    return [
        ("made of", axis.result.made_of),
        (f"  N [{N.unit}]", _estimate(N)),
        (f"  K [{K.unit}]", _walk(K, None if axis.walk is None else axis.walk.tells_s)),
        (f"  B [{B.unit}]", _estimate(B)),
    ]


def part_rows(axis: AxisReport) -> list[Row]:
    """Return the rows of `level_rows`, and rows with the parameters of each part and their intervals."""
    r, unit = axis.result, axis.unit
    found = level_rows(axis)
    counted: dict[str, int] = {}
    for part in r.parts:
        counted[part.part] = number = counted.get(part.part, 0) + 1
        if part.part in ("white", "walk"):  # N and K have rows of their own
            continue
        symbols = kind_named(part.part).symbols
        for name, value in part.values.items():
            if part.part == "order" and name in ("alpha", "f"):  # α and f have rows of their own
                continue
            symbol, its = symbols[name]
            its = its.format(unit=unit)
            found.append(
                (f"  {part.part} {number} {symbol}{its and f' [{its}]'}", _estimate(quantity_of(value, its)))
            )
    drift = quantity_of(r.drift_rate, f"{unit}/s")
    drift = drift.to("deg/h/h") if unit == GYRO_UNIT else drift
    return [*found, (f"  drift rate [{drift.unit}]", _estimate(drift))]


def _estimate(one: Quantity) -> str:
    """Return as text the value and its interval, or the upper bound; a missing interval is remarked."""
    _, interval = texts(one)
    return without_unit(one) + ("" if one.value is None or interval else ", not known well")


def _walk(K: Quantity, tells_s: float | None) -> str:
    """Return K as text, or its upper bound and the length of a record that would be enough to estimate K."""
    more = "" if K.value is not None or tells_s is None else f"; {duration(tells_s)} would tell"
    return _estimate(K) + more


def settings(axis: AxisReport) -> str:
    """Return the settings that FLTEA was run with, in one text line."""
    f = axis.result.fltea
    if f is None:
        return method(axis.result)
    guard = ", ".join(f"{CAUSE_WORDS[cause]} ({n:,})" for cause, n in f.interventions.items()) or "never"
    drift = NONE if f.alpha_drift is None else f"{f.alpha_drift:+.3g}"
    moved = f"{drift} over the last third{'' if f.converged else ': not converged'}"
    return (
        f"{method(axis.result)}; the guard stepped in: {guard}; R = {f.R:.4g} ({axis.unit})²; "
        f"{f.restarts} restarts; α moved by {moved}."
    )


def remarks(axes: Mapping[str, AxisReport]) -> list[str]:
    """Return sentences on figures that are missing or do not describe the noise.

    The sentences name the axes concerned.
    """
    names: dict[str, list[str]] = {}
    for name, axis in axes.items():
        for fit in (axis.result.fltea, axis.result.fltea_other):
            if fit is not None and fit.describes_noise is False:
                text = (
                    f"FLTEA {fit.variant} does not describe the noise of {{}}: ignore its α and f, however "
                    "small their ±."
                )
                names.setdefault(text, []).append(name)
        if axis.result.level.reason:
            names.setdefault(f"{{}}: {axis.result.level.reason}".replace("unit", axis.unit), []).append(name)
        if axis.allan is not None and axis.allan.B.reason:
            names.setdefault(f"{{}}: B is not known: {axis.allan.B.reason}.", []).append(name)
    return [text.format(", ".join(those)) for text, those in names.items()]


def method(r: AxisResult) -> str:
    """Return FLTEA's settings, and over how many of the samples it was run."""
    f = r.fltea
    if f is None:
        return f"FLTEA was not run: {r.fltea_reason}"
    window = "unlimited" if f.settings.window is None else f"{f.settings.window:,} samples"
    longest = (
        f", over the longest part, {f.samples:,} of {r.samples:,} samples" if f.samples < r.samples else ""
    )
    return (
        f"FLTEA {f.variant}, guard {f.guard}, window {window}, start-up {f.startup_samples:,} samples, "
        f"R from the {f.R_from}{longest}"
    )


def _pm(value: float | None, std: float | None) -> str:
    return "not valid" if value is None else plus_minus(value, std)


def _span(band: tuple[float, float, float] | None) -> str:
    return NONE if band is None else f"{band[0]:.3f} … {band[2]:.3f}".replace("-0.000", "0.000")


def by_sensor(axes: Mapping[str, AxisReport]) -> list[dict[str, AxisReport]]:
    """Return one dictionary of axes for each sensor, gyroscope and accelerometer, as their units differ."""
    units = dict.fromkeys(axis.unit for axis in axes.values())
    return [{name: axis for name, axis in axes.items() if axis.unit == unit} for unit in units]


def side_by_side(
    axes: Mapping[str, AxisReport], rows_of: Callable[[AxisReport], list[Row]] = rows
) -> list[tuple[str, list[str]]]:
    """Return a table of several axes: each row has a label and one value for each axis.

    `rows_of` makes the rows of an axis. The value is empty for an axis for which `rows_of` gives no row with
    this label.
    """
    columns = [_keyed(rows_of(axis)) for axis in axes.values()]
    labels: list[tuple[str, str]] = []
    for column in columns:
        index = 0
        for key in column:
            if key in labels:
                index = labels.index(key) + 1
            else:
                labels.insert(index, key)
                index += 1
    return [(key[1], [column.get(key, "") for column in columns]) for key in labels]


def _keyed(found: list[Row]) -> dict[tuple[str, str], str]:
    """Return the value of each row by a key: the label of the last row not indented, and its own label.

    One label is not enough: the same indented label may stand below several rows that are not indented.
    """
    keyed, above = {}, ""
    for label, value in found:
        above = above if label.startswith(" ") else label
        keyed[above, label] = value
    return keyed
