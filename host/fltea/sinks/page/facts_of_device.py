"""Return what the page says about a device that makes estimates itself, as data for the browser."""

from typing import Any

from fltea.records.estimate import DeviceAxisEstimate
from fltea.records.plus_minus import plus_minus
from fltea.records.records import AXES
from fltea.records.why_not import not_comparable
from fltea.sinks.figures.figure import Cells, Seen
from fltea.sinks.figures.of_device import estimates_rate
from fltea.sinks.figures.table import rows
from fltea.sinks.page.answer import figure_of
from fltea.sinks.page.history import DeviceHistory
from fltea.sinks.words import (
    apart,
    figure,
    guard_words,
    in_deviations,
    signed,
)

NOTHING_YET = "no estimate of the device yet"


def silent(history: DeviceHistory) -> bool:
    """Return whether only the device estimates the gyroscope's axes, and has not done so in this epoch."""
    expected = [axis for axis in history.axes or AXES if history.estimator(axis) == "device"]
    return bool(expected) and not any(axis in history.epoch.newest for axis in expected)


def startup_to_go(history: DeviceHistory) -> int:
    """Return the number of samples that the device's start-up window still needs, as the device says.

    The result is 0 if this computer estimates the gyroscope's axes, or if the device has already sent an
    estimate in this epoch.
    """
    own = history.stats.device_estimator if history.stats else None
    return own.startup_remaining if own is not None and silent(history) else 0


def whose(history: DeviceHistory, estimate_on: str) -> str:
    """Return words that say whether the page shows the device's estimates or this computer's.

    `estimate_on`: where they are made, which is "device", "host" or "both".
    """
    if estimate_on == "device":
        return f" (the device's own estimates as published{_rate(history)})"
    return f" (the host's estimates, and the device's own{_rate(history)})" if estimate_on == "both" else ""


def own(history: DeviceHistory) -> list[Cells]:
    """Return rows of text about the device's estimator.

    Return no rows if the device has stated nothing about its estimator.
    """
    stats = history.stats
    if stats is None or stats.device_estimator is None:
        return []
    return list(rows("own", Seen(stats, history.hello)))


def compared(history: DeviceHistory, axis: str, window: int) -> dict[str, Any] | None:
    """Return the device's estimates of an axis, and their differences from this computer's estimates.

    Return None unless both the device and this computer make estimates of the axis.
    """
    if history.estimator(axis) != "both":
        return None
    farthest = history.course.farthest(window, axis)
    e = history.epoch.compared.get(axis)
    why = NOTHING_YET if e is None else not_comparable(e.why_not) if e.why_not else ""
    stats = history.stats.device_estimator if history.stats else None
    known = None if why or e is None else e
    return {
        "apart": known.alpha_difference if known else None,
        "alpha_text": "–" if e is None or e.fltea.alpha is None else figure(e.fltea.alpha, 3),
        "f_text": "–" if e is None or e.fltea.f is None else figure(e.fltea.f, 3),
        "alpha_apart": _apart(known.alpha_difference if known else None, farthest[0]),
        "f_apart": _apart(known.f_difference if known else None, farthest[1]),
        "why_not": why,
        "rows": [
            *_bias(e),
            ["state x̂, device − host", _difference(known.state_difference if known else None, "deg/s")],
            ["started again, device", str(stats.restarts.get(axis, 0)) if stats else "–"],
        ],
        "guard": guard_words(stats.interventions.get(axis, {}) if stats else {}),
    }


def _bias(e: DeviceAxisEstimate | None) -> list[list[str]]:
    """Return rows about the bias by the device's fit, with its difference from this computer's bias.

    Without a fit there are no rows.
    """
    if e is None or e.tracker_bias is None:
        return []
    apart, std = e.tracker_bias_difference, e.tracker_bias_std
    return [
        ["bias, device", f"{plus_minus(e.tracker_bias, std)} deg/s"],
        [
            "bias, device − host",
            " = ".join(filter(None, (_difference(apart, "deg/s"), in_deviations(apart, std)))),
        ],
    ]


def fit(history: DeviceHistory, axis: str) -> dict[str, Any] | None:
    """Return a description of the device's own maximum-likelihood fit of an axis; None without a fit."""
    found = history.fits.device.get(axis)
    if found is None:
        return None
    alpha = found.alpha
    words = {
        "none": "no spectrum yet: the axis is constant, or has too many gaps",
        "white": "white noise is not rejected: order undefined",
        "fractional": "fractional",
        "relaxation": "fractional, or a relaxation",
    }
    order = figure_of(alpha)
    text = f"{words[found.verdict]}; {found.samples:,} samples"
    if found.bins_left_out:
        text += ", some of the lowest frequencies left out"
    if found.half_widths is not None and found.alpha_difference is not None:
        text += (
            f"; board \u2212 host {signed(found.alpha_difference)}, "
            f"{abs(found.half_widths):.2f} of the half-width of the host's interval"
        )
    return {"alpha": order.said("α") if order else "α undefined", "text": text}


def _apart(newest: float | None, farthest: float) -> str:
    """Return the newest and the largest difference between the device and this computer as text.

    `farthest`: largest difference in the rows of the diagram, NaN if unknown. The newest difference may not
    be in these rows yet, so the larger of the two is returned as the largest.
    """
    if newest is None:
        return ""
    largest = max(abs(newest), farthest)  # if `farthest` is NaN, `max` returns its first argument
    return f"{apart(newest)} now, at most {apart(largest).lstrip('+')}"


def _difference(value: float | None, unit: str) -> str:
    return "–" if value is None else f"{apart(value)} {unit}"


def _rate(history: DeviceHistory) -> str:
    """Return a text that says how many estimates a second the device sends.

    The text is empty if the number is unknown.
    """
    return estimates_rate(history.stats, history.hello)
